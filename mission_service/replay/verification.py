"""Verifies a journal by replay in independent stages.

The stage "file" checks the checksum of every line. The stage "fire" compares the cameras'
observations with those from a new simulation of the fire. The stage "planner" recomputes the
decisions from the recorded observations, and the stage "core" recomputes all commands; both stages
compare bit for bit.

A journal is verified from its first line, or from the state at the beginning of its oldest existing
segment. A single closed segment is verified from the state at its beginning.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mission_service.commands import AnyCommand
from mission_service.errors import JournalError, MissionServiceError
from mission_service.events import LinesSkipped
from mission_service.guidance.registry import way_for
from mission_service.journal.differences import cut, difference_of, fields_that_differ
from mission_service.journal.reader import JournalReader
from mission_service.journal.segments import journal_of
from mission_service.replay.decisions import decisions_alone, first_difference
from mission_service.replay.fire_stage import fire_stage
from mission_service.replay.replay_stage import Stage


@dataclass(frozen=True)
class Verification:
    """The results of all stages. ``from_segment`` is 1 if the journal is complete.

    ``cut_at_line`` is the number of an incomplete last line, which is not verified, or None.
    ``ended`` is False if the journal lacks the line that marks a regular end: the run continues,
    was interrupted, or later lines are missing.
    """

    stages: tuple[Stage, ...]
    cut_at_line: int | None
    from_segment: int
    segments: int
    ended: bool

    @property
    def difference(self) -> str | None:
        """The first difference that a stage found; None if all stages agree."""
        return next((each.difference for each in self.stages if each.difference), None)

    @property
    def differing(self) -> list[str]:
        """The names of the stages that found a difference."""
        return [each.name for each in self.stages if each.difference is not None]

    @property
    def events(self) -> int:
        """The number of events that the core processed."""
        return self._count("events")

    @property
    def commands(self) -> int:
        """The number of commands that the core reproduced."""
        return self._count("commands")

    @property
    def decisions(self) -> int:
        """The number of decisions among these commands."""
        return self._count("decisions")

    def stage(self, name: str) -> Stage:
        """Return the result of one stage."""
        return next(each for each in self.stages if each.name == name)

    def _count(self, kind: str) -> int:
        return sum(each.counts.get(kind, 0) for each in self.stages if each.name == "core")


def verify(path: Path, alone: bool = False, stages: Sequence[str] = ()) -> Verification:
    """Verify a journal, or with ``alone`` only the segment at ``path``, by default in all stages.

    Raises JournalError if the journal cannot be read or belongs to another landscape. The error is
    also raised if the first segments were deleted and the state that replaces them is not usable.
    """
    recorded = JournalReader(path, alone)
    ended = recorded.last.ended or alone or journal_of(path) is not None  # all lines were read
    names = [name for name in STAGES if name in (stages or STAGES)]
    found = tuple(_result_of(STAGES[name], recorded) for name in names)
    killed = next((each.killed_at_line for each in found if each.killed_at_line), None)
    return Verification(
        found,
        recorded.last.cut_at_line or killed,
        recorded.segment,
        len(recorded.readers),
        ended,
    )


def as_json(found: Verification) -> dict[str, Any]:
    """Return the results as plain data for JSON."""
    return {
        "events": found.events,
        "commands": found.commands,
        "decisions": found.decisions,
        "difference": found.difference,
        "cut_at_line": found.cut_at_line,
        "from_segment": found.from_segment,
        "segments": found.segments,
        "ended": found.ended,
        "stages": {each.name: _fields(each) for each in found.stages},
    }


def _fields(stage: Stage) -> dict[str, Any]:
    hidden = ("name", "killed_at_line")
    return {name: value for name, value in asdict(stage).items() if name not in hidden}


def in_text(found: Verification) -> str:
    """Return the results as text: one line for each stage, followed by any difference."""
    lines = []
    for each in found.stages:
        counts = ", ".join(f"{count} {kind}" for kind, count in each.counts.items())
        result = "skipped" if each.left_out else "differs" if each.difference else "ok"
        shown = "; ".join(filter(None, [counts, each.note]))
        lines.append(f"{each.name:<8} {result:<9} {shown}")
        if each.difference is not None:
            lines.append(f"  first difference in {each.difference}")
    if found.from_segment != 1:
        lines.append(f"from segment {found.from_segment}; the segments before it were deleted")
    if found.cut_at_line is not None:
        lines.append(f"line {found.cut_at_line} is incomplete; the lines before it were verified")
    if not found.ended:
        lines.append(
            "the journal has no regular end: the run continues or was interrupted, or later lines "
            "are missing"
        )
    return "\n".join(line.rstrip() for line in lines)


def _result_of(stage: Callable[[JournalReader], Stage], recorded: JournalReader) -> Stage:
    """Run a stage; an entry that raises an exception counts as a difference."""
    recorded.at = None
    try:
        return stage(recorded)
    except MissionServiceError:
        raise
    except Exception as error:
        if recorded.at is None:
            raise
        place = recorded.place(*recorded.at)
        words = f"{place}: cannot be handled: {type(error).__name__}: {error}"
        return Stage(stage.__name__.removesuffix("_stage"), {}, words)


def file_stage(recorded: JournalReader) -> Stage:
    """Check the checksum of every line; a checksum depends on all earlier lines."""
    counts = {"lines": len(recorded.readers), "altered": 0}  # the reader has checked the headers
    difference = None
    try:
        for reader, entry in recorded.entries():
            counts["lines"] += 1
            if not entry.intact:
                counts["altered"] += 1
                kind = "event" if entry.is_event else "command"
                difference = difference or (
                    f"{recorded.place(reader, entry)}: altered, its checksum does not match: "
                    f"{kind} {cut(entry.content)}"
                )
    except JournalError as error:
        counts["altered"] += 1
        difference = difference or str(error)
        note = "the rest cannot be read; `run --skip-unreadable` resumes without that line"
        return Stage("file", counts, difference, note=note)
    if not recorded.skipped:
        return Stage("file", counts, difference)
    counts["skipped"] = len(recorded.skipped)
    why = "; ".join(recorded.skipped.values())
    return Stage("file", counts, difference, note=f"skipped by a restart: {why}")


def planner_stage(recorded: JournalReader) -> Stage:
    """Compare the planners' decisions on the recorded observations with the journal."""
    rule = recorded.scenario.planner.rule
    if not way_for(rule).along_front:
        note = f"rule {rule} makes no decisions along a front"
        return Stage("planner", {}, note=note, left_out=True)
    found, decisions = decisions_alone(recorded, recorded.scenario, recorded.readable())
    difference, fields = first_difference(found, decisions, may_lack_one=recorded.cut_off)
    return Stage("planner", {"decisions": len(decisions)}, difference, fields)


