"""The importances that the perimeter planner compares, cell by cell, for display."""

import numpy as np

from mission_service.guidance.fire_map import BEARINGS
from mission_service.guidance.front.following import bearing_deg
from mission_service.guidance.front.front_shape import ring_of_cells
from mission_service.guidance.front.importance import window_importance
from mission_service.guidance.front.perimeter import PerimeterPlanner
from mission_service.interfaces.api.states import Importance
from mission_service.runtime.hub import Hub
from mission_service.runtime.picture import VehicleState


def importance_of(hub: Hub, vehicle: VehicleState) -> Importance | None:
    """Importances at the vehicle's position; None before its first lap and for other rules."""
    name = vehicle.vehicle
    planner = getattr(hub.core.leader, "planners", {}).get(name)
    here = hub.core.steering.presence[name].here
    if not isinstance(planner, PerimeterPlanner) or planner.phase != "monitor" or here is None:
        return None
    values = planner.importance(here.row, here.col, here.at_s)
    north, east, _ = ring_of_cells(
        planner.shape(here.row, here.col),
        round(bearing_deg(planner.map, here.row, here.col)) % BEARINGS,
        planner.clockwise,
    )
    land, centre = hub.landscape, planner.map
    lat, lon = land.lat_lon_of(
        *land.xy_of(centre.centre_row - np.asarray(north), centre.centre_col + np.asarray(east))
    )
    back, front = window_importance(values)
    cells = zip(lat.tolist(), lon.tolist(), values.tolist(), strict=True)
    rule = hub.scenario.planner.rule
    return Importance(round(here.at_s * 1e6), name, rule, back, front, list(cells))
