"""The importances that the perimeter planner compares, cell by cell, for display."""

from mission_service.interfaces.api.states import Importance
from mission_service.runtime.hub import Hub
from mission_service.runtime.published_states import VehicleState


def importance_of(hub: Hub, vehicle: VehicleState) -> Importance | None:
    """Importances at the vehicle's position; None before its first lap and for other rules."""
    name = vehicle.vehicle
    here = hub.core.steering.presence[name].here
    found = None if here is None else hub.core.leader.compared(name, here)
    if here is None or found is None:
        return None
    lat, lon = hub.landscape.lat_lon_of(*hub.landscape.xy_of(found.rows, found.cols))
    cells = zip(lat.tolist(), lon.tolist(), found.values.tolist(), strict=True)
    rule = hub.scenario.planner.rule
    return Importance(round(here.at_s * 1e6), name, rule, found.back, found.front, list(cells))
