"""Verifies a journal by replay in independent stages.

file: the checksum of every line. fire: the cameras' observations, in the fire simulated again.
planner: the decisions on the recorded observations. core: all commands, bit for bit.

A journal of several segments is verified from its beginning, or from the state with which its
oldest segment begins; a single closed segment from the state with which it begins.
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
from mission_service.replay.decisions import decisions_alone, first_difference
from mission_service.replay.fire_stage import fire_stage
from mission_service.replay.replay_stage import Stage


@dataclass(frozen=True)
class Verification:
    """The results of all stages. ``from_segment`` is 1 if the journal is complete.

    ``cut_at_line``: the journal was cut off in this line and is verified up to it.
    """

    stages: tuple[Stage, ...]
    cut_at_line: int | None
    from_segment: int
    segments: int

    @property
    def difference(self) -> str | None:
        """The difference of the first stage that found one; None if all was reproduced."""
        return next((each.difference for each in self.stages if each.difference), None)

    @property
    def differing(self) -> list[str]:
        """The stages that found a difference."""
        return [each.name for each in self.stages if each.difference is not None]

    @property
    def events(self) -> int:
        """The number of events processed by the core."""
        return self._count("events")

    @property
    def commands(self) -> int:
        """The number of commands reproduced by the core."""
        return self._count("commands")

    @property
    def decisions(self) -> int:
        """The number of decisions among these commands."""
        return self._count("decisions")

    def stage(self, name: str) -> Stage:
        """Return the result of one stage."""
        return next(each for each in self.stages if each.name == name)

    def _count(self, what: str) -> int:
        return sum(each.counts.get(what, 0) for each in self.stages if each.name == "core")


def verify(path: Path, alone: bool = False, stages: Sequence[str] = ()) -> Verification:
    """Verify a journal in these stages, or all; ``alone``: without the segments before this one.

    Raises JournalError if the journal cannot be read or belongs to another landscape, or if its
    beginning was deleted and the state saved in its place cannot be used.
    """
    recorded = JournalReader(path, alone)
    wanted = [name for name in STAGES if name in (stages or STAGES)]
    found = tuple(_in_words(STAGES[name], recorded) for name in wanted)
    killed = next((each.killed_at_line for each in found if each.killed_at_line), None)
    return Verification(
        found, recorded.last.cut_at_line or killed, recorded.segment, len(recorded.readers)
    )


def as_json(found: Verification) -> dict[str, Any]:
    """For programs."""
    return {
        "events": found.events,
        "commands": found.commands,
        "decisions": found.decisions,
        "difference": found.difference,
        "cut_at_line": found.cut_at_line,
        "from_segment": found.from_segment,
        "segments": found.segments,
        "stages": {each.name: _told(each) for each in found.stages},
    }


def _told(stage: Stage) -> dict[str, Any]:
    found = asdict(stage)
    for name in ("name", "killed_at_line"):
        del found[name]
    return found


def in_text(found: Verification) -> str:
    """Return the results as text: one line per stage, and its difference."""
    lines = []
    for each in found.stages:
        counts = ", ".join(f"{count} {what}" for what, count in each.counts.items())
        result = "left out" if each.left_out else "differs" if each.difference else "ok"
        told = [counts, each.note]
        lines.append(f"{each.name:<8} {result:<9} {'; '.join(words for words in told if words)}")
        if each.difference is not None:
            lines.append(f"  first difference in {each.difference}")
    if found.from_segment != 1:
        lines.append(f"from segment {found.from_segment}: those before it are not there")
    if found.cut_at_line is not None:
        lines.append(f"the journal is cut off in line {found.cut_at_line}; verified up to there")
    return "\n".join(line.rstrip() for line in lines)


def _in_words(stage: Callable[[JournalReader], Stage], recorded: JournalReader) -> Stage:
    """Return the result of a stage; an input that raises an exception is a difference too."""
    recorded.at = None
    try:
        return stage(recorded)
    except MissionServiceError:
        raise
    except Exception as error:
        if recorded.at is None:
            raise
        where = recorded.place(*recorded.at)
        words = f"{where}: cannot be handled: {type(error).__name__}: {error}"
        return Stage(stage.__name__.removesuffix("_stage"), {}, words)


def file_stage(recorded: JournalReader) -> Stage:
    """Check the checksum of every line, which is chained to the line before."""
    counts = {"lines": len(recorded.readers), "altered": 0}  # headers were checked already
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
        note = "nothing can be read from there on; run --skip-unreadable goes on without that line"
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
        return Stage("planner", {}, note=f"rule {rule} takes no such decisions", left_out=True)
    found, told = decisions_alone(recorded, recorded.scenario, recorded.readable())
    difference, fields = first_difference(found, told, may_lack_one=recorded.cut_off)
    return Stage("planner", {"decisions": len(told)}, difference, fields)


def core_stage(recorded: JournalReader) -> Stage:
    """Compare the commands of a core given all events with the journal, bit for bit."""
    core = recorded.core()
    expected: deque[AnyCommand] = deque()
    counts = {"events": 0, "commands": 0, "decisions": 0}
    for reader, entry in recorded.readable():
        if not entry.sure:  # the state of the core is not known
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
    if recorded.cut_off:  # killed between two lines
        line = recorded.at[1].line if recorded.at else 1
        return Stage("core", counts, killed_at_line=line + 1)
    return Stage("core", counts, f"the end: the journal lacks {cut(expected[0])}")


STAGES: dict[str, Callable[[JournalReader], Stage]] = {
    "file": file_stage,
    "fire": fire_stage,
    "planner": planner_stage,
    "core": core_stage,
}
