"""Decides when, and why, the mission of a vehicle along a front is replaced.

Other modules set a reason in ``Vehicle.due``, such as a decision to turn back, a path that is clear
again, or an operator's request. ``Renewal.why`` adds the reasons that arise from the mission
itself.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from firemodel.arrays import lengths_along
from mission_service.config.sections import MissionSection
from mission_service.position_fix import PositionFix
from mission_service.vehicles.traffic import TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle

COMPARED_SHARE = 0.25  # fraction of the horizon over which new and flown paths are compared
LEFT_SHARE = 0.4  # fraction of the horizon; a mission with less path left is replaced
CHECK_EVERY_S = 2.0
SENT_TOLERANCE_M = 10.0  # distance between the ends of the requested path and the on-board mission
CLOSE_BELOW = "another vehicle flies close below"
TURN_BACK = "turn back"


class Renewal:
    """The rule that decides when missions are replaced, for all vehicles of a run."""

    def __init__(self, settings: MissionSection, traffic: TrafficManager) -> None:
        self._settings = settings
        self._traffic = traffic
        self._observed: set[str] = set()  # vehicles that need not wait for the interval
        self._corrected: set[str] = set()  # vehicles whose complete path is to be compared

    def corrected(self, vehicle: Vehicle, at_s: float) -> None:
        """Request an immediate check of the mission after an operator has corrected the fire."""
        self._corrected.add(vehicle.name)
        vehicle.not_before_s = min(vehicle.not_before_s, at_s)

    def observed(self, vehicle: Vehicle, at_s: float) -> None:
        """Request an immediate check of the mission after a sensor has observed the fire.

        This check does not wait for ``min_upload_interval_s``.
        """
        self._observed.add(vehicle.name)
        vehicle.not_before_s = min(vehicle.not_before_s, at_s)

    def to_be_checked(self, vehicle: Vehicle, fix: PositionFix) -> bool:
        """Return whether to check the mission now; not for use during an upload or a takeoff."""
        if vehicle.due != CLOSE_BELOW and self._traffic.comes_too_low(vehicle.name):
            vehicle.due = CLOSE_BELOW
        if vehicle.proposed is not None and vehicle.due != CLOSE_BELOW:
            return False  # no check until the proposal is accepted, refused or withdrawn
        if vehicle.due == TURN_BACK and not self._traffic.may_turn_back(vehicle.name):
            return False
        if not vehicle.due and fix.at_s < vehicle.not_before_s:
            return False
        vehicle.not_before_s = fix.at_s + CHECK_EVERY_S
        return True

    def why_on_approach(self, vehicle: Vehicle) -> str | None:
        """Return the reason to send a mission before the front is found, or None."""
        if vehicle.flown_line is not None and not vehicle.due:
            return None
        return vehicle.due or "fly to the fire"

    def why_sent(self, vehicle: Vehicle, path_m: NDArray[np.float64]) -> str | None:
        """Return the reason to send the mission along ``path_m`` (n, 2); None if it is on board."""
        if vehicle.flown_line is None:
            return "no confirmed mission on board"
        if vehicle.due:
            return vehicle.due
        ends = shapely.Point(vehicle.flown_line.coords[-1])
        off_m = float(shapely.distance(ends, shapely.Point(path_m[-1])))
        return "relief" if off_m > SENT_TOLERANCE_M else None

    def is_open(self, vehicle: Vehicle, fix: PositionFix) -> bool:
        """Return whether the mission may be replaced now.

        The mission may be replaced for a reason in ``Vehicle.due``, after an observation by a
        sensor, or when ``min_upload_interval_s`` has passed.
        """
        since_s = fix.at_s - vehicle.uploaded_at_s
        if vehicle.name in self._observed:
            self._observed.remove(vehicle.name)
            return True
        return bool(vehicle.due) or since_s >= self._settings.min_upload_interval_s

    def why(self, vehicle: Vehicle, path_m: NDArray[np.float64], fix: PositionFix) -> str | None:
        """Return the reason to replace the mission with a mission along ``path_m``, or None.

        ``path_m`` (n, 2; x, y in metres) is the path of a mission that would start now.
        """
        line, horizon_m = vehicle.flown_line, self._settings.horizon_m
        if line is None:
            return "no confirmed mission on board"
        if vehicle.due:
            return vehicle.due
        along = lengths_along(path_m)
        share = 1.0 if vehicle.name in self._corrected else COMPARED_SHARE
        self._corrected.discard(vehicle.name)
        near = path_m[along <= share * horizon_m]
        if not shapely.dwithin(shapely.points(near), line, self._settings.path_tolerance_m).all():
            return "the front has left the mission's path"
        left_m = line.length - line.project(shapely.Point(fix.x_m, fix.y_m))
        if left_m < LEFT_SHARE * horizon_m:
            return "the mission is nearly completed"
        return None
