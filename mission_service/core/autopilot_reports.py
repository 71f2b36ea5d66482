"""Converts an autopilot's reports to announcements and alarms for operators. Pure.

An alarm is raised when the autopilot reports the cause, and cleared when the autopilot reports the
end of the cause. Autopilots do not report that the cause of a text has ended, so the alarm about a
text is cleared ``TEXT_STANDS_S`` after the last one.
"""

from mission_service import events
from mission_service.commands import AnyCommand, ClearAlarm, RaiseAlarm, Severity
from mission_service.vehicles.availability import FAILSAFE_STATES, GOING_HOME, named_mode
from mission_service.vehicles.vehicle_state import Vehicle, announce

# MAV_SEVERITY: 0 emergency, 1 alert, 2 critical, 3 error, 4 warning, 5 notice, 6 information.
WARNING, CRITICAL = 4, 2
TEXT_STANDS_S = 60.0
# PX4's mission protocol sends these texts with severity critical after repeated requests.
OF_TRANSFERS = ("WPM:", "IGN MISSION", "Operation timeout")
# ArduPilot sends texts that end with these words with severity warning or critical.
FAILSAFE_ENDED = ("failsafe off", "failsafe cleared")
# ArduCopter sends this text with severity critical whenever the mission that it is flying changes.
OF_UPLOADS, AFTER_UPLOAD_S = "Auto mission changed, restarted command", 5.0
MODE, STATE, FENCE, ESTIMATOR, TEXT = "mode", "state", "fence", "estimator", "autopilot"
LINK_CAUSES = {  # why the link in use has changed
    "silent": "the previous link is silent",
    "loss": "the previous link loses frames",
    "recovered": "this link works again",
}
LANDED, THRUST, ONE_LINK, REMOTE_ID = "landed", "thrust", "one_link", "remote_id"
REMOTE_ID_AFTER_S = 3.0  # the module reports once a second, even after a link interruption


def reported(vehicle: Vehicle, event: events.VehicleEvent) -> list[AnyCommand]:
    """Return the announcements and alarms for an autopilot's report; none for other events."""
    match event:
        case events.AutopilotText():
            return _text(vehicle, event)
        case events.SystemStateChanged():
            severe = event.state in FAILSAFE_STATES
            words = f"its autopilot is in state {event.state}: a failsafe is active"
            return _alarm(vehicle, STATE, severe, words, "severe")
        case events.FenceStatusChanged():
            words = f"fence breached ({event.kind})" if event.kind else "fence breached"
            return _alarm(vehicle, FENCE, event.breached, words, "severe")
        case events.EstimatorStatusChanged():
            words = f"its position estimate is unhealthy: {', '.join(event.problems)}"
            return _alarm(vehicle, ESTIMATOR, not event.healthy, words, "severe")
        case events.RemoteIdChanged():
            vehicle.remote_id.state, vehicle.remote_id.text = event.state, event.text
            return []
        case events.ThrustStatusChanged():
            failed = vehicle.availability.airborne and not event.sufficient
            sinks = f"sinks at {-event.climb_m_s:g} m/s with {event.throttle_percent} % throttle"
            words = f"{sinks}: engine failure, icing or downdraught; the service sends no command"
            return _alarm(vehicle, THRUST, failed, words, "severe")
        case events.LinksReported() if len(event.links) > 1:
            return _links(vehicle, event)
        case events.LandedStateChanged(state="landing") if vehicle.availability.airborne:
            return [announce(vehicle, "landing", warning=True)]
        case events.LandedStateChanged():
            mode = vehicle.availability.mode
            # After a landing, the autopilot disarms.
            lands = mode in GOING_HOME or vehicle.landing_state.active
            down = vehicle.availability.airborne and event.state == "on ground" and not lands
            words = f"armed on the ground in {named_mode(mode)}"
            return _alarm(vehicle, LANDED, down, words, "severe")
        case _:
            return []


def taken_over(vehicle: Vehicle) -> list[AnyCommand]:
    """Announce a mode that was not ordered, and raise an alarm."""
    mode = vehicle.availability.mode
    doing = {"return": ", returning home", "land": ", landing at its position"}.get(mode, "")
    until = "no command is sent until it is back in its mission or an operator gives an order"
    words = (
        f"in {named_mode(mode)}{doing}: not ordered, selected by its autopilot or pilot; {until}"
    )
    return [announce(vehicle, words, warning=True), RaiseAlarm(vehicle.name, MODE, words, "severe")]


