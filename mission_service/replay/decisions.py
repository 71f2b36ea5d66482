"""Runs the planners alone on a journal: positions and observations in, decisions out. No missions.

With the journal's own rule the decisions must equal the recorded ones. With another rule they are
the decisions which that rule takes at the recorded positions.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from mission_service.commands import DirectionDecision, Return
from mission_service.config.rule_lookup import rules
from mission_service.config.scenario import Scenario
from mission_service.core.core import Core
from mission_service.core.decision_engine import DecisionEngine
from mission_service.errors import MissionServiceError
from mission_service.events import (
    Aborted,
    AnyOperatorEvent,
    MissionReadBack,
    OperatorEvent,
    OrderGiven,
    Resumed,
    SettingsChanged,
    VehicleEvent,
    VehicleRebooted,
)
from mission_service.guidance.protocol import Planner, decided
from mission_service.guidance.registry import way_for
from mission_service.journal.differences import compare, fields_that_differ
from mission_service.journal.journal_file import Entry, SegmentReader
from mission_service.journal.reader import JournalReader

Timed = tuple[int, DirectionDecision]  # at_us, decision


@dataclass(frozen=True)
class Decisions:
    """Decisions found and recorded. ``difference`` is set for the journal's own rule only."""

    rule: str
    journal_rule: str
    found: list[Timed]
    recorded: list[Timed]
    difference: str | None


def decide(path: Path, rule: str | None = None) -> Decisions:
    """Run the planners of a journal's scenario, or those of another rule, on the journal's events.

    Raises JournalError if the journal cannot be read or one of its lines was altered.
    """
    journal = JournalReader(path)
    scenario = journal.scenario
    own = scenario.planner.rule
    if rule is not None:
        scenario = with_rule(scenario, rule)
    rule = scenario.planner.rule
    if not way_for(rule).along_front:
        raise MissionServiceError(
            f"{path}: rule {rule} takes no decisions along a front; use replay --verify, "
            "or --planner with another rule"
        )
    found, told = decisions_alone(journal, scenario, journal.intact())
    difference = None
    if own == rule:
        difference, _ = first_difference(found, told, may_lack_one=journal.cut_off)
    return Decisions(rule, own, found, told, difference)


def decisions_alone(
    journal: JournalReader, scenario: Scenario, entries: Iterable[tuple[SegmentReader, Entry]]
) -> tuple[list[Timed], list[Timed]]:
    """Return the decisions of a scenario's planners on the events of a journal, and those recorded."""
    core, silent = _begun(journal, scenario)
    decision_engine = core.decision_engine
    planners = cast(Mapping[str, Planner], decision_engine.planners)  # of all rules along a front
    found: list[Timed] = []
    recorded: list[Timed] = []
    at_us = 0
    for _, entry in entries:
        content = entry.content
        if isinstance(content, DirectionDecision):
            if entry.sure:
                recorded.append((at_us, content))
        elif isinstance(content, Return):
            decision_engine.recall(content.vehicle, at_us / 1e6)
            decision_engine.on_command(content, at_us / 1e6)
        elif isinstance(content, OperatorEvent):
            at_us = content.at_us
            _told(content, core, silent)
        elif not entry.is_event:
            decision_engine.on_command(content, at_us / 1e6)  # type: ignore[arg-type]
        elif entry.is_event:
            event: VehicleEvent = content  # type: ignore[assignment]
            name, at_us = event.vehicle, event.at_us
            decision = decision_engine.apply(event)
            if decision is not None and entry.sure and name not in silent.held | silent.doubted:
                found.append((at_us, decided(name, planners[name], decision)))
            if isinstance(event, MissionReadBack | VehicleRebooted):
                silent.doubted.discard(name)
    return found, recorded


@dataclass
class _UnplayedPlanner:
    """Vehicles whose decisions are not announced: held by operators, or with an unclear state."""

    held: set[str]
    doubted: set[str]


def _begun(journal: JournalReader, scenario: Scenario) -> tuple[Core, _UnplayedPlanner]:
    """Return the state with which a journal begins; another rule starts without a state there."""
    if journal.segment == 1:
        return Core(scenario, journal.landscape), _UnplayedPlanner(set(), set())
    core = journal.core()
    silent = _UnplayedPlanner(
        {name for name, vehicle in core.vehicles.items() if vehicle.ordered},
        {name for name, vehicle in core.vehicles.items() if vehicle.unconfirmed is not None},
    )
    if scenario == journal.scenario:
        return core, silent
    fresh = Core(scenario, journal.landscape)
    fresh.decision_engine.availability = core.decision_engine.availability
    return fresh, silent


def _told(event: AnyOperatorEvent, core: Core, silent: _UnplayedPlanner) -> None:
    """Apply an operator's request: inputs of the planners, and whether a vehicle is led at all."""
    decision_engine = core.decision_engine
    match event:
        case SettingsChanged():
            core.guidance.on_operator(event)
        case Aborted():
            silent.held |= set(decision_engine.availability)
            for name in decision_engine.availability:
                decision_engine.apply_abort(name)
        case OrderGiven():
            for name in [event.vehicle] if event.vehicle else list(decision_engine.availability):
                _ordered(name, event, decision_engine, silent)
        case Resumed():
            silent.doubted |= set(decision_engine.availability)
            for availability in decision_engine.availability.values():
                availability.online = False
        case _:
            pass


def _ordered(
    name: str, event: OrderGiven, decision_engine: DecisionEngine, silent: _UnplayedPlanner
) -> None:
    if event.order == "start" and name in silent.held:
        return
    if not decision_engine.apply_order(name, event):
        return
    if event.order == "hold":
        silent.held.add(name)
    else:
        silent.held.discard(name)


def with_rule(scenario: Scenario, rule: str) -> Scenario:
    """Return the scenario with another rule. Raises MissionServiceError if there is no such rule."""
    able = [each for each in rules() if way_for(each).along_front]
    if rule not in able:
        raise MissionServiceError(f"--planner {rule}: no such rule; there are {', '.join(able)}")
    planner = scenario.planner.model_copy(update={"rule": rule})
    return scenario.model_copy(update={"planner": planner})


def first_difference(
    found: list[Timed], recorded: list[Timed], may_lack_one: bool
) -> tuple[str | None, list[dict[str, Any]]]:
    """Return the first difference between found and recorded decisions, as text and as fields.

    A journal that was cut off may lack the last decision.
    """
    for (at_us, ours), (told_us, theirs) in zip(found, recorded, strict=False):
        if at_us != told_us:
            return f"decided at {at_us / 1e6:.2f} s, recorded at {told_us / 1e6:.2f} s", []
        if ours != theirs:
            words = f"at {at_us / 1e6:.2f} s {ours.vehicle}: {compare(theirs, ours)}"
            return words, fields_that_differ(theirs, ours)
    missing = len(found) - len(recorded)
    if missing == 0 or (may_lack_one and missing == 1):
        return None, []
    return f"{len(found)} decisions, {len(recorded)} recorded", []


def summary_of(decisions: Decisions) -> dict[str, Any]:
    """Figures and every reversal, as plain data for JSON."""
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
    """Return the summary as text for a terminal."""
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
