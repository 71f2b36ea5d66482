"""Alarms for a receiver: when a message is due, and what it contains."""

from collections.abc import Iterable
from typing import Any

from mission_service.commands import Severity
from mission_service.config.service_section import AlarmReceiverSection
from mission_service.interfaces.notifications.alarm_dispatch import (
    FIRST_RETRY_S,
    LAST_RETRY_S,
    AlarmDispatch,
)
from mission_service.runtime.alarms.notices import Notices
from mission_service.runtime.published_states import Alarm
from mission_service.runtime.run_statistics import RunStatistics


def alarm(
    key: str = "link/hawk",
    severity: Severity = "severe",
    text: str = "lost",
    by: str = "",
    at_us: int = 0,
) -> Alarm:
    return Alarm(key, at_us, "hawk", severity, text, acknowledged_by=by)


def dispatch(**settings: Any) -> AlarmDispatch:
    return AlarmDispatch(AlarmReceiverSection(name="ann", url="json://x", **settings), "east")


def sent(found: AlarmDispatch, alarms: Iterable[Alarm], now_s: float) -> str:
    """Return the body of the message that is due and is delivered, or ""."""
    message = found.next_message(alarms, now_s)
    if message is None:
        return ""
    found.delivered(message, now_s)
    return message.body


def test_an_alarm_is_sent_once_and_then_its_end() -> None:
    found = dispatch()
    assert sent(found, [alarm()], 0.0) == "ALARM: lost"
    assert sent(found, [alarm()], 1e4) == ""
    assert sent(found, [], 1e4) == "Ended: lost"
    assert sent(found, [], 1e4) == ""


def test_alarms_are_joined_in_one_message_severe_ones_first() -> None:
    found = dispatch(min_severity="warning")
    both = [alarm("battery/hawk", "warning", "low"), alarm()]
    message = found.next_message(both, 0.0)
    assert message is not None
    assert (message.title, message.body) == ("east: 2 alarms", "ALARM: lost\nWarning: low")


def test_severity_and_kinds_select_alarms() -> None:
    warning = alarm(severity="warning")
    assert sent(dispatch(), [warning], 0.0) == ""
    assert sent(dispatch(min_severity="warning"), [warning], 0.0) == "Warning: lost"
    assert sent(dispatch(kinds=("fire_arrival", "abort")), [alarm()], 0.0) == ""
    assert sent(dispatch(kinds=("fire_arrival", "link")), [alarm()], 0.0) == "ALARM: lost"
    assert sent(dispatch(), [alarm("notification/ann")], 0.0) == ""


def test_escalation_waits_for_an_acknowledgement() -> None:
    found = dispatch(after_s=300.0)
    assert sent(found, [alarm()], 0.0) == ""
    assert sent(found, [alarm()], 299.0) == ""
    assert sent(found, [alarm()], 300.0) == "ALARM: lost"
    acknowledged = dispatch(after_s=300.0)
    assert sent(acknowledged, [alarm()], 0.0) == ""
    assert sent(acknowledged, [alarm(by="bo")], 400.0) == ""
    assert sent(acknowledged, [], 500.0) == ""  # the end of an alarm that was not sent


def test_an_alarm_is_repeated_until_it_is_acknowledged() -> None:
    found = dispatch(repeat_s=60.0)
    bodies = [sent(found, [alarm()], now_s) for now_s in (0.0, 59.0, 60.0, 119.0, 120.0)]
    assert bodies == ["ALARM: lost", "", "ALARM: lost", "", "ALARM: lost"]
    assert sent(found, [alarm(by="bo")], 500.0) == ""


def test_a_failed_message_is_tried_again_later_and_later() -> None:
    found, now_s, waits_s = dispatch(), 0.0, []
    for _ in range(8):
        assert found.next_message([alarm()], now_s) is not None
        found.failed(now_s)
        begun_s = now_s
        while found.next_message([alarm()], now_s) is None:
            now_s += 1.0
        waits_s.append(now_s - begun_s)
    assert waits_s[:3] == [FIRST_RETRY_S, 2 * FIRST_RETRY_S, 4 * FIRST_RETRY_S]
    assert waits_s[-1] == LAST_RETRY_S
    for _ in range(3000):  # ten days
        found.failed(now_s)
    assert found.next_message([alarm()], now_s + LAST_RETRY_S - 1.0) is None
    now_s += LAST_RETRY_S
    assert sent(found, [alarm()], now_s) == "ALARM: lost"


