"""Compares a return's straight way home with the ground below it. Pure.

Before takeoff, the pre-flight check ``return`` compares returns from the positions of the mission
on board with the ground. In flight, an alarm is active while the autopilot's own return would be
less than ``CLEARANCE_M`` above the ground. A return that the service orders is replaced by a
mission home if it would be too low (``airspace_guard.py``). The return follows when it would be
``CLEAR_AGAIN_M`` above the ground, because autopilots do not hold their altitude exactly.

PX4 and ArduCopter return at the vehicle's altitude, or first climb if it is below the parameter's
height above home; a PX4 plane ends this climb up to 10 m below that height. ArduPlane climbs or
descends to its parameter's height on the way (``rtl.cpp`` of PX4 1.17, ``mode_rtl.cpp`` of
ArduPilot 4.6.2). If the parameter is unknown, the alarm and the check assume the stack's usual
height, or for ArduPlane the current altitude. An order to return relies neither on an unknown climb
nor on a climb by ArduPlane.
"""

from collections.abc import Sequence
from typing import NamedTuple

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.airspace.occupied_space import MissionPlace, Position
from mission_service.commands import AnyCommand, ClearAlarm, HoldAt, RaiseAlarm
from mission_service.core.energy_watch import EnergyWatch
from mission_service.core.flight_space import position_of
from mission_service.core.hold_height import hold_over
from mission_service.missions.orbits import Place, highest_ground_m
from mission_service.position_fix import PositionFix
from mission_service.vehicles.endurance import climb_ends_below_m
from mission_service.vehicles.vehicle_state import Vehicle

ALARM = "return"
EVERY_S = 10.0
BESIDE_M = 15.0  # ground within this distance of the way home is considered
TERRAIN_ERROR_M = 2.0
ARDUPLANE_HEIGHT_M = 100.0  # RTL_ALTITUDE by default
CLEARANCE_M, CLEAR_AGAIN_M = 10.0, 20.0  # height above ground that raises, and clears, the alarm


class OverGround(NamedTuple):
    """The height of a straight return above the ground.

    Attributes:
        clearance_m: Height above the highest ground on the way; negative if below it.
        ground_amsl_m: Altitude above mean sea level of this ground.
        needed_above_home_m: Return height above home that gives ``CLEAR_AGAIN_M``.
    """

    clearance_m: float
    ground_amsl_m: float
    needed_above_home_m: float

    @property
    def is_too_low(self) -> bool:
        """Whether the return is less than ``CLEARANCE_M`` above the ground."""
        return self.clearance_m < CLEARANCE_M

    @property
    def remedy(self) -> str:
        """The clearance, and the return altitude to set if it is too small; otherwise ""."""
        if not self.is_too_low:
            return ""
        side = "above" if self.clearance_m >= 0.0 else "below"
        return (
            f"{abs(self.clearance_m):.0f} m {side} the highest ground on the way home "
            f"({self.ground_amsl_m:.0f} m AMSL): set the return altitude to at least "
            f"{self.needed_above_home_m:.0f} m above home"
        )


