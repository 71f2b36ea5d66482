"""Replay: a journal's inputs through a fresh core must give the journal's commands, bit for bit."""

from collections import deque
from dataclasses import dataclass
from pathlib import Path

from mission_service.commands import AnyCommand
from mission_service.config import parse_scenario
from mission_service.core import Core
from mission_service.differences import cut, difference_of
from mission_service.errors import JournalError
from mission_service.fire_setup import landscape_of
from mission_service.journal import JournalReader


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
    last_line = 1
    for entry in reader:
        last_line = entry.line
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
    cut_at_line = reader.cut_at_line
    if difference is None and expected and cut_at_line is None:
        if reader.header.get("live") and not reader.ended:  # killed between two lines
            cut_at_line = last_line + 1
        else:
            difference = f"after the last line: the journal lacks {cut(expected[0])}"
    return Verification(events, commands, decisions, difference, cut_at_line)
