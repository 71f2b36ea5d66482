"""Computes the flights of a scenario's vehicles to a task and back, for a watch. Pure."""

import math
from collections.abc import Iterator

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import weather_of
from mission_service.missions.landing import Landing
from mission_service.relief.watch import NEVER_S, WatchAircraft
from mission_service.vehicles.endurance import (
    air_velocity_m_s,
    outbound_s,
    planned_performance,
    return_s,
    usual_return_height_m,
)
from mission_service.vehicles.landing_time import landing_s
from mission_service.vehicles.way_home import Vector

SHARED = "battery"  # pool name if all aircraft share their batteries
SAME_HOME_M = 100.0  # homes closer together than this share a runway


def scenario_aircraft(
    scenario: Scenario, landscape: Landscape, task_m: Vector, duration_s: float, shared: bool
) -> tuple[WatchAircraft, ...]:
    """Return the vehicles of a scenario as aircraft of a watch over ``task_m`` (x, y).

    The flight times are those in the scenario's least favourable wind between the first takeoff and
    the end of the watch. With ``shared``, all batteries fit all aircraft; otherwise, they fit all
    aircraft of the same kind. Raises ScenarioError if a vehicle has no ``endurance_s``.
    """
    winds = list(_winds(scenario, landscape, duration_s))
    homes: list[Vector] = []
    found: list[WatchAircraft] = []
    for section in scenario.vehicles:
        if section.endurance_s is None:
            raise ScenarioError(
                f"{scenario.name}: {section.name} has no endurance_s, the maximum time in the air; "
                f"set it, e.g. --set vehicles.{len(found)}.endurance_s=2700"
            )
        home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
        out_s, back_s = _flight_times(section, landscape, home_m, task_m, winds)
        found.append(
            WatchAircraft(
                name=section.name,
                pool=SHARED if shared else section.kind,
                home=_home_number(homes, home_m),
                out_s=out_s,
                back_s=back_s,
                landing_s=math.ceil(_landing_s(scenario, section, landscape, task_m, winds)),
                endurance_s=int(section.endurance_s),
                reserve_s=math.ceil(section.endurance_reserve_s),
            )
        )
    return tuple(found)


def _winds(scenario: Scenario, landscape: Landscape, duration_s: float) -> Iterator[Vector]:
    """Yield the velocities of the air (x, y) on the map during the watch."""
    weather, start_s = weather_of(scenario), scenario.first_flight_s
    entries = [each for each in weather.entries if start_s < each.at_s < start_s + duration_s]
    return (
        air_velocity_m_s(landscape, each.wind_speed_m_s, each.wind_from_deg)
        for each in [weather.weather_at(start_s), *entries]
    )


def time_to_task_s(
    section: VehicleSection, landscape: Landscape, home_m: Vector, task_m: Vector, wind_m_s: Vector
) -> float:
    """Return the time from takeoff to a task in seconds; infinity if the wind prevents the flight.

    ``home_m`` and ``task_m`` are (x, y) on the map, ``wind_m_s`` is the velocity of the air.
    """
    home_amsl_m, task_amsl_m = _amsl_m(section, landscape, home_m, task_m)
    climb_m = max(task_amsl_m - home_amsl_m, section.altitude_agl_m)
    to_task_m = (task_m[0] - home_m[0], task_m[1] - home_m[1])
    return outbound_s(section, to_task_m, wind_m_s, climb_m)


def _amsl_m(
    section: VehicleSection, landscape: Landscape, home_m: Vector, task_m: Vector
) -> tuple[float, float]:
    """Return the altitudes of home and of the vehicle at the task."""
    home_amsl_m = float(landscape.elevation_at(*home_m))
    return home_amsl_m, float(landscape.elevation_at(*task_m)) + section.altitude_agl_m


def _flight_times(
    section: VehicleSection,
    landscape: Landscape,
    home_m: Vector,
    task_m: Vector,
    winds: list[Vector],
) -> tuple[int, int]:
    """Return the longest flight times to the task and back, in whole seconds."""
    home_amsl_m, task_amsl_m = _amsl_m(section, landscape, home_m, task_m)
    to_task_m = (task_m[0] - home_m[0], task_m[1] - home_m[1])
    to_home_m = (-to_task_m[0], -to_task_m[1])
    return_climb_m = max(home_amsl_m + usual_return_height_m(section) - task_amsl_m, 0.0)

    def back_s(wind_m_s: Vector) -> float:
        """Return the time of a flight home that begins in the opposite direction."""
        away_m_s = _scaled(to_task_m, section.airspeed_m_s)
        over_ground_m_s = (away_m_s[0] + wind_m_s[0], away_m_s[1] + wind_m_s[1])
        performance = planned_performance(section)
        return return_s(section, performance, to_home_m, over_ground_m_s, wind_m_s, return_climb_m)

    out = max(time_to_task_s(section, landscape, home_m, task_m, wind) for wind in winds)
    return _whole(out), _whole(max(map(back_s, winds)))


def _landing_s(
    scenario: Scenario,
    section: VehicleSection,
    landscape: Landscape,
    task_m: Vector,
    winds: list[Vector],
) -> float:
    """Return the longest time from the arrival over home to the touchdown."""
    home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    home_amsl_m, task_amsl_m = _amsl_m(section, landscape, home_m, task_m)
    height_m = max(usual_return_height_m(section), task_amsl_m - home_amsl_m)
    approach = Landing(scenario, section, landscape).approach_at(scenario.first_flight_s)
    return max(landing_s(section, approach, home_m, height_m, wind) for wind in winds)


def _scaled(direction: Vector, length: float) -> Vector:
    now = math.hypot(*direction)
    return (0.0, 0.0) if now == 0.0 else (direction[0] / now * length, direction[1] / now * length)


def _whole(time_s: float) -> int:
    return math.ceil(time_s) if time_s < NEVER_S else NEVER_S


def _home_number(homes: list[Vector], home_m: Vector) -> int:
    """Return the index of a home in ``homes``, to which a new home is added."""
    for index, each in enumerate(homes):
        if math.dist(each, home_m) <= SAME_HOME_M:
            return index
    homes.append(home_m)
    return len(homes) - 1
