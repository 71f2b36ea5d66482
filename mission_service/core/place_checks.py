"""Checks orbits, climbs and holds at given places against closed airspace. Pure."""

import math
from collections.abc import Mapping
from dataclasses import replace

import msgspec
import shapely

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.clearance import Airspace
from mission_service.airspace.occupied_space import Part, path_parts
from mission_service.commands import AnyCommand, ClimbAndHold, HoldAt, Orbit
from mission_service.core.airspace_evasions import Evasions
from mission_service.core.flight_space import FlightSpace, position_of
from mission_service.core.hold_height import RAISED_HOLD_AGL_M, circle_ground_m
from mission_service.position_fix import PositionFix
from mission_service.vehicles.airspace_state import AirspaceState, raised
from mission_service.vehicles.vehicle_state import Vehicle


class PlaceChecks:
    """The checks of commands that lead to a place."""

    def __init__(
        self,
        landscape: Landscape,
        space: FlightSpace,
        evasions: Evasions,
        states: Mapping[str, AirspaceState],
    ) -> None:
        self._landscape = landscape
        self._space = space
        self._evasions = evasions
        self._states = states

    def checked(
        self, vehicle: Vehicle, command: Orbit | ClimbAndHold | HoldAt, airspace: Airspace
    ) -> list[AnyCommand]:
        """Return the command or a free one in its place; an orbit that is not free is not sent."""
        fix, state = vehicle.availability.fix, self._states[vehicle.name]
        if fix is None:
            return [command]
        place = self._space.of_hold_at(vehicle, command)
        x_m, y_m = self._landscape.xy_of_lat_lon(command.lat_deg, command.lon_deg)
        target = (float(x_m), float(y_m), command.altitude_amsl_m)
        parts = [*path_parts([position_of(fix), target]), place]
        if isinstance(command, HoldAt):  # a descent from above the altitude limit is free
            airspace = replace(airspace, max_altitude_agl_m=None)
        conflict = airspace.conflict(parts, self._landscape, position_of(fix))
        if conflict is not None and isinstance(command, Orbit):
            words = f"no orbit is ordered: it would enter {conflict}"
            return raised(vehicle, state, words)
        if conflict is not None and isinstance(command, HoldAt):
            if target[2] > fix.altitude_m and math.dist(target[:2], (fix.x_m, fix.y_m)) < 1.0:
                return self._raised_hold(vehicle, fix, command, place, airspace, conflict)
            return self._freed_hold(vehicle, fix, command, airspace, conflict)
        state.orbit = place
        return [command]  # a climb away from flames takes priority

    def _raised_hold(
        self,
        vehicle: Vehicle,
        fix: PositionFix,
        command: HoldAt,
        place: Part,
        airspace: Airspace,
        conflict: str,
    ) -> list[AnyCommand]:
        """Return a hold, raised to clear the ground, that replaces a hold in closed airspace.

        The result is the first of these that is free: 40 m above the ground under its circle,
        rather than the ground within twice its reach; in the vertical margin of a volume above; at
        the nearest free place over ground that is not higher. If none is free, the vehicle holds
        in closed airspace, with a severe alarm.
        """
        low_m = circle_ground_m(vehicle, self._landscape) + RAISED_HOLD_AGL_M
        low_m = round(max(min(low_m, command.altitude_amsl_m), fix.altitude_m), 1)
        lower = msgspec.structs.replace(command, altitude_amsl_m=low_m)
        below = _below_volumes(command, place, airspace, fix, low_m)
        to_volumes = replace(airspace, margins=replace(airspace.margins, vertical_m=0.0))
        vehicle.hold_at = None
        for hold, limits in ((lower, airspace), (below, to_volumes)):
            circle = self._space.of_hold_at(vehicle, hold)
            column = replace(circle, lowest_m=fix.altitude_m)
            if limits.conflict([column], self._landscape, position_of(fix)) is None:
                return [hold]
        free = self._evasions.free_place(vehicle, fix, command, airspace)
        if free is not None:
            return [self._held_at(vehicle, free)]
        words = f"holds although it enters {conflict}: every other hold is too near the ground"
        return [*raised(vehicle, self._states[vehicle.name], words, "severe"), below]

    def _freed_hold(
        self,
        vehicle: Vehicle,
        fix: PositionFix,
        command: HoldAt,
        airspace: Airspace,
        conflict: str,
    ) -> list[AnyCommand]:
        """Return a hold outside closed airspace in place of a descent that would enter it."""
        free = self._evasions.free_hold(vehicle, fix, command, airspace)
        if isinstance(free, HoldAt):
            return [self._held_at(vehicle, free)]
        vehicle.hold_at = None
        stays = self._space.of_hold(vehicle, position_of(fix))
        if airspace.conflict([stays], self._landscape) is None:
            return [free]
        words = f"holds at its position: every lower hold would enter {conflict}"
        return [*raised(vehicle, self._states[vehicle.name], words, "severe"), free]

    def _held_at(self, vehicle: Vehicle, command: HoldAt) -> HoldAt:
        """Record the place of a hold that replaces an ordered one, and return this hold."""
        vehicle.hold_at = (command.lat_deg, command.lon_deg, command.altitude_amsl_m)
        self._states[vehicle.name].orbit = self._space.of_hold_at(vehicle, command)
        return command


def _below_volumes(
    command: HoldAt, place: Part, airspace: Airspace, fix: PositionFix, low_m: float
) -> HoldAt:
    """Return a hold raised above the ground, in a volume's vertical margin if necessary.

    ``low_m`` is the altitude at which the hold clears the ground under its circle. Volumes that
    begin no higher than ``low_m`` less the vertical margin are ignored, because a hold below them
    would be too near the ground.
    """
    floors_m = [
        volume.floor_m
        for volume in airspace.volumes
        if volume.floor_m > low_m - airspace.margins.vertical_m
        and shapely.dwithin(volume.area_m, place.shape, airspace.margins.horizontal_m)
    ]
    below_m = min([command.altitude_amsl_m, *(up - 1.0 for up in floors_m)])
    altitude_m = round(max(below_m, fix.altitude_m), 1)
    return msgspec.structs.replace(command, altitude_amsl_m=altitude_m)
