"""Runs only the planners on a journal's positions and observations, without planning missions.

With the journal's own rule, the decisions must equal the recorded decisions. With another rule,
that rule makes the decisions at the recorded positions.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from mission_service.commands import DirectionDecision, Return, ShowClearing, ShowLanding
from mission_service.config.rule_lookup import faults_of, rules
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
    """The replayed and recorded decisions. With another rule ``difference`` is None."""

    rule: str
    journal_rule: str
    found: list[Timed]
    recorded: list[Timed]
    difference: str | None


def decide(path: Path, rule: str | None = None) -> Decisions:
    """Run the planners of a journal's scenario, or of another rule, on the journal's events.

    Raises JournalError if the journal cannot be read or one of its lines was altered.
    """
    journal = JournalReader(path, rule=rule)
    scenario = journal.scenario
    own = journal.rule or scenario.planner.rule
    if rule is not None:
        scenario = with_rule(scenario, rule)
    rule = scenario.planner.rule
    if not way_for(rule).along_front:
        raise MissionServiceError(
            f"{path}: rule {rule} makes no decisions along a front; use replay --verify, or "
            "--planner with another rule"
        )
    with faults_of(rule):
        found, recorded = decisions_alone(journal, scenario, journal.intact())
    difference = None
    if own == rule:
        difference, _ = first_difference(found, recorded, may_lack_one=journal.cut_off)
    return Decisions(rule, own, found, recorded, difference)


def decisions_alone(
    journal: JournalReader, scenario: Scenario, entries: Iterable[tuple[SegmentReader, Entry]]
) -> tuple[list[Timed], list[Timed]]:
    """Return the planners' decisions on a journal's events, and the recorded decisions."""
    core, excluded = _initial_state(journal, scenario)
    decision_engine = core.decision_engine
    planners = cast(Mapping[str, Planner], decision_engine.planners)  # the rule flies along a front
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
            _apply_request(content, core, excluded)
        elif not entry.is_event:
            if isinstance(content, ShowLanding):
                excluded.landing_shown(content)
            elif isinstance(content, ShowClearing):
                excluded.clearing = content
            decision_engine.on_command(content, at_us / 1e6)  # type: ignore[arg-type]
        elif entry.is_event:
            event: VehicleEvent = content  # type: ignore[assignment]
            name, at_us = event.vehicle, event.at_us
            decision = decision_engine.apply(event)
            if decision is not None and entry.sure and name not in excluded.held | excluded.unclear:
                found.append((at_us, decided(name, planners[name], decision)))
            if isinstance(event, MissionReadBack | VehicleRebooted):
                excluded.unclear.discard(name)
    return found, recorded


@dataclass
class _Excluded:
    """The vehicles without recorded decisions: held by operators, or in an unclear state."""

    held: set[str]
    unclear: set[str]
    clearing: ShowClearing | None = None

    def refuses(self, event: OrderGiven) -> bool:
        """Return whether an order was refused because the airspace was being cleared."""
        shown = self.clearing
        if shown is None or shown.outcome != "in force":
            return False
        resumes = event.order == "resume" and not shown.volume
        return event.order in ("start", "takeoff") or resumes

    def landing_shown(self, shown: ShowLanding) -> None:
        """Apply a landing phase, which ends a hold or ends in one."""
        if shown.holds:
            self.held.add(shown.vehicle)
        elif shown.phase != "none":
            self.held.discard(shown.vehicle)


def _initial_state(journal: JournalReader, scenario: Scenario) -> tuple[Core, _Excluded]:
    """Return a journal's initial state; planners of another rule start without a state."""
    if journal.segment == 1:
        return Core(scenario, journal.landscape), _Excluded(set(), set())
    core = journal.core()
    excluded = _Excluded(
        {name for name, vehicle in core.vehicles.items() if vehicle.ordered},
        {name for name, vehicle in core.vehicles.items() if vehicle.unconfirmed is not None},
        core.clearing.shown,
    )
    if scenario == journal.scenario:
        return core, excluded
    fresh = Core(scenario, journal.landscape)
    fresh.decision_engine.availability = core.decision_engine.availability
    return fresh, excluded


def _apply_request(event: AnyOperatorEvent, core: Core, excluded: _Excluded) -> None:
    """Apply an operator's request to the planners' inputs and to the excluded vehicles."""
    decision_engine = core.decision_engine
    vehicles = decision_engine.availability
    match event:
        case SettingsChanged():
            core.guidance.on_operator(event)
        case Aborted():
            excluded.held |= set(vehicles)
            for name in vehicles:
                decision_engine.apply_abort(name)
        case OrderGiven() if not excluded.refuses(event):
            for name in [event.vehicle] if event.vehicle else list(vehicles):
                _apply_order(name, event, decision_engine, excluded.held)
        case Resumed():
            excluded.unclear |= set(vehicles)
            decision_engine.apply_restart(event)
        case _:
            pass


def _apply_order(
    name: str, event: OrderGiven, decision_engine: DecisionEngine, held: set[str]
) -> None:
    if event.order == "start" and name in held:
        return
    if decision_engine.availability[name].refuses(event.order):
        return
    if not decision_engine.apply_order(name, event):
        return
    if event.order == "hold":
        held.add(name)
    elif event.order != "land":  # a landing is shown when it begins
        held.discard(name)


def with_rule(scenario: Scenario, rule: str) -> Scenario:
    """Return the scenario with another rule. Raises MissionServiceError for an unknown rule."""
    names = [each for each in rules() if _flies_along_front(each)]
    if rule not in names:
        try:
            way_for(rule)
        except ValueError as error:
            raise MissionServiceError(f"--planner {rule}: {error}") from None
        words = f"does not fly along a front; choose {', '.join(names)}"
        raise MissionServiceError(f"--planner {rule}: {words}")
    planner = scenario.planner.model_copy(update={"rule": rule})
    return scenario.model_copy(update={"planner": planner})


def _flies_along_front(rule: str) -> bool:
    """Return whether a rule flies along a front; False for a rule that cannot be loaded."""
    try:
        return way_for(rule).along_front
    except ValueError:
        return False


def first_difference(
    found: list[Timed], recorded: list[Timed], may_lack_one: bool
) -> tuple[str | None, list[dict[str, Any]]]:
    """Return the first difference between replayed and recorded decisions, as text and as fields.

    ``may_lack_one`` means that the journal was cut off and may lack the last decision.
    """
    for (at_us, replayed), (recorded_us, journal) in zip(found, recorded, strict=False):
        if at_us != recorded_us:
            return f"decided at {at_us / 1e6:.2f} s, recorded at {recorded_us / 1e6:.2f} s", []
        if replayed != journal:
            words = f"at {at_us / 1e6:.2f} s {replayed.vehicle}: {compare(journal, replayed)}"
            return words, fields_that_differ(journal, replayed)
    missing = len(found) - len(recorded)
    if missing == 0 or (may_lack_one and missing == 1):
        return None, []
    return f"{len(found)} decisions, {len(recorded)} recorded", []


def summary_of(decisions: Decisions) -> dict[str, Any]:
    """Return each vehicle's figures and all reversals as plain data for JSON."""
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
        lines.append("all decisions equal the recorded decisions")
    return "\n".join(lines)
