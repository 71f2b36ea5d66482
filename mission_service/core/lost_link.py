"""Compares a vehicle's lost-link reaction with the scenario. Pure.

The service reads and compares parameters but never changes them: the alarm about a difference
contains the command that would.
"""

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.stacks.link_loss import (
    DANGEROUS,
    PHASES,
    STATION_ID,
    LinkLoss,
    changes_for,
    link_loss_of,
    missing,
)
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.commands import AnyCommand, ClearAlarm, RaiseAlarm
from mission_service.events import ParametersReported
from mission_service.vehicles.vehicle_state import Vehicle, announce

LOST_LINK = "lost_link"


def reaction_of(event: ParametersReported) -> LinkLoss | None:
    """Return the reaction to a lost link; None if a parameter that determines it is missing."""
    stack = stack_named(*event.stack.split())
    if missing(stack, event.values):
        return None
    return link_loss_of(stack, event.values, event.station_id)


def reaction_compared(vehicle: Vehicle, event: ParametersReported) -> list[AnyCommand]:
    """Announce the reaction, and raise or clear the alarm about it.

    The alarm is raised if the reaction differs from the vehicle's key ``lost_link``, if a parameter
    has an undefined or dangerous value, or if the key is given but the reaction is unknown.
    """
    loss, wanted = reaction_of(event), vehicle.section.lost_link
    vehicle.lost_link_problem = ""
    if loss is None:
        vehicle.lost_link = ""
        absent = missing(stack_named(*event.stack.split()), event.values)
        words = f"its reaction to a lost link is unknown: no reply for {', '.join(absent)}"
        if wanted is None:
            return [announce(vehicle, words), ClearAlarm(vehicle.name, LOST_LINK)]
        vehicle.lost_link_problem = words
        return [announce(vehicle, words, warning=True), _alarm(vehicle, words)]
    vehicle.lost_link = str(loss)
    words = f"if the link is lost, it {loss}{_limits(loss)}"
    problems = list(loss.warnings)
    if wanted is not None and not loss.satisfies(wanted):
        problems.append(f'lost_link = "{wanted}" in the scenario: {_remedy(vehicle, event)}')
    if not problems:
        return [announce(vehicle, words), ClearAlarm(vehicle.name, LOST_LINK)]
    words = vehicle.lost_link_problem = "; ".join((f"if the link is lost, it {loss}", *problems))
    dangerous = any(loss.ends_in(phase) in DANGEROUS for phase in PHASES)
    return [announce(vehicle, words, warning=True), _alarm(vehicle, words, dangerous)]


def _alarm(vehicle: Vehicle, words: str, severe: bool = False) -> RaiseAlarm:
    return RaiseAlarm(vehicle.name, LOST_LINK, words, "severe" if severe else "warning")


def _limits(loss: LinkLoss) -> str:
    """Return the return height and the fence-breach reaction in words."""
    height = "" if loss.return_height_m is None else f"; return height {loss.return_height_m:g} m"
    return f"{height}; fence: {loss.fence}"


def _remedy(vehicle: Vehicle, event: ParametersReported) -> str:
    """Return the command that sets the scenario's reaction, or why there is none."""
    section, wanted = vehicle.section, vehicle.section.lost_link
    assert wanted is not None
    stack = stack_named(*event.stack.split())
    try:
        changes = changes_for(stack, wanted, event.values, event.station_id)
    except BridgeError as error:
        return str(error)
    station = "" if event.station_id == STATION_ID else f" --station-id {event.station_id}"
    return (
        f"stop the service, then run mission-service lost-link set {wanted} "
        f"--link {section.link} --system-id {section.system_id}{station} "
        f"({', '.join(str(change) for change in changes)})"
    )
