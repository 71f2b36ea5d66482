"""Flies a journal's scenario again in the simulator with different planner settings.

The operators' requests are repeated at their mission times. The vehicles are mocks: with unchanged
settings, a run of ``sim`` is reproduced bit for bit, and a live flight only approximately.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Any

import msgspec

from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario, apply_override, flying, parse_scenario
from mission_service.core.core import Core
from mission_service.errors import JournalError, ScenarioError
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
    Approved,
    ChecklistAnswered,
    FireReachedEdge,
    MissionAccepted,
    MissionRefused,
    OperatorEvent,
    OperatorHeartbeat,
    Rejected,
    Resumed,
    SettingsChanged,
)
from mission_service.fire.run_estimate import RunEstimate
from mission_service.journal.reader import JournalReader
from mission_service.runtime.engine import Progress, unshown
from mission_service.runtime.run_outputs import summary_of, write_outputs
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView
from mission_service.simulation.sim import clock_sensors_in, simulate
from mission_service.simulation.simulated_crew import SimulatedCrew

SHORT = {"planner": "rule"}
NOT_REPEATED = (Approved, Rejected, MissionAccepted, MissionRefused, Resumed)
CREW_EVENTS = (ChecklistAnswered, OperatorHeartbeat)


@dataclass
class PastRun:
    """The contents of a journal that the second run needs."""

    scenario: Scenario
    state_view: StateView
    estimate: RunEstimate
    requests: list[AnyOperatorEvent] = field(default_factory=list)

    @property
    def record(self) -> RunStatistics:
        """The statistics of the run."""
        return self.state_view.statistics

    def apply(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        """Add an event and its commands."""
        self.estimate.apply_history(event)
        for command in commands:
            self.estimate.on_command(command)
        self.state_view.apply(event, commands)
        if isinstance(event, OperatorEvent) and not isinstance(event, FireReachedEdge):
            self.requests.append(event)


def past_run(journal: JournalReader) -> PastRun:
    """Read a whole journal. Raises JournalError if the journal is damaged or incomplete."""
    if journal.segment != 1:
        raise JournalError(
            f"{journal.path}: its beginning, which contains operators' requests, was deleted"
        )
    scenario = journal.scenario
    estimate = journal.estimate()
    start_us = round(scenario.start_s * 1e6)
    run = PastRun(scenario, StateView(scenario, estimate.landscape, start_us), estimate)
    event: AnyEvent | None = None
    commands: list[AnyCommand] = []
    for _, entry in journal.intact():
        if not entry.is_event:
            commands.append(entry.content)  # type: ignore[arg-type]
            continue
        if event is not None:
            run.apply(event, commands)
        event, commands = entry.content, []  # type: ignore[assignment]
    if event is not None:
        run.apply(event, commands)
    run.estimate.advance(run.record.at_us)
    return run


@dataclass(frozen=True)
class WhatIf:
    """The changed settings, the figures of both runs, and notes on the second run."""

    settings: dict[str, Any]
    until_s: float
    recorded: dict[str, Any]
    what_if: dict[str, Any]
    notes: list[str]


def what_if(
    path: Path, words: Sequence[str], out: Path, created: str, progress: Progress = unshown
) -> WhatIf:
    """Fly a journal's scenario again with ``KEY=VALUE`` settings for [planner]; compare both runs.

    Writes the files of ``sim`` to the folder ``out``. Raises ScenarioError for invalid settings,
    and JournalError for a journal that cannot be flown again.
    """
    journal = JournalReader(path)
    scenario, changed = with_settings(journal, words)
    copy = out / "journal.jsonl"
    if any(each.path.resolve().parent == out.resolve() for each in journal.readers):
        raise ScenarioError(f"{out}: is the folder of the journal; choose another with --out")
    if scenario.only is not None:
        raise JournalError(
            f"{path}: was written by one of several processes; simulate its scenario with sim"
        )
    past = past_run(journal)
    until_s = past.record.at_us / 1e6
    if until_s <= scenario.start_s:
        raise JournalError(f"{path}: contains no event after the start of the scenario")
    notes: list[str] = []
    if scenario.mission.approval == "each":
        notes.append("missions are sent to the vehicles without acceptance")
        section = scenario.mission.model_copy(update={"approval": "none"})
        scenario = scenario.model_copy(update={"mission": section})
    scenario = _without_clock_sensors(scenario, notes)
    script = repeatable_requests(past.requests, changed)
    if scenario.burn_flown is not None:
        notes.append(
            "a simulated crew confirms the GO/NO-GO checklist, is present and approves the plans"
        )
        script = [event for event in script if not isinstance(event, CREW_EVENTS)]
        due = SimulatedCrew(scenario.burn_flown, script=script).due
    else:
        due = Script(script).due
    omitted = sum(isinstance(event, NOT_REPEATED) for event in past.requests)
    if omitted:
        notes.append(f"{omitted} approvals and restarts of the recorded run are not repeated")
    record, fire = simulate(scenario, copy, created, progress, due, until_s)
    summary = write_outputs(out, scenario, record, fire)
    recorded = summary_of(past.scenario, past.record, past.estimate.fire)
    return WhatIf(changed, until_s, figures_of(recorded), figures_of(summary), notes)


def _without_clock_sensors(scenario: Scenario, notes: list[str]) -> Scenario:
    """Remove the sensors that a simulation cannot have, with a note."""
    removed = clock_sensors_in(scenario)
    if not removed:
        return scenario
    notes.append(f"the observations of {', '.join(removed)} are not repeated")
    left = tuple(each for each in scenario.estimate.sensors if each not in removed)
    estimate = scenario.estimate.model_copy(update={"sensors": left})
    return scenario.model_copy(update={"estimate": estimate})


class Script:
    """A script that repeats the recorded requests of operators at their mission times."""

    def __init__(self, events: Sequence[AnyOperatorEvent]) -> None:
        self._events = list(events)

    def due(self, now_us: int, core: Core) -> list[AnyOperatorEvent]:
        """Return the requests that are due."""
        due = list(takewhile(lambda each: each.at_us <= now_us, self._events))
        del self._events[: len(due)]
        return due


def with_settings(journal: JournalReader, words: Sequence[str]) -> tuple[Scenario, dict[str, Any]]:
    """Return the journal's scenario with ``KEY=VALUE`` settings of [planner], and these settings.

    Each of ``words`` may contain several settings. Raises ScenarioError for an unknown setting.
    """
    data = msgspec.to_builtins(journal.readers[0].header["scenario"])
    keys = list[str]()
    for word in " ".join(words).replace(",", " ").split():
        key, equals, value = word.partition("=")
        if not equals or not value or "." in key:
            raise ScenarioError(
                f"--what-if {word}: write it as KEY=VALUE of [planner], e.g. planner=predictive"
            )
        key = SHORT.get(key, key)
        apply_override(data, f"planner.{key}={value}")
        keys.append(key)
    if not keys:
        raise ScenarioError("--what-if: specify settings, e.g. planner=predictive")
    scenario = flying(parse_scenario(data, journal.path))
    return scenario, {key: getattr(scenario.planner, key) for key in keys}


def repeatable_requests(
    requests: Sequence[AnyOperatorEvent], changed: dict[str, Any]
) -> list[AnyOperatorEvent]:
    """Return the recorded requests without approvals and without the settings in ``changed``."""
    found: list[AnyOperatorEvent] = []
    for event in requests:
        if isinstance(event, NOT_REPEATED):
            continue
        if isinstance(event, SettingsChanged):
            removed = dict.fromkeys(event.given.keys() & changed.keys())
            event = msgspec.structs.replace(event, **removed)
            if not event.given:
                continue
        found.append(event)
    return found


def figures_of(summary: dict[str, Any]) -> dict[str, Any]:
    """Select the figures to compare from a run's summary."""
    vehicles = {
        each["name"]: {
            "decisions": each["decisions"],
            "reversals": each["reversals"],
            "uploads_accepted": each["uploads"].get("accepted", 0),
        }
        for each in summary["vehicles"]
    }
    names = ("decisions", "reversals", "uploads_accepted")
    return {
        **{name: sum(each[name] for each in vehicles.values()) for name in names},
        "closest_pair_m": summary["closest_pair_m"],
        "burned_area_ha": round(summary["burned_area_ha"], 1),
        "vehicles": vehicles,
    }


LABELS = {"closest_pair_m": "smallest distance (m)", "burned_area_ha": "burned area (ha)"}


def in_text(found: WhatIf) -> str:
    """Return a table of both runs as text."""
    rows = [("", "recorded", "what-if")]
    rows += _rows("", found.recorded, found.what_if)
    for name, figures in found.recorded["vehicles"].items():
        if len(found.recorded["vehicles"]) > 1:
            rows += _rows(f"{name}: ", figures, found.what_if["vehicles"][name])
    width = max(len(row[0]) for row in rows)
    given = ", ".join(f"{key} = {value}" for key, value in found.settings.items())
    return "\n".join(
        [
            f"flown again in the simulator until {found.until_s:g} s with {given}",
            *found.notes,
            *(f"{name:<{width}}  {one:>10}  {other:>10}" for name, one, other in rows),
        ]
    )


def _rows(
    prefix: str, recorded: dict[str, Any], other: dict[str, Any]
) -> list[tuple[str, str, str]]:
    return [
        (prefix + LABELS.get(key, key.replace("_", " ")), _shown(recorded[key]), _shown(other[key]))
        for key in recorded
        if key != "vehicles"
    ]


def _shown(value: Any) -> str:
    return "–" if value is None else f"{value}"
