"""Assigns numbers to missions and records each mission until its outcome is reported."""

import numpy as np
import shapely
from numpy.typing import NDArray

from autopilot_bridge.items import TAKEOFFS, MissionItem
from mission_service.commands import UploadMission
from mission_service.position_fix import PositionFix
from mission_service.vehicles.vehicle_state import MissionPhase, Pending, Vehicle

Floats = NDArray[np.float64]
LINE_TOLERANCE_M = 5.0
RETRY_S = 5.0  # time from a failed upload to the next one


class MissionsSent:
    """The counter of all vehicles' missions."""

    def __init__(self) -> None:
        self._next_id = 1

    def upload(
        self,
        vehicle: Vehicle,
        path_m: Floats,
        items: tuple[MissionItem, ...],
        fix: PositionFix,
        why: str,
        keeps_apart: bool = False,
        lands: bool = False,
    ) -> UploadMission:
        """Return the upload of a mission along a path (n, 2), and record it as pending.

        If ``keeps_apart``, the mission separates two vehicles; if ``lands``, it only lands. Such
        missions need no approval.
        """
        mission_id = self._next_id
        self._next_id += 1
        if len(path_m) == 1:  # the path is just the centre of a loiter
            path_m = np.array([(fix.x_m, fix.y_m), path_m[0]])
        line = shapely.simplify(shapely.LineString(path_m), LINE_TOLERANCE_M)
        takes_off = bool(items) and items[0].command in TAKEOFFS
        line = shapely.LineString(shapely.get_coordinates(line))
        sent = Pending(mission_id, line, takes_off, vehicle.due, lands=lands)
        vehicle.enter(MissionPhase.UPLOADING, sent)
        vehicle.uploaded_at_s = fix.at_s
        vehicle.due = ""
        return UploadMission(vehicle.name, mission_id, why, items, keeps_apart, lands)
