"""Holds the state of a burn (unit, fire, spheres, remaining area) and plans the next line."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from mission_service.commands import REJECTED
from mission_service.config.sections import BurnSection, VehicleSection
from mission_service.errors import MissionServiceError
from mission_service.events import BurnUnitSet, PersonReported, PlanRequested
from mission_service.fire.estimated_fire import EstimatedFire, toward
from mission_service.guidance.burn.burn_unit import ExclusionCircle, burn_unit_of
from mission_service.guidance.burn.lines.flight_constraints import FlightConstraints
from mission_service.guidance.burn.lines.hazard import hazard_of
from mission_service.guidance.burn.lines.line_planner import (
    LinePlan,
    NoPlan,
    Situation,
    constraints_of,
    next_line,
)
from mission_service.guidance.burn.plan_mission import plan_points
from mission_service.guidance.burn.plan_validity import WindFrom, drift_compensated
from mission_service.guidance.burn.sphere_account import PointXY, SphereAccount
from mission_service.ignition_plan import IgnitionPlan, PlannedDrop
from mission_service.position_fix import PositionFix
from mission_service.vehicles.vehicle_state import Vehicle

# Planning adds these values to the margins, because a flight deviates from its plan. The checks in
# flight use the margins without these additions.
SLACK_S, SLACK_M = 20.0, 3.0
AROUND_M = 12.0  # fire within this radius of home and of the vehicle is also monitored
NO_FIRE_S = 86400.0  # time margin of a path that no fire approaches


class BurnState:
    """The state of a burn, with methods that apply operators' input and plan the next line.

    Heights are above the ground.
    """

    def __init__(
        self,
        burn: BurnSection,
        landscape: Landscape,
        weather: WeatherStream,
        vehicle: VehicleSection,
    ) -> None:
        """Create the state of a burn. Raises MissionServiceError if the unit or home is invalid."""
        self.burn, self.landscape = burn, landscape
        self.unit = burn_unit_of(burn, landscape, (vehicle.home_lat_deg, vehicle.home_lon_deg))
        self.fire = EstimatedFire(burn, landscape, weather)
        self.account = SphereAccount(burn.spheres)
        self.area_left: Any = self.unit.area
        self.line = 1
        self._above_map_m = 0.0
        self._air: tuple[int, FlightConstraints] | None = None

    # Inputs -----------------------------------------------------------------------------------

    def unit_reported(self, event: PersonReported | BurnUnitSet) -> None:
        """Apply a changed unit or a reported person.

        Raises MissionServiceError if the changed unit is invalid, or if an operator reports the
        departure of a person who had not been reported.
        """
        if isinstance(event, BurnUnitSet):
            unit = burn_unit_of(self.burn, self.landscape, corners=event.points)
            self.unit = unit.with_people(self.unit.people)
            self.area_left = shapely.intersection(self.area_left, unit.area)
        else:
            place = self.landscape.xy_of_lat_lon(event.lat_deg, event.lon_deg)
            people = [each for each in self.unit.people if each.name != event.name]
            if event.radius_m > 0:
                people.append(ExclusionCircle(event.name, *place, event.radius_m))
            elif len(people) == len(self.unit.people):
                names = ", ".join(each.name for each in people) or "none"
                raise MissionServiceError(
                    f"the unit contains no person named {event.name!r}; its people are {names}"
                )
            self.unit = self.unit.with_people(tuple(people))
        self._air = None

    def set_spacings(self, event: PlanRequested) -> str | None:
        """Change the spacings of lines and drops; return why the change is rejected, or None."""
        line_m = event.line_spacing_m or self.burn.line_spacing_m
        drop_m = event.drop_spacing_m or self.burn.drop_spacing_m
        min_spacing_m = self.burn.speed_m_s * 60.0 / self.burn.max_drops_per_min
        if drop_m < min_spacing_m or line_m <= 0.0:
            return f"{REJECTED} drops must be at least {min_spacing_m:g} m apart"
        changed = {"line_spacing_m": line_m, "drop_spacing_m": drop_m}
        self.burn = self.burn.model_copy(update=changed)
        return None

    def calibrate_altitude(self, fix: PositionFix) -> None:
        """Set the autopilot's altitude minus the landscape's, using a fix on the ground."""
        self._above_map_m = round(fix.altitude_m - self._ground_m(fix), 1)

    # Outputs ----------------------------------------------------------------------------------

    def wind_from(self, at_s: float) -> WindFrom:
        """Return the estimated wind: speed in m/s, and direction (deg) from which it blows."""
        weather = self.fire.weather_at(at_s)
        return weather.wind_speed_m_s, weather.wind_from_deg

    def wind_m_s(self, at_s: float) -> tuple[float, float]:
        """Return the estimated wind as a velocity on the grid, with x and y in m/s."""
        return toward(self.landscape, *self.wind_from(at_s))

    def height_m(self, fix: PositionFix) -> float:
        """Return the vehicle's height above the ground."""
        return fix.altitude_m - self._ground_m(fix) - self._above_map_m

    def altitude_m(self, fix: PositionFix, height_m: float) -> float:
        """Return the autopilot's altitude for a height above the ground at a position."""
        return self._ground_m(fix) + self._above_map_m + height_m

    def _ground_m(self, fix: PositionFix) -> float:
        return float(self.landscape.elevation_at(fix.x_m, fix.y_m))

    def lat_lon(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return the latitude and longitude of a position, rounded to 1e-7 deg as in MAVLink."""
        lat_deg, lon_deg = self.landscape.lat_lon_of(x_m, y_m)
        return round(float(lat_deg), 7), round(float(lon_deg), 7)

    def map_shapes(self) -> dict[str, Any]:
        """Return the unit's areas (rings of lat, lon) and the circles around people for display."""
        unit = self.unit
        return {
            "unit": self._rings(unit.area),
            "no_drop": self._rings(unit.no_drop),
            "fence": [] if unit.fence is None else self._rings(unit.fence),
            "people": [
                (person.name, *self.lat_lon(person.x_m, person.y_m), person.radius_m)
                for person in unit.people
            ],
        }

    def _rings(self, shape: BaseGeometry) -> list[list[tuple[float, float]]]:
        rings = shapely.get_rings(shapely.get_parts(shape))
        return [
            [self.lat_lon(*corner) for corner in shapely.get_coordinates(ring)] for ring in rings
        ]

    def situation(self, vehicle: Vehicle, fix: PositionFix, at_s: float) -> Situation:
        """Return the situation at the start of a vehicle's plan, which begins at ``at_s``."""
        place_m = (fix.x_m, fix.y_m)
        if not vehicle.availability.airborne:
            return self.situation_from(place_m, 0.0, 0.0, vehicle.home_m, at_s)
        flown_s = fix.at_s - vehicle.availability.took_off_at_s
        return self.situation_from(place_m, self.height_m(fix), flown_s, vehicle.home_m, at_s)

    def situation_from(
        self, place_m: PointXY, height_m: float, flown_s: float, home_m: PointXY, at_s: float
    ) -> Situation:
        """Return the situation for a vehicle at ``place_m`` that has flown for ``flown_s``."""
        east, north = self.wind_m_s(at_s)
        return Situation(
            unit=self.unit,
            area=self.area_left,
            dropped_m=np.array(self.account.fallen_m()).reshape(-1, 2),
            fire=self.fire.simulation,
            lights=self.fire.lights,
            at_s=at_s,
            x_m=place_m[0],
            y_m=place_m[1],
            height_m=height_m,
            wind_m_s=math.hypot(east, north),
            toward_rad=math.atan2(north, east),
            spheres=self.account.left,
            battery_s=self.burn.battery_s - flown_s,
            home_m=home_m,
        )

    def air(self, vehicle: Vehicle, fix: PositionFix, at_s: float) -> FlightConstraints:
        """Return the constraints on a flight, based on the current estimate of the fire."""
        if self._air is None or self._air[0] != self.fire.version:
            air = constraints_of(self.situation(vehicle, fix, at_s), self.burn)
            # Plans cover the unit only; flights are monitored from takeoff at home.
            places = shapely.MultiPoint([vehicle.home_m, (fix.x_m, fix.y_m)])
            box = shapely.union(self.unit.area, places.buffer(AROUND_M)).bounds
            hazard = hazard_of(self.fire.simulation, box, air.hazard.margins)
            self._air = (self.fire.version, replace(air, hazard=hazard))
        return self._air[1]

    def next_plan(
        self, vehicle: Vehicle, fix: PositionFix, begin_s: float
    ) -> tuple[LinePlan, IgnitionPlan] | NoPlan:
        """Plan the next line; return a ``LinePlan`` and the ``IgnitionPlan`` for its approval.

        Returns a ``NoPlan`` if no line can be planned.
        """
        wider = {
            "time_margin_s": self.burn.time_margin_s + SLACK_S,
            "distance_margin_m": self.burn.distance_margin_m + SLACK_M,
        }
        situation = self.situation(vehicle, fix, begin_s)
        found = next_line(situation, self.burn.model_copy(update=wider))
        if isinstance(found, NoPlan):
            return found
        found = drift_compensated(found, situation, self.burn)
        return found, self._ignition_plan(found, vehicle.name, fix.at_s, begin_s)

    def _ignition_plan(
        self, found: LinePlan, name: str, at_s: float, begin_s: float
    ) -> IgnitionPlan:
        wind_speed_m_s, wind_from_deg = self.wind_from(begin_s)
        return IgnitionPlan(
            vehicle=name,
            line=self.line,
            made_at_us=round(at_s * 1e6),
            begin_us=round(begin_s * 1e6),
            valid_until_us=round((begin_s + self.burn.approval_s) * 1e6),
            path=plan_points(found.path, self.landscape, self._above_map_m),
            drops=tuple(
                PlannedDrop(number, *self.lat_lon(x_m, y_m), round(after_s, 3))
                for number, (x_m, y_m, after_s) in enumerate(found.drops.tolist())
            ),
            skipped=tuple(self.lat_lon(x_m, y_m) for x_m, y_m in found.skipped.tolist()),
            duration_s=round(found.duration_s, 3),
            speed_m_s=self.burn.speed_m_s,
            drop_height_m=self.burn.drop_height_m,
            safe_height_m=self.burn.safe_height_m,
            wind_speed_m_s=wind_speed_m_s,
            wind_from_deg=wind_from_deg,
            time_margin_s=self.burn.time_margin_s,
            distance_margin_m=self.burn.distance_margin_m,
            min_time_margin_s=min(round(found.min_time_margin_s, 1), NO_FIRE_S),
            spheres_left=found.spheres_left,
            digest=self.unit.digest(self.burn),
        )