def back_under_control(vehicle: Vehicle) -> list[AnyCommand]:
    """Clear the alarms about a mode that was not ordered."""
    return [ClearAlarm(vehicle.name, MODE), ClearAlarm(vehicle.name, LANDED)]


def remote_id_watched(vehicle: Vehicle, required: bool, at_s: float) -> list[AnyCommand]:
    """Raise the alarm about a required Remote ID module that is not ready in flight, or clear it.

    Args:
        vehicle: The vehicle that has reported its position.
        required: Whether the scenario requires Remote ID.
        at_s: Mission time.
    """
    report = vehicle.remote_id
    if not required or not vehicle.availability.airborne or report.state == "ready":
        report.problem_since_s = None
        cleared, report.alarm = report.alarm, ""
        return [ClearAlarm(vehicle.name, REMOTE_ID)] if cleared else []
    if report.problem_since_s is None:
        report.problem_since_s = at_s
    words = f"Remote ID: {report.state_in_words}"
    if words == report.alarm or at_s - report.problem_since_s < REMOTE_ID_AFTER_S:
        return []
    report.alarm = words
    return _alarm(vehicle, REMOTE_ID, True, words, "severe")


def texts_over(vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
    """Clear the alarm about a text after ``TEXT_STANDS_S`` without another one."""
    if vehicle.text_at_s is None or at_s - vehicle.text_at_s < TEXT_STANDS_S:
        return []
    vehicle.text_at_s = None
    return [ClearAlarm(vehicle.name, TEXT)]


def _links(vehicle: Vehicle, event: events.LinksReported) -> list[AnyCommand]:
    """Announce a change of the link in use, and raise an alarm if only one link is left.

    If all links are silent, the link counts as lost, for which there is another alarm.
    """
    silent = tuple(each.link for each in event.links if each.state == "silent")
    before, vehicle.silent_links = vehicle.silent_links, silent
    commands: list[AnyCommand] = []
    if event.cause:
        sent = f"messages are now sent over {event.in_use}: {LINK_CAUSES[event.cause]}"
        commands.append(announce(vehicle, sent))
    if silent == before:
        return commands
    left = [each.link for each in event.links if each.state != "silent"]
    if not silent or not left:
        return [*commands, ClearAlarm(vehicle.name, ONE_LINK)]
    words = f"only one link is left: {', '.join(silent)} is silent"
    return [*commands, *_alarm(vehicle, ONE_LINK, True, words, "warning")]


def _text(vehicle: Vehicle, event: events.AutopilotText) -> list[AnyCommand]:
    words = f"autopilot: {event.text}"
    if event.text == OF_UPLOADS and _uploads(vehicle, event.at_us / 1e6):
        return [announce(vehicle, words)]
    if event.text.lower().endswith(FAILSAFE_ENDED):
        return [announce(vehicle, words)]
    line = announce(vehicle, words, warning=event.severity <= WARNING)
    if event.severity > WARNING or event.text.startswith(OF_TRANSFERS):
        return [line]
    vehicle.text_at_s = event.at_us / 1e6
    severity: Severity = "severe" if event.severity <= CRITICAL else "warning"
    return [line, RaiseAlarm(vehicle.name, TEXT, words, severity)]


def _uploads(vehicle: Vehicle, at_s: float) -> bool:
    """Return whether the service is uploading, or has just uploaded, a mission to the vehicle."""
    return vehicle.pending is not None or at_s - vehicle.upload_ended_at_s < AFTER_UPLOAD_S


def _alarm(
    vehicle: Vehicle, alarm: str, raised: bool, words: str, severity: Severity
) -> list[AnyCommand]:
    """Raise and announce an alarm, or clear the alarm."""
    if not raised:
        return [ClearAlarm(vehicle.name, alarm)]
    raised_alarm = RaiseAlarm(vehicle.name, alarm, words, severity)
    return [announce(vehicle, words, warning=True), raised_alarm]
