"""Describes the differences between the commands of a replay and those of a journal."""

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import msgspec

from mission_service.commands import AnyCommand
from mission_service.journal.journal_file import Entry

MAX_FIELDS = 8
ABSENT = "(nothing)"


def difference_of(entry: Entry, expected: Sequence[AnyCommand]) -> str | None:
    """The difference of a line from ``expected``, the next commands of the replay; or None."""
    where = f"line {entry.line}"
    if entry.is_event:
        return f"{where}: the replay first gives {cut(expected[0])}" if expected else None
    if not expected:
        return f"{where}: the replay does not give {cut(entry.content)}"
    if entry.content != expected[0]:
        return f"{where}: {compare(entry.content, expected[0])}"
    return None


def compare(journal: object, replay: object) -> str:
    """The fields in which two commands differ, as text."""
    if type(journal) is not type(replay):
        return f"journal has {cut(journal)}, replay gives {cut(replay)}"
    found = fields_that_differ(journal, replay, MAX_FIELDS + 1)
    words = [
        f"{each['field']}: journal has {cut(each['journal'], 60)}, "
        f"replay gives {cut(each['replay'], 60)}"
        for each in found[:MAX_FIELDS]
    ]
    more = ["and more"] if len(found) > MAX_FIELDS else []
    return "; ".join([*words, *more]) or "no field differs"


def fields_that_differ(
    journal: object, replay: object, most: int = MAX_FIELDS
) -> list[dict[str, Any]]:
    """The first fields in which two commands differ, nested ones too, with both values."""
    theirs, ours = msgspec.to_builtins(journal), msgspec.to_builtins(replay)
    return list(islice(_fields(theirs["type"], theirs, ours), most))


def _fields(name: str, theirs: Any, ours: Any) -> Iterator[dict[str, Any]]:
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for key in theirs | ours:
            yield from _fields(f"{name}.{key}", theirs.get(key, ABSENT), ours.get(key, ABSENT))
    elif isinstance(theirs, list | tuple) and isinstance(ours, list | tuple):
        both = min(len(theirs), len(ours))
        for place in range(both):
            yield from _fields(f"{name}[{place}]", theirs[place], ours[place])
        for place, value in enumerate(theirs[both:], both):
            yield {"field": f"{name}[{place}]", "journal": value, "replay": ABSENT}
        for place, value in enumerate(ours[both:], both):
            yield {"field": f"{name}[{place}]", "journal": ABSENT, "replay": value}
    elif theirs != ours:
        yield {"field": name, "journal": theirs, "replay": ours}


def cut(value: object, length: int = 160) -> str:
    """A value as text of limited length."""
    text = repr(value)
    return text if len(text) <= length else text[: length - 1] + "…"
