"""Planners alone on a journal: its positions and observations in, decisions out. No missions.

With the journal's own rule they must be the journal's decisions; with another one they are what it
would have decided in the places where the vehicles were.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firemodel.landscape import Landscape
from mission_service.commands import Decided, Return
from mission_service.config import Scenario, parse_scenario
from mission_service.differences import compare
from mission_service.errors import JournalError, MissionServiceError
from mission_service.events import Crew
from mission_service.fire_setup import landscape_of
from mission_service.journal import JournalReader
from mission_service.planning import FORMATION, RULES, planners_of
from mission_service.steering import Steering, decided

Timed = tuple[int, Decided]  # at_us, decision


@dataclass(frozen=True)
class Decisions:
    """What was decided, and what the journal has. ``difference`` is for the journal's own rule."""

    rule: str
    journal_rule: str
    found: list[Timed]
    recorded: list[Timed]
    difference: str | None


def decide(path: Path, rule: str | None = None) -> Decisions:
    """Run the planners of a journal's scenario, or those of another rule, on its events.

    Raises JournalError where the journal cannot be read, or a line of it was altered.
    """
    reader = JournalReader(path)
    scenario = parse_scenario(reader.header["scenario"], path)
    own = scenario.planner.rule
    if rule is not None:
        scenario = with_rule(scenario, rule)
    if scenario.planner.rule == FORMATION:
        raise MissionServiceError(
            f"{path}: rule {FORMATION} flies orbits and takes no decisions; use replay --verify, "
            "or --planner with another rule"
        )
    landscape = landscape_of(scenario)
    _check_landscape(path, landscape, reader.header["landscape_sha256"])
    planners = planners_of(scenario, landscape)
    steering = Steering(scenario, landscape, planners)
    found: list[Timed] = []
    recorded: list[Timed] = []
    at_us = 0
    for entry in reader:
        if not entry.intact:
            raise JournalError(f"{path}: line {entry.line} was altered; see replay --verify")
        content = entry.content
        if isinstance(content, Decided):
            recorded.append((at_us, content))
        elif isinstance(content, Return):
            steering.recall(content.vehicle, at_us / 1e6)
        elif entry.is_event and not isinstance(content, Crew):
            at_us = content.at_us  # type: ignore[union-attr]
            decision = steering.take(content)  # type: ignore[arg-type]
            if decision is not None:
                name = content.vehicle
                found.append((at_us, decided(name, planners[name], decision)))
    rule = scenario.planner.rule
    cut = reader.cut_at_line is not None
    difference = first_difference(found, recorded, cut) if rule == own else None
    return Decisions(rule, own, found, recorded, difference)


def with_rule(scenario: Scenario, rule: str) -> Scenario:
    """The scenario with another rule."""
    if rule not in RULES:
        raise MissionServiceError(f"--planner {rule}: no such rule; there are {', '.join(RULES)}")
    planner = scenario.planner.model_copy(update={"rule": rule})
    return scenario.model_copy(update={"planner": planner})


def _check_landscape(path: Path, landscape: Landscape, recorded: str) -> None:
    if landscape.digest() != recorded:
        raise JournalError(
            f"{path}: the landscape is not the one of the journal; use it where its rasters are"
        )


def first_difference(found: list[Timed], recorded: list[Timed], cut: bool) -> str | None:
    """Where decisions and those recorded part; a journal that was cut off may lack the last."""
    for (at_us, ours), (told_us, theirs) in zip(found, recorded, strict=False):
        if at_us != told_us:
            return f"decided at {at_us / 1e6:.2f} s, recorded at {told_us / 1e6:.2f} s"
        if ours != theirs:
            return f"at {at_us / 1e6:.2f} s {ours.vehicle}: {compare(theirs, ours)}"
    missing = len(found) - len(recorded)
    if missing == 0 or (cut and missing == 1):
        return None
    return f"{len(found)} decisions, {len(recorded)} recorded"


def summary_of(decisions: Decisions) -> dict[str, Any]:
    """In figures, and every reversal; for JSON."""
    names = list(dict.fromkeys(each.vehicle for _, each in decisions.recorded + decisions.found))
    return {
        "rule": decisions.rule,
        "journal_rule": decisions.journal_rule,
        "difference": decisions.difference,
        "vehicles": [
            {
                "name": name,
                "decisions": _count(decisions.found, name),
                "reversals": _count(decisions.found, name, reversals=True),
                "recorded_decisions": _count(decisions.recorded, name),
                "recorded_reversals": _count(decisions.recorded, name, reversals=True),
            }
            for name in names
        ],
        "reversals": [
            {"at_s": at_us / 1e6, "vehicle": each.vehicle, "direction": each.direction}
            for at_us, each in decisions.found
            if each.reversed
        ],
    }


def _count(decisions: list[Timed], name: str, reversals: bool = False) -> int:
    return sum(each.vehicle == name and (each.reversed or not reversals) for _, each in decisions)


def in_text(summary: dict[str, Any]) -> str:
    """The summary for people."""
    lines = [
        f"{each['name']}: {each['decisions']} decisions, {each['reversals']} reversals with "
        f"{summary['rule']} (recorded with {summary['journal_rule']}: "
        f"{each['recorded_decisions']}, {each['recorded_reversals']})"
        for each in summary["vehicles"]
    ]
    lines += [
        f"  {each['at_s']:.0f} s  {each['vehicle']} turns {each['direction']}"
        for each in summary["reversals"]
    ]
    if summary["rule"] == summary["journal_rule"] and summary["difference"] is None:
        lines.append("the same decisions as recorded")
    return "\n".join(lines)
