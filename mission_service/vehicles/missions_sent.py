"""Missions as they go to vehicles: numbered, and noted until their outcome is known."""

import numpy as np
import shapely
from numpy.typing import NDArray
from pymavlink.dialects.v20.ardupilotmega import MAV_CMD_NAV_TAKEOFF

from autopilot_bridge.items import MissionItem
from mission_service.commands import UploadMission
from mission_service.position_fix import Here
from mission_service.vehicles.state import Pending, Vehicle

Floats = NDArray[np.float64]
LINE_TOLERANCE_M = 5.0


class MissionsSent:
    """Gives each mission its number."""

    def __init__(self) -> None:
        self._next_id = 1

    def upload(
        self,
        vehicle: Vehicle,
        path_m: Floats,
        items: tuple[MissionItem, ...],
        here: Here,
        why: str,
        keeps_apart: bool = False,
    ) -> UploadMission:
        """The upload of a mission along a path (n, 2), of which one is under way from now on.

        ``keeps_apart``: it keeps the vehicle clear of another one, and waits for no approval.
        """
        mission_id = self._next_id
        self._next_id += 1
        if len(path_m) == 1:  # a place to loiter at
            path_m = np.array([(here.x_m, here.y_m), path_m[0]])
        line = shapely.simplify(shapely.LineString(path_m), LINE_TOLERANCE_M)
        takes_off = bool(items) and items[0].command == MAV_CMD_NAV_TAKEOFF
        vehicle.pending = Pending(
            mission_id,
            shapely.LineString(shapely.get_coordinates(line)),
            takes_off,
            vehicle.due,
        )
        vehicle.uploaded_at_s = here.at_s
        vehicle.due = ""
        return UploadMission(vehicle.name, mission_id, why, items, keeps_apart)
