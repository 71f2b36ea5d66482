"""Pairs a flight with a scenario, which defines vehicles, mission time and landscape."""

import math
from datetime import timedelta
from typing import NamedTuple

from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import Ignition, LandscapeSection, WeatherEntry
from mission_service.config.scenario import Scenario, flying, load_run, run_of
from mission_service.config.sections import PlannerSection, VehicleSection
from mission_service.config.service_section import ServiceSection
from mission_service.errors import FlightError
from mission_service.fire.scenario_fire import landscape_of
from mission_service.ground_distance import M_PER_DEG
from mission_service.replay.flights.flight_logs import Flight, Survey
from mission_service.replay.flights.flown_vehicle import Flown, file_of
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.replay.flights.utc_time import EPOCH, unix_us

# The landscape that is generated for a flight without a scenario; AROUND_M is the margin around the
# tracks.
AROUND_M = 2000.0
CELL_M, MAX_CELLS = 30.0, 600
LONG_AFTER_S = 30 * 86_400.0


class ScenarioChoice(NamedTuple):
    """The user's choice of scenario, rule, start time and settings for a replay."""

    scenario: str | None = None
    rule: str | None = None  # replaces the scenario's rule
    at_s: float | None = None  # mission time at which the flight begins
    overrides: tuple[str, ...] = ()


def chosen_scenario(
    flight: Flight, choice: ScenarioChoice
) -> tuple[Scenario, ServiceSection] | None:
    """Return the chosen scenario, or that of a journal; None for a log without a scenario.

    Raises ScenarioError, and FlightError if settings are given without a scenario.
    """
    overrides, own = choice.overrides, flight.logs[0]
    if choice.rule is not None:
        overrides = (*overrides, f"planner.rule={choice.rule}")
    if choice.scenario is not None:
        return load_run(choice.scenario, overrides)
    if isinstance(own, JournalLog):
        return run_of(own.scenario(choice.rule).model_dump(mode="json"), own.path, overrides)
    if overrides:
        raise FlightError(f"{own.path}: contains no scenario; specify one with --scenario")
    return None


class Pairing(NamedTuple):
    """A flight, and a scenario with the vehicles of the flight."""

    flight: Flight
    survey: Survey
    mission: "Mission"
    scenario: Scenario
    landscape: Landscape

    @property
    def logs(self) -> tuple[str, ...]:
        """The file names of the logs."""
        return tuple(file_of(log) for log in self.flight.logs)

    @property
    def begin_us(self) -> int:
        """The start of the replayed part on the flight's clock."""
        return self.survey.begin_us

    @property
    def end_us(self) -> int:
        """The end of the replayed part on the flight's clock."""
        return self.survey.end_us


def pair(flight: Flight, found: Survey, scenario: Scenario, at_s: float | None = None) -> Pairing:
    """Pair a flight with a scenario. Raises FlightError if the two do not match."""
    mission = mission_time(flight, found, scenario, at_s)
    flown = flying(scenario_for(scenario, found, mission))
    landscape = landscape_of(flown)
    check_place(found, landscape, flown.name)
    return Pairing(flight, found, mission, flown, landscape)


class Mission(NamedTuple):
    """The relation between the log's clock and mission time."""

    begin_us: int  # start of the flight on the log's clock
    start_us: int  # start of the flight in mission time

    def of(self, log_us: int) -> int:
        """Convert a time on the log's clock to mission time."""
        return self.start_us + log_us - self.begin_us

    def log_us(self, mission_us: int) -> int:
        """Convert a mission time to the log's clock."""
        return self.begin_us + mission_us - self.start_us


def mission_time(
    flight: Flight, found: Survey, scenario: Scenario, at_s: float | None = None
) -> Mission:
    """Return the mission time at which a flight begins.

    This time is ``at_s`` if given, else computed from UTC if both log and scenario contain UTC
    times, else the time at which the scenario's vehicles take off. The times of journals are
    mission times. Raises FlightError for a flight outside the scenario's time span.
    """
    begin_us, zero = found.zero_us, scenario.time_zero
    if at_s is not None:
        return Mission(begin_us, round(at_s * 1e6))
    if isinstance(flight.logs[0], JournalLog):
        return Mission(begin_us, begin_us)
    if zero is None or found.offset_us is None:
        return Mission(begin_us, round(max(scenario.start_s, scenario.deploy_at_s) * 1e6))
    start_us = begin_us + found.offset_us - unix_us(zero)
    if not 0 <= start_us < round(scenario.duration_s * 1e6):
        raise FlightError(
            f"the flight begins {start_us / 3.6e9:+.1f} h after time_zero of {scenario.name}, "
            f"which lasts {scenario.duration_s / 3600:.1f} h; specify the flight's start with "
            "--at, in seconds of mission time"
        )
    return Mission(begin_us, start_us)