def core_stage(recorded: JournalReader) -> Stage:
    """Apply all events to a core and compare its commands with the journal, bit for bit."""
    core = recorded.core()
    expected: deque[AnyCommand] = deque()
    counts = {"events": 0, "commands": 0, "decisions": 0}
    for reader, entry in recorded.readable():
        if not entry.sure:  # the core's state may differ from the live run's
            expected.clear()
            if entry.is_event:
                counts["events"] += 1
                core.handle(entry.content)  # type: ignore[arg-type]
            continue
        if isinstance(entry.content, LinesSkipped):
            expected.clear()
        difference = difference_of(entry, expected)
        if difference is not None:
            words = difference.replace(f"line {entry.line}", recorded.place(reader, entry), 1)
            same_kind = not entry.is_event and bool(expected)
            fields = fields_that_differ(entry.content, expected[0]) if same_kind else []
            return Stage("core", counts, words, fields)
        if entry.is_event:
            counts["events"] += 1
            expected.extend(core.handle(entry.content))  # type: ignore[arg-type]
        else:
            expected.popleft()
            counts["commands"] += 1
            counts["decisions"] += type(entry.content).__name__ == "DirectionDecision"
    if not expected or recorded.damaged or recorded.last.cut_at_line is not None:
        return Stage("core", counts)
    if recorded.cut_off:  # the run was killed between two lines
        line = recorded.at[1].line if recorded.at else 1
        return Stage("core", counts, killed_at_line=line + 1)
    return Stage("core", counts, f"the last event: the journal lacks {cut(expected[0])}")


STAGES: dict[str, Callable[[JournalReader], Stage]] = {
    "file": file_stage,
    "fire": fire_stage,
    "planner": planner_stage,
    "core": core_stage,
}
