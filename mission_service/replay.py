"""Replay: a journal's inputs through a fresh core must give the journal's commands, bit for bit."""

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import msgspec

from mission_service.commands import AnyCommand
from mission_service.config import parse_scenario
from mission_service.core import Core
from mission_service.errors import JournalError
from mission_service.fire_setup import landscape_of
from mission_service.journal import Entry, JournalReader


@dataclass(frozen=True)
class Verification:
    """What a replay found. ``difference`` is None when every line was reproduced."""

    events: int
    commands: int
    decisions: int
    difference: str | None
    cut_at_line: int | None


def verify(path: Path) -> Verification:
    """Replay a journal up to its first difference.

    Raises JournalError where the journal cannot be read or belongs to another landscape.
    """
    reader = JournalReader(path)
    scenario = parse_scenario(reader.header["scenario"], path)
    landscape = landscape_of(scenario)
    if landscape.digest() != reader.header["landscape_sha256"]:
        raise JournalError(
            f"{path}: the landscape is not the one of the journal "
            f"(sha256 {landscape.digest()[:12]}…, recorded "
            f"{reader.header['landscape_sha256'][:12]}…); replay it where its rasters are"
        )
    core = Core(scenario, landscape)
    expected: deque[AnyCommand] = deque()
    events = commands = decisions = 0
    difference = None
    for entry in reader:
        difference = difference_of(entry, expected)
        if difference is not None:
            break
        if entry.is_event:
            events += 1
            expected.extend(core.handle(entry.content))  # type: ignore[arg-type]
        else:
            expected.popleft()
            commands += 1
            decisions += type(entry.content).__name__ == "Decided"
    if difference is None and expected and reader.cut_at_line is None:
        difference = f"after the last line: the journal lacks {_cut(expected[0])}"
    return Verification(events, commands, decisions, difference, reader.cut_at_line)


def difference_of(entry: Entry, expected: deque[AnyCommand]) -> str | None:
    """What is wrong with a line, if ``expected`` are the commands still to come; or None."""
    altered = "" if entry.intact else " (its checksum does not match: the line was altered)"
    where = f"line {entry.line}{altered}"
    if entry.is_event:
        if expected:
            return f"{where}: the replay first gives {_cut(expected[0])}"
        return None if entry.intact else f"{where}: event {_cut(entry.content)}"
    if not expected:
        return f"{where}: the replay does not give {_cut(entry.content)}"
    if entry.content != expected[0]:
        return f"{where}: {compare(entry.content, expected[0])}"
    return None if entry.intact else f"{where}: command {_cut(entry.content)}"


def compare(journal: object, replay: object) -> str:
    """The first field in which two commands differ, in words."""
    ours, theirs = msgspec.to_builtins(replay), msgspec.to_builtins(journal)
    if ours["type"] != theirs["type"]:
        return f"journal has {_cut(journal)}, replay gives {_cut(replay)}"
    for key in ours:
        if ours[key] != theirs[key]:
            return (
                f"{ours['type']}.{key}: journal has {_cut(theirs[key])}, "
                f"replay gives {_cut(ours[key])}"
            )
    return "no field differs"


def _cut(value: object, length: int = 160) -> str:
    text = repr(value)
    return text if len(text) <= length else text[: length - 1] + "…"
