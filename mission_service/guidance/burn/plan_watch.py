"""Checks a plan, or the rest of a plan in flight, against the current fire, wind and unit."""

from mission_service.guidance.burn.approved_plan import ApprovedPlan, first_danger_s
from mission_service.guidance.burn.burn_state import BurnState
from mission_service.guidance.burn.lines.line_planner import LinePlan
from mission_service.guidance.burn.plan_validity import plan_problem, wind_differs
from mission_service.ignition_plan import IgnitionPlan
from mission_service.vehicles.vehicle_state import Vehicle


def invalid_reason(
    state: BurnState,
    plan: IgnitionPlan,
    found: LinePlan | None,
    flown: ApprovedPlan | None,
    vehicle: Vehicle | None,
    at_s: float,
) -> str | None:
    """Return why a plan is no longer valid, or None.

    Args:
        state: The state of the burn.
        plan: The proposed or approved plan.
        found: The same plan as a ``LinePlan``, before its conversion to data for approval.
        flown: The plan in flight; None if no plan is being flown.
        vehicle: The vehicle; None before its first event.
        at_s: Mission time, seconds.
    """
    if plan.digest != state.unit.digest(state.burn):
        return "the burn unit, its people or its settings have changed since the plan"
    differs = wind_differs(plan, state.wind_from(at_s), state.burn)
    if differs is not None:
        return differs
    if vehicle is None or vehicle.availability.fix is None or found is None:
        return None
    fix = vehicle.availability.fix
    if flown is None:
        begins = state.situation(vehicle, fix, max(at_s, plan.begin_us / 1e6))
        return plan_problem(found, begins, state.burn) or None
    path = flown.progress.ahead(at_s)
    path[0, :3] = fix.x_m, fix.y_m, state.height_m(fix)
    danger_s = first_danger_s(path, state.air(vehicle, fix, at_s), state.fire.held)
    if danger_s is None:
        return None
    return f"the fire will be too close to the path in {max(danger_s - at_s, 0.0):.0f} s"
