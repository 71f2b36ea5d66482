"""Returns the importances of front cells that the perimeter planner compares, for display."""

from mission_service.interfaces.api.models import Importance
from mission_service.runtime.published_states import VehicleState
from mission_service.runtime.run_context import RunContext


def importance_of(context: RunContext, vehicle: VehicleState) -> Importance | None:
    """Return the importance of each front cell for a vehicle at its current position.

    Returns None before the vehicle's first lap, and for rules that use no importances.
    """
    name = vehicle.vehicle
    fix = context.core.decision_engine.availability[name].fix
    found = None if fix is None else context.core.guidance.compared(name, fix)
    if fix is None or found is None:
        return None
    lat, lon = context.landscape.lat_lon_of(*context.landscape.xy_of(found.rows, found.cols))
    cells = zip(lat.tolist(), lon.tolist(), found.values.tolist(), strict=True)
    rule = context.scenario.planner.rule
    return Importance(round(fix.at_s * 1e6), name, rule, found.back, found.front, list(cells))
