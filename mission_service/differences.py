"""How what a replay gives differs from a journal, in words."""

from collections import deque

import msgspec

from mission_service.commands import AnyCommand
from mission_service.journal import Entry


def difference_of(entry: Entry, expected: deque[AnyCommand]) -> str | None:
    """What is wrong with a line, if ``expected`` are the commands still to come; or None."""
    altered = "" if entry.intact else " (its checksum does not match: the line was altered)"
    where = f"line {entry.line}{altered}"
    if entry.is_event:
        if expected:
            return f"{where}: the replay first gives {cut(expected[0])}"
        return None if entry.intact else f"{where}: event {cut(entry.content)}"
    if not expected:
        return f"{where}: the replay does not give {cut(entry.content)}"
    if entry.content != expected[0]:
        return f"{where}: {compare(entry.content, expected[0])}"
    return None if entry.intact else f"{where}: command {cut(entry.content)}"


def compare(journal: object, replay: object) -> str:
    """The first field in which two commands differ, in words."""
    ours, theirs = msgspec.to_builtins(replay), msgspec.to_builtins(journal)
    if ours["type"] != theirs["type"]:
        return f"journal has {cut(journal)}, replay gives {cut(replay)}"
    for key in ours:
        if ours[key] != theirs[key]:
            return (
                f"{ours['type']}.{key}: journal has {cut(theirs[key])}, "
                f"replay gives {cut(ours[key])}"
            )
    return "no field differs"


def cut(value: object, length: int = 160) -> str:
    """A value in words, not too long."""
    text = repr(value)
    return text if len(text) <= length else text[: length - 1] + "…"