def scenario_for(scenario: Scenario, survey: Survey, mission: Mission) -> Scenario:
    """Return the scenario with the logged vehicles, including their stacks and homes.

    The settings of a logged vehicle are those of the section with the same name, else with the same
    system id, else of the next unused section, else of the first section. Missions need no
    acceptance, and no vehicle is recalled.
    """
    if not scenario.vehicles:
        raise FlightError(f"{scenario.name} has no vehicles: add one as [[vehicles]]")
    unused = list(scenario.vehicles)
    sections: list[VehicleSection] = []
    for name, flown in survey.flown.items():
        same = [each for each in unused if each.name == name]
        same += [each for each in unused if each.system_id == flown.system_id]
        section = (same or unused or scenario.vehicles)[0]
        if section in unused:
            unused.remove(section)
        sections.append(_as_flown(section, flown))
    end_s = mission.of(survey.end_us) / 1e6 + 1.0
    return scenario.model_copy(
        update={
            "vehicles": tuple(sections),
            "only": None,
            "duration_s": max(scenario.duration_s, end_s),
            "start_s": mission.start_us / 1e6,
            "deploy_at_s": 0.0,
            "mission": scenario.mission.model_copy(update={"approval": "none"}),
        }
    )


def _as_flown(section: VehicleSection, flown: Flown) -> VehicleSection:
    update: dict[str, object] = {"name": flown.name, "endurance_s": None}
    if flown.stack is not None:
        update |= {"stack": flown.stack.name, "kind": flown.stack.kind}
    if flown.home is not None:
        update |= {"home_lat_deg": flown.home[0], "home_lon_deg": flown.home[1]}
    return section.model_copy(update=update)


def check_place(survey: Survey, landscape: Landscape, name: str) -> None:
    """Raise FlightError if no position of the flight is on the landscape."""
    for flown in survey.flown.values():
        for _, lat_deg, lon_deg, _ in flown.track:
            if landscape.contains(*landscape.xy_of_lat_lon(lat_deg, lon_deg)):
                return
    places = [flown.home for flown in survey.flown.values() if flown.home is not None]
    begin = "the logs have no position"
    if places:
        begin = f"the flight began at lat {places[0][0]:.5f}, lon {places[0][1]:.5f}"
    rows, cols = landscape.shape
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(rows / 2, cols / 2))
    raise FlightError(
        f"no position is on the landscape of {name}, which is around lat {float(lat):.5f}, lon "
        f"{float(lon):.5f}: {begin}"
    )


def fireless_scenario(survey: Survey, name: str) -> Scenario:
    """Return a scenario with level ground around all tracks, for a flight without a scenario.

    Mission time 0 is the start of the flight. A scenario requires an ignition; the ignition (in a
    corner) and the vehicles' deployment are set to a month after the flight, so that no fire burns
    and no planner makes decisions.

    Raises FlightError if the logs have no positions, or positions too close to a pole for a map.
    """
    places = [place for flown in survey.flown.values() for place in flown.track]
    if not places:
        raise FlightError("the logs have no position; specify --scenario")
    south, north = min(place[1] for place in places), max(place[1] for place in places)
    west, east = min(place[2] for place in places), max(place[2] for place in places)
    lat_deg, lon_deg = (south + north) / 2.0, (west + east) / 2.0
    if not -80.0 <= lat_deg <= 84.0:
        raise FlightError(f"lat {lat_deg:.3f} is too close to a pole for a map; specify --scenario")
    lon_m = M_PER_DEG * math.cos(math.radians(lat_deg))
    high_m = M_PER_DEG * (north - south) + 2.0 * AROUND_M
    wide_m = lon_m * (east - west) + 2.0 * AROUND_M
    cell_m = max(CELL_M, max(high_m, wide_m) / MAX_CELLS)
    rows, cols = math.ceil(high_m / cell_m), math.ceil(wide_m / cell_m)
    homes = [flown.home[2] for flown in survey.flown.values() if flown.home is not None]
    length_s = (survey.end_us - survey.zero_us) / 1e6
    # At 90 % of the distance to the corner, because the grid may be rotated by a few degrees.
    inside = 0.45
    corner_lat_deg = lat_deg + inside * rows * cell_m / M_PER_DEG
    corner_lon_deg = lon_deg - inside * cols * cell_m / lon_m
    never_s = length_s + LONG_AFTER_S
    zero = None
    if survey.offset_us is not None:
        zero = EPOCH + timedelta(microseconds=survey.zero_us + survey.offset_us)
    return Scenario(
        name=name,
        time_zero=zero,
        duration_s=length_s + 1.0,
        deploy_at_s=never_s,
        landscape=LandscapeSection(
            source="flat",
            rows=rows,
            cols=cols,
            cell_size_m=cell_m,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            elevation_m=min(max(min(homes), -500.0), 9000.0),
        ),
        ignition=(Ignition(lat_deg=corner_lat_deg, lon_deg=corner_lon_deg, at_s=never_s),),
        weather=(WeatherEntry(at_s=0.0, wind_speed_m_s=0.0, wind_from_deg=0.0),),
        planner=PlannerSection(),
        vehicles=(VehicleSection(name="any", home_lat_deg=lat_deg, home_lon_deg=lon_deg),),
    )
