"""Replay: a journal's inputs through a fresh core must give the journal's commands, bit for bit.

A journal of several segments is verified from its beginning, or from the state with which its
oldest segment begins; a closed segment, named by itself, from the state with which it begins.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from firemodel.landscape import Landscape
from mission_service.commands import AnyCommand
from mission_service.config import Scenario, parse_scenario
from mission_service.core import Core
from mission_service.differences import cut, difference_of
from mission_service.errors import JournalError, StateError
from mission_service.fire_setup import landscape_of
from mission_service.journal import Entry, JournalReader
from mission_service.segments import Chain, begin_state, journal_of
from mission_service.state_file import Known, read


@dataclass(frozen=True)
class Verification:
    """What a replay found. ``difference`` is None when every line was reproduced.

    ``from_segment`` is 1 where all of the journal is there.
    """

    events: int
    commands: int
    decisions: int
    difference: str | None
    cut_at_line: int | None
    from_segment: int = 1
    segments: int = 1


def verify(path: Path, alone: bool = False) -> Verification:
    """Replay a journal up to its first difference; ``alone``: not the segments before this one.

    Raises JournalError where the journal cannot be read or belongs to another landscape, or where
    its beginning is gone and the state that stands for it cannot be used.
    """
    if alone or journal_of(path) is not None:
        readers = [JournalReader(path)]
        entries: Iterable[tuple[JournalReader, Entry]] = ((readers[0], each) for each in readers[0])
    else:
        chain = Chain(path)
        readers, entries = chain.readers, chain.after(chain.begin)
    header = readers[0].header
    scenario = parse_scenario(header["scenario"], path)
    landscape = landscape_of(scenario)
    if landscape.digest() != header["landscape_sha256"]:
        raise JournalError(
            f"{path}: the landscape is not the one of the journal "
            f"(sha256 {landscape.digest()[:12]}…, recorded "
            f"{header['landscape_sha256'][:12]}…); replay it where its rasters are"
        )
    core = _core_at(journal_of(path) or path, readers[0].segment, scenario, landscape)
    return _compared(core, readers, entries)


def _core_at(path: Path, segment: int, scenario: Scenario, landscape: Landscape) -> Core:
    """The core as it was when a segment began."""
    if segment == 1:
        return Core(scenario, landscape)
    try:
        core: Core = read(begin_state(path, segment), Known(scenario, landscape))["core"]
    except StateError as error:
        raise JournalError(f"{path}: segment {segment} cannot be replayed: {error}") from None
    return core


def _compared(
    core: Core, readers: list[JournalReader], entries: Iterable[tuple[JournalReader, Entry]]
) -> Verification:
    expected: deque[AnyCommand] = deque()
    events = commands = decisions = 0
    difference = None
    last_line = 1
    for reader, entry in entries:
        last_line = entry.line
        difference = difference_of(entry, expected)
        if difference is not None:
            if len(readers) > 1:
                difference = f"{reader.path.name}, {difference}"
            break
        if entry.is_event:
            events += 1
            expected.extend(core.handle(entry.content))  # type: ignore[arg-type]
        else:
            expected.popleft()
            commands += 1
            decisions += type(entry.content).__name__ == "Decided"
    last = readers[-1]
    cut_at_line = last.cut_at_line
    if difference is None and expected and cut_at_line is None:
        if last.header.get("live") and not last.ended:  # killed between two lines
            cut_at_line = last_line + 1
        else:
            difference = f"after the last line: the journal lacks {cut(expected[0])}"
    first = readers[0].segment
    return Verification(events, commands, decisions, difference, cut_at_line, first, len(readers))
