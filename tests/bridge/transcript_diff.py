"""Finds differences between two exchanges, apart from allowed ones."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from autopilot_bridge.mock.autopilot import MockAutopilot

# Only these differences are allowed. On the ground: (1) the order between texts, progress and
# replies, which wait in different queues: each of the three is compared separately; for
# MISSION_CURRENT only the content is compared, because PX4's two links differ in number and time;
# (2) one repetition more or less of an unanswered request; (3) texts of the estimator and the
# arming checks, and texts that are sent again when link B connects; (4) the running number of a
# text; (5) ArduPilot's home position, by centimetres; (6) the last digit of numbers in single
# precision. In flight also: (7) the time at which a place is reached, because the mock flies at its
# own speed: messages that were sent after a progress report are sent after the same report of the
# mock; (8) texts that do not concern the mission, and the distance at which a waypoint was passed;
# (9) PX4's second acknowledgement of a mode change, and the number of its reports of a reached
# item.
FLIGHT_TEXTS = ("Mission:", "Flight plan", "Auto mission changed", "No valid mission")
EXCHANGE = (
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_ACK",
    "COMMAND_ACK",
)
PROGRESS = ("MISSION_CURRENT", "MISSION_ITEM_REACHED")
OTHER_TEXTS = ("PreArm", "EKF")
RUNNING = ("id", "chunk_seq")
SINGLE_PRECISION = 1e-6
PERIOD_S = 1.0  # between two MISSION_CURRENT


@dataclass(frozen=True)
class Line:
    """One message of a transcript or of the mock."""

    at_s: float
    link: str
    name: str
    fields: dict[str, Any]

    def __str__(self) -> str:
        values = " ".join(f"{name}={value}" for name, value in self.fields.items())
        return f"{self.at_s:.3f} {self.link} {self.name} {values}"


def differences(recorded: list[Line], received: list[Line], mock: MockAutopilot) -> list[str]:
    """Return the differences between the mock's replies and the autopilot's."""
    found: list[str] = []
    for link in ("A", "B"):
        expected = list(collapsed(exchange(recorded, link)))
        given = list(collapsed(exchange(received, link)))
        found += compared(expected, given, mock)
    found += compared(
        [(line, 1) for line in texts(recorded)],
        [(line, 1) for line in texts(received)],
        mock,
    )
    return found + list(_progress_differs(recorded, received))


def once(lines: list[tuple[Line, int]]) -> list[tuple[Line, int]]:
    """Remove the second of two equal acknowledgements of a command."""
    return [
        entry
        for index, entry in enumerate(lines)
        if index == 0
        or entry[0].name != "COMMAND_ACK"
        or entry[0].fields != lines[index - 1][0].fields
    ]


def progress_fault(expected: list[Line], received: list[Line]) -> str:
    """Return the recorded progress that the mock has not reported in the same order.

    Repeated reports of a reached item and of progress count once.
    """
    for name in PROGRESS:
        given = iter(_changes(received, name))
        for line in _changes(expected, name):
            if not any(ours.fields == line.fields for ours in given):
                return f"not reported in its turn: {line}"
    return ""


def _changes(lines: list[Line], name: str) -> list[Line]:
    named = [line for line in lines if line.name == name]
    return [
        line
        for before, line in zip([None, *named], named, strict=False)
        if before is None or before.fields != line.fields
    ]


def exchange(lines: list[Line], link: str) -> list[Line]:
    return [line for line in lines if line.link == link and line.name in EXCHANGE]


def texts(lines: list[Line]) -> list[Line]:
    return [
        line
        for line in lines
        if line.name == "STATUSTEXT"
        and line.link == "A"
        and not line.fields["text"].startswith(OTHER_TEXTS)
    ]


def collapsed(lines: list[Line]) -> Iterator[tuple[Line, int]]:
    """Combine repeated requests into one with their number."""
    before: Line | None = None
    times = 0
    for line in lines:
        repeated = (
            before is not None
            and line.name.startswith("MISSION_REQUEST")
            and (line.name, line.fields) == (before.name, before.fields)
        )
        if before is not None and not repeated:
            yield before, times
            times = 0
        before, times = line, times + 1
    if before is not None:
        yield before, times


def compared(
    expected: list[tuple[Line, int]], given: list[tuple[Line, int]], mock: MockAutopilot
) -> list[str]:
    for index in range(max(len(expected), len(given))):
        if index >= len(expected):
            return [f"more than recorded: {given[index][0]}"]
        if index >= len(given):
            return [f"missing: {expected[index][0]}"]
        (ours, often), (theirs, times) = expected[index], given[index]
        if not _same(ours, theirs, mock):
            return [f"recorded: {ours}\n     got: {theirs}"]
        if abs(often - times) > 1:
            return [f"recorded {often} times, got {times} times: {ours}"]
    return []


def _same(expected: Line, given: Line, mock: MockAutopilot) -> bool:
    if expected.name != given.name or expected.fields.keys() != given.fields.keys():
        return False
    passed_over: tuple[str, ...] = RUNNING if expected.name == "STATUSTEXT" else ()
    fields = expected.fields
    is_item = expected.name in ("MISSION_ITEM", "MISSION_ITEM_INT")
    if is_item and mock.stack.item_0_is_home and (fields["seq"], fields["mission_type"]) == (0, 0):
        passed_over = ("x", "y", "z")
    return all(
        _same_value(value, given.fields[name])
        for name, value in fields.items()
        if name not in passed_over
    )


def _same_value(expected: Any, given: Any) -> bool:
    if expected is None:
        return isinstance(given, float) and math.isnan(given)
    if isinstance(expected, float):
        return math.isclose(expected, given, rel_tol=SINGLE_PRECISION)
    return bool(expected == given)


def _progress_differs(expected: list[Line], received: list[Line]) -> Iterator[str]:
    """Compare each recorded MISSION_CURRENT with the mock's before and after it."""
    current = [line for line in received if line.name == "MISSION_CURRENT"]
    for line in expected:
        if line.name != "MISSION_CURRENT":
            continue
        before = [ours for ours in current if 0.0 <= line.at_s + 1e-3 - ours.at_s <= PERIOD_S]
        after = [ours for ours in current if 0.0 < ours.at_s - line.at_s - 1e-3 <= PERIOD_S]
        near = [*before[-1:], *after[:1]]
        if current and all(ours.fields != line.fields for ours in near):
            yield f"recorded: {line}\n     got: {' and '.join(map(str, near)) or 'nothing'}"
            return