class ReturnGround:
    """The comparison of each vehicle's way home with the ground below it."""

    def __init__(self, landscape: Landscape, energy: EnergyWatch) -> None:
        self._landscape = landscape
        self._energy = energy
        self._from_mission: dict[str, tuple[object, OverGround | None]] = {}
        self._next_s: dict[str, float] = {}
        self._raised: set[str] = set()

    def at_position(
        self, vehicle: Vehicle, event: events.Telemetry, goal_m: Place
    ) -> list[AnyCommand]:
        """Raise or clear the alarm of a vehicle that has reported its position.

        ``goal_m`` is the position (x, y) to which the return leads directly.
        """
        at_s, fix = event.at_us / 1e6, vehicle.availability.fix
        if not vehicle.availability.airborne or fix is None or self._landscape.elevation_m is None:
            return self._cleared(vehicle.name)
        if at_s < self._next_s.get(vehicle.name, at_s):
            return []
        self._next_s[vehicle.name] = at_s + EVERY_S
        found = self._expected(vehicle, position_of(fix), goal_m, _home_amsl_m(vehicle, fix))
        if vehicle.name in self._raised:
            return self._cleared(vehicle.name) if found.clearance_m >= CLEAR_AGAIN_M else []
        if not found.is_too_low:
            return []
        self._raised.add(vehicle.name)
        words = f"its autopilot's return would be {found.remedy}"
        if not vehicle.section.is_arduplane:
            words += ", or fly higher"
        return [RaiseAlarm(vehicle.name, ALARM, words, "severe")]

    def obstacle(
        self, vehicle: Vehicle, fix: PositionFix, goal_m: Place, needed_m: float = CLEARANCE_M
    ) -> str | None:
        """Return the airspace above ground that a straight return would enter, in words, or None.

        A return needs the clearance ``needed_m``, but no more than the vehicle's current clearance
        minus ``TERRAIN_ERROR_M``.
        """
        if self._landscape.elevation_m is None:
            return None
        home_amsl_m = _home_amsl_m(vehicle, fix)
        return_amsl_m = self._sure_amsl_m(vehicle, fix.altitude_m, home_amsl_m)
        found = self._over_ground(position_of(fix), goal_m, return_amsl_m, home_amsl_m)
        here_agl_m = fix.altitude_m - float(self._landscape.elevation_at(fix.x_m, fix.y_m))
        if found.clearance_m >= min(needed_m, here_agl_m - TERRAIN_ERROR_M):
            return None
        return f"the airspace just above terrain at {found.ground_amsl_m:.0f} m AMSL"

    def climb(self, vehicle: Vehicle, fix: PositionFix, goal_m: Place) -> HoldAt | None:
        """Return the higher hold from which a return is clear of the ground, or None.

        The result is None if the vehicle is high enough or its return would descend again.
        """
        home_amsl_m = _home_amsl_m(vehicle, fix)
        over = self._over_ground(position_of(fix), goal_m, fix.altitude_m, home_amsl_m)
        needed_amsl_m = round(over.ground_amsl_m + CLEAR_AGAIN_M, 1)
        stays_high = self._sure_amsl_m(vehicle, needed_amsl_m, home_amsl_m) >= needed_amsl_m
        if fix.altitude_m >= needed_amsl_m or not stays_high:
            return None
        return hold_over((fix.x_m, fix.y_m), needed_amsl_m, vehicle.name, self._landscape)

    def from_mission(
        self, vehicle: Vehicle, places: Sequence[MissionPlace], goal_m: Place
    ) -> OverGround | None:
        """Return the least clearance of returns from the positions of a mission.

        The result is None without positions, a position fix or elevations.
        """
        fix = vehicle.availability.fix
        if fix is None or self._landscape.elevation_m is None:
            return None
        home_amsl_m = _home_amsl_m(vehicle, fix)
        given = (tuple(places), goal_m, vehicle.return_flight, round(home_amsl_m))
        before, found = self._from_mission.get(vehicle.name, (None, None))
        if given != before:
            each = (self._expected(vehicle, one.position, goal_m, home_amsl_m) for one in places)
            found = min(each, key=lambda one: one.clearance_m, default=None)
            self._from_mission[vehicle.name] = given, found
        return found

    def _expected(
        self, vehicle: Vehicle, start: Position, goal_m: Place, home_amsl_m: float
    ) -> OverGround:
        """Return the clearance that a return is expected to have after its climb or descent."""
        section, return_amsl_m = vehicle.section, start[2]
        known_m = self._energy.known_return_height_m(vehicle)
        at_current_height = vehicle.return_flight.at_current_height
        if not (at_current_height or (section.is_arduplane and known_m is None)):
            height_amsl_m = home_amsl_m + self._energy.return_height_m(vehicle)
            height_amsl_m -= climb_ends_below_m(section)
            return_amsl_m = (
                height_amsl_m if section.is_arduplane else max(return_amsl_m, height_amsl_m)
            )
        found = self._over_ground(start, goal_m, return_amsl_m, home_amsl_m)
        needed_m = found.needed_above_home_m + climb_ends_below_m(section)
        return found._replace(needed_above_home_m=needed_m)

    def _sure_amsl_m(self, vehicle: Vehicle, altitude_m: float, home_amsl_m: float) -> float:
        """Return the altitude that a return from a given altitude is sure to keep all the way."""
        if vehicle.return_flight.at_current_height:
            return altitude_m
        known_m = self._energy.known_return_height_m(vehicle)
        if vehicle.section.is_arduplane:
            height_m = ARDUPLANE_HEIGHT_M if known_m is None else known_m
            return min(altitude_m, home_amsl_m + height_m)
        if known_m is None:
            return altitude_m
        return max(altitude_m, home_amsl_m + known_m - climb_ends_below_m(vehicle.section))

    def _over_ground(
        self, start: Position, goal_m: Place, return_amsl_m: float, home_amsl_m: float
    ) -> OverGround:
        """Return the height above ground of a straight return at an altitude."""
        ground_m = highest_ground_m(self._landscape, start[:2], goal_m, BESIDE_M)
        needed_m = ground_m + CLEAR_AGAIN_M - home_amsl_m
        return OverGround(return_amsl_m - ground_m, ground_m, needed_m)

    def _cleared(self, name: str) -> list[AnyCommand]:
        self._next_s.pop(name, None)
        if name not in self._raised:
            return []
        self._raised.discard(name)
        return [ClearAlarm(name, ALARM)]


def _home_amsl_m(vehicle: Vehicle, fix: PositionFix) -> float:
    """Return the altitude of home according to the altitudes reported by the autopilot."""
    return fix.altitude_m - vehicle.availability.height_m