def test_an_alarm_that_begins_again_before_its_end_was_sent_is_sent_as_new() -> None:
    found = dispatch()
    sent(found, [alarm()], 0.0)
    message = found.next_message([], 1.0)
    assert message is not None
    found.failed(1.0)
    assert sent(found, [alarm()], 100.0) == "ALARM: lost"


def test_an_alarm_that_begins_again_between_two_checks_is_sent_as_new() -> None:
    found = dispatch()
    assert sent(found, [alarm()], 0.0) == "ALARM: lost"
    assert sent(found, [alarm(at_us=1, text="lost again")], 1.0) == "ALARM: lost again"
    assert sent(found, [alarm(at_us=1, text="lost again")], 2.0) == ""
    later = dispatch(after_s=300.0)
    assert sent(later, [alarm()], 0.0) == ""
    assert sent(later, [alarm()], 300.0) == "ALARM: lost"
    assert sent(later, [alarm(at_us=1)], 301.0) == "Ended: lost"
    assert sent(later, [alarm(at_us=1)], 601.0) == "ALARM: lost"


def test_an_alarm_that_becomes_severe_must_be_acknowledged_again() -> None:
    notices = Notices(0, RunStatistics((), 0, None))  # type: ignore[arg-type]
    notices.alarm("link/hawk", "weak")
    notices.acknowledge_alarm("link/hawk", "ann")
    notices.acknowledge_alarm("link/hawk", "bo")
    notices.acknowledge_alarm("other", "bo")
    assert notices.alarms["link/hawk"].acknowledged_by == "ann"
    notices.alarm("link/hawk", "weaker")
    assert notices.alarms["link/hawk"].acknowledged_by == "ann"
    notices.alarm("link/hawk", "lost", "severe")
    assert notices.alarms["link/hawk"].acknowledged_by == ""


def test_a_late_acknowledgement_may_name_an_alarm_that_has_cleared() -> None:
    notices = Notices(0, RunStatistics((), 0, None))  # type: ignore[arg-type]
    notices.alarm("link/hawk", "weak")
    notices.alarm("link/kite", "weak")
    notices.clear_alarm("link/kite")
    assert notices.active_or_cleared_alarms() == ["link/hawk", "link/kite"]
    notices.acknowledge_alarm("link/kite", "ann")
    assert notices.cleared[0].acknowledged_by == ""


def test_a_warning_that_becomes_severe_is_sent_again() -> None:
    found = dispatch(min_severity="warning")
    warning = alarm(severity="warning", text="weak")
    assert sent(found, [warning], 0.0) == "Warning: weak"
    assert sent(found, [alarm()], 1.0) == "ALARM: lost"
    assert sent(found, [alarm()], 2.0) == ""
    assert sent(found, [warning], 3.0) == ""
    assert sent(found, [], 4.0) == "Ended: weak"


def test_a_severe_alarm_that_becomes_a_warning_ends_only_when_it_is_gone() -> None:
    found = dispatch(repeat_s=60.0)
    warning = alarm(severity="warning", text="weak")
    assert sent(found, [alarm()], 0.0) == "ALARM: lost"
    message = found.next_message([warning], 1.0)
    assert message is not None
    assert (message.title, message.body) == ("east: Change of alarms", "Now a warning: weak")
    found.failed(1.0)
    assert sent(found, [warning], 1.0 + FIRST_RETRY_S) == "Now a warning: weak"
    assert sent(found, [warning], 200.0) == ""
    assert sent(found, [alarm()], 201.0) == "ALARM: lost"
    assert sent(found, [warning], 202.0) == "Now a warning: weak"
    assert sent(found, [], 203.0) == "Ended: weak"
    assert sent(found, [warning], 204.0) == ""


def test_an_alarm_that_becomes_a_warning_before_it_is_due_is_not_sent() -> None:
    found = dispatch(after_s=300.0)
    assert sent(found, [alarm()], 0.0) == ""
    assert sent(found, [alarm(severity="warning")], 1.0) == ""
    assert sent(found, [], 400.0) == ""
