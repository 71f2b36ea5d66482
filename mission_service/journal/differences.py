"""Describes differences between the commands of a replay and those of a journal."""

from collections.abc import Iterator, Sequence
from itertools import islice, zip_longest
from typing import Any

import msgspec

from mission_service.commands import AnyCommand
from mission_service.journal.journal_file import Entry

MAX_FIELDS = 8
ABSENT = "(absent)"


def difference_of(entry: Entry, expected: Sequence[AnyCommand]) -> str | None:
    """Return the difference between a line and the replay's next commands ``expected``, or None."""
    place = f"line {entry.line}"
    if entry.is_event:
        return f"{place}: the replay issues {cut(expected[0])} before it" if expected else None
    if not expected:
        return f"{place}: the replay does not issue {cut(entry.content)}"
    if entry.content != expected[0]:
        return f"{place}: {compare(entry.content, expected[0])}"
    return None


def compare(journal: object, replay: object) -> str:
    """Return the fields in which two commands differ, as text."""
    if type(journal) is not type(replay):
        return f"journal has {cut(journal)}, replay has {cut(replay)}"
    found = fields_that_differ(journal, replay, MAX_FIELDS + 1)
    words = [
        f"{each['field']}: journal has {cut(each['journal'], 60)}, "
        f"replay has {cut(each['replay'], 60)}"
        for each in found[:MAX_FIELDS]
    ]
    more = ["and more"] if len(found) > MAX_FIELDS else []
    return "; ".join([*words, *more]) or "no field differs"


def fields_that_differ(
    journal: object, replay: object, most: int = MAX_FIELDS
) -> list[dict[str, Any]]:
    """Return two commands' first differing fields, including nested ones, with both values."""
    recorded, replayed = msgspec.to_builtins(journal), msgspec.to_builtins(replay)
    return list(islice(_fields(recorded["type"], recorded, replayed), most))


def _fields(name: str, journal: Any, replay: Any) -> Iterator[dict[str, Any]]:
    if isinstance(journal, dict) and isinstance(replay, dict):
        for key in journal | replay:
            yield from _fields(f"{name}.{key}", journal.get(key, ABSENT), replay.get(key, ABSENT))
    elif isinstance(journal, list | tuple) and isinstance(replay, list | tuple):
        for place, both in enumerate(zip_longest(journal, replay, fillvalue=ABSENT)):
            yield from _fields(f"{name}[{place}]", *both)
    elif journal != replay:
        yield {"field": name, "journal": journal, "replay": replay}


def cut(value: object, length: int = 160) -> str:
    """Return a value as text of limited length."""
    text = repr(value)
    return text if len(text) <= length else text[: length - 1] + "…"
