"""Derives a vehicle's phase from its state while the airspace is being cleared. Pure."""

from mission_service.commands import ClearingPhase
from mission_service.core.landings import lands_below_m
from mission_service.vehicles.availability import GOING_HOME, MISSION, named_mode
from mission_service.vehicles.clearing_state import ClearingProgress
from mission_service.vehicles.landing_state import LandingPhase
from mission_service.vehicles.vehicle_state import Vehicle

UNANSWERED_S = 5.0  # time after which an order without an answer is reported
UPLOADED_S = 15.0  # after this time another vehicle lands instead; uploads repeat lost messages
SILENT = f"it has not answered for {UNANSWERED_S:.0f} s"


def on_ground(vehicle: Vehicle) -> bool:
    """Return whether a vehicle is on the ground and disarmed, as last reported."""
    return not (vehicle.availability.armed or vehicle.availability.airborne)


def unreachable(vehicle: Vehicle) -> str:
    """Return why the service cannot command a vehicle now; "" if it can."""
    availability = vehicle.availability
    if not availability.online:
        return "its link is lost"
    if availability.taken_over:
        return f"its autopilot or pilot selected {named_mode(availability.mode)}"
    if availability.in_failsafe:
        return "its autopilot reports a failsafe"
    if not availability.position_good:
        return "it has no position fix"
    return ""


def lands_by_itself(vehicle: Vehicle) -> bool:
    """Return whether a vehicle that was ordered home descends to its landing."""
    availability = vehicle.availability
    return availability.mode in GOING_HOME and availability.height_m < lands_below_m(vehicle)


def landing_phase(vehicle: Vehicle, progress: ClearingProgress) -> ClearingPhase:
    """Return the phase of a vehicle that has been ordered to land."""
    phase = vehicle.landing_state.landing_phase
    if phase is LandingPhase.WAITING:
        holds = progress.acknowledged or vehicle.availability.mode != MISSION
        return "waiting" if holds else "ordered"
    if phase is LandingPhase.SENDING:
        return "acknowledged" if progress.acknowledged else "ordered"
    if phase is LandingPhase.APPROACH and not _flies_home(vehicle):
        return "acknowledged" if progress.acknowledged else "ordered"
    return "on its way"


def _flies_home(vehicle: Vehicle) -> bool:
    """Return whether a vehicle on its approach is flying it: by a mission or by a return."""
    is_copter = vehicle.section.kind == "copter"
    return not is_copter or vehicle.availability.mode in GOING_HOME


def waits_for_order(vehicle: Vehicle) -> bool:
    """Return whether the vehicle has been ordered to land but is not yet flying the landing."""
    phase = vehicle.landing_state.landing_phase
    if phase is LandingPhase.APPROACH:
        return not _flies_home(vehicle)
    return phase in (LandingPhase.WAITING, LandingPhase.SENDING)


def longest_answer_s(vehicle: Vehicle) -> float:
    """Return the time after which other vehicles no longer wait for an unanswered order."""
    uploads = vehicle.landing_state.landing_phase is LandingPhase.SENDING
    return UPLOADED_S if uploads else UNANSWERED_S


def unanswered(progress: ClearingProgress, phase: ClearingPhase, at_s: float) -> bool:
    """Return whether an order has had no answer for too long."""
    since_s = progress.ordered_at_s
    return phase == "ordered" and since_s is not None and at_s - since_s >= UNANSWERED_S
