"""A logged flight from its beginning to its end: beside a core, if there is a fire, and told of."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mission_service.config import Scenario, apply_override, flying, load_scenario, parse_scenario
from mission_service.errors import FlightError
from mission_service.fire_setup import landscape_of
from mission_service.flights.journal_log import JOURNAL, JournalLog
from mission_service.flights.played import Flight, survey
from mission_service.flights.run_story import RunStory, run_story
from mission_service.flights.shadow import (
    Shadow,
    check_place,
    mission_time,
    scenario_for,
    told_in,
)
from mission_service.journal import Journal, begins_journal, header_of


class Beside(NamedTuple):
    """What a flight is replayed beside: a scenario, and when in it the flight begins."""

    scenario: Scenario
    at_s: float | None = None  # of mission time; None: as shadow.mission_time has it


def beside(
    flight: Flight,
    scenario: str | None,
    rule: str | None,
    at_s: float | None,
    overrides: tuple[str, ...],
) -> Beside | None:
    """What a flight is to be replayed beside: a scenario by its name, or a journal's own.

    None if nothing is asked for. Raises ScenarioError, and FlightError for settings of nothing.
    """
    own = flight.logs[0]
    if scenario is not None:
        found = load_scenario(scenario, overrides)
    elif rule is None and at_s is None and not overrides:
        return None
    elif isinstance(own, JournalLog):
        data = own.scenario.model_dump(mode="json")
        for override in overrides:
            apply_override(data, override)
        found = parse_scenario(data, own.path)
    else:
        raise FlightError(f"{own.path}: has no scenario of its own; give one with --scenario")
    if rule is not None:
        data = {**found.model_dump(mode="json")}
        data["planner"] = {**data["planner"], "rule": rule}
        found = parse_scenario(data, Path(found.name))
    return Beside(flying(found), at_s)


def story_of(
    name: str, flight: Flight, beside: Beside | None, out: Path | None, created: str
) -> RunStory:
    """Tell of a flight; beside a scenario its shadow's journal is left in ``out``, if given.

    A journal that is beside no other scenario has its own fire. ``created`` goes into the header.
    Raises FlightError and others in one line.
    """
    if beside is not None and out is not None:
        return _beside(name, flight, beside, out / JOURNAL, created)
    if beside is not None:
        with tempfile.TemporaryDirectory() as folder:
            return _beside(name, flight, beside, Path(folder) / JOURNAL, created)
    own = flight.logs[0]
    part = flight.from_s > 0.0 or flight.to_s != float("inf")
    if len(flight.logs) == 1 and isinstance(own, JournalLog) and not part:
        return run_story(name, flight, JournalLog(own.path))
    return run_story(name, flight)


def _beside(name: str, flight: Flight, beside: Beside, path: Path, created: str) -> RunStory:
    found = survey(flight)
    mission = mission_time(flight, found, beside.scenario, beside.at_s)
    scenario = scenario_for(beside.scenario, found, mission)
    landscape = landscape_of(scenario)
    check_place(found, landscape, scenario.name)
    refuse_loss(path, flight)
    logs = [str(log.path) for log in flight.logs]
    header = {**header_of(scenario, landscape.digest(), created), "shadow_of": logs}
    journal = Journal(path, header, durable=False)
    try:
        shadow = Shadow(scenario, landscape, journal, mission)
        for told in told_in(flight, mission, found.begin_us, found.end_us):
            shadow.take(told)
        journal.end()
    finally:
        journal.close()
    return run_story(name, flight, JournalLog(path), mission)


def refuse_loss(path: Path, flight: Flight) -> None:
    """Raise FlightError rather than write over the journal of a run."""
    if not path.exists():
        return
    ours = begins_journal(path) and JournalLog(path).shadow
    if not ours or any(path.samefile(log.path) for log in flight.logs):
        raise FlightError(f"{path}: is there already, and not from a replay; choose another --out")


def distinct(names: Sequence[str]) -> list[str]:
    """The same names, with numbers where some are alike."""
    return [
        name if names.count(name) == 1 else f"{name}-{names[: place + 1].count(name)}"
        for place, name in enumerate(names)
    ]


def called(path: Path) -> str:
    """What a run is called by its file: a journal by its folder."""
    if path.is_dir():
        return path.resolve().name
    return path.resolve().parent.name if path.name == JOURNAL else path.stem
