"""A burn after a kill: flown in virtual time, its journal truncated, and continued."""

from collections import Counter
from functools import partial
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, Drop, StartMission, UploadMission
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    AnyOperatorEvent,
    Approved,
    ChecklistAnswered,
    Corrected,
    DropFinished,
    GpsFixChanged,
    IgnitionReported,
    Resumed,
    Telemetry,
    VehicleConnected,
)
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.simulated_cameras import cameras_of
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.guidance.burn.controller import BurnFlight, burn_flight
from mission_service.journal.journal_file import Journal, Rest, SegmentReader, header_of
from mission_service.journal.recovery import resumed, unfinished
from mission_service.journal.snapshot import Known
from mission_service.live.daemon import replay
from mission_service.replay.verification import verify
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import Gateway
from mission_service.runtime.state_view import StateView
from mission_service.simulation import sim
from mission_service.simulation.simulated_crew import SimulatedCrew

NAME, STATION = "kestrel", "firing-boss"
OPERATOR_FIELDS = ("ann", STATION)
PLACE = (36.3495, -84.16)


class Burn(NamedTuple):
    scenario: Scenario
    landscape: Landscape
    journal: bytes


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Burn:
    """Return the first minutes of the shipped burn, as a live service would journal them."""
    changes = (
        'burn.corrections="paper"',
        "deploy_at_s=5",
        "duration_s=130",
        "landscape.rows=120",
        "landscape.cols=120",
    )
    scenario = load_scenario("burn", changes)
    path = tmp_path_factory.mktemp("flown") / "journal.jsonl"
    script: list[AnyOperatorEvent] = [
        Corrected(60_000_000, *OPERATOR_FIELDS, "unburned", "point", (PLACE,), 60_000_000),
        IgnitionReported(70_000_000, *OPERATOR_FIELDS, ((36.3496, -84.1585),), 70_000_000),
    ]
    assert scenario.burn is not None
    operators = SimulatedCrew(scenario.burn, script=script)
    with pytest.MonkeyPatch.context() as patch:
        live = lambda path, header, durable: Journal(path, header, durable=True)  # noqa: E731
        patch.setattr(sim, "Journal", live)
        patch.setattr(Journal, "end", lambda journal: None)
        sim.simulate(scenario, path, "", crew=operators.due)
    return Burn(scenario, landscape_of(scenario), path.read_bytes())


class Kept:
    """A gateway that records its commands."""

    def __init__(self) -> None:
        self.commands: list[AnyCommand] = []

    def execute(self, command: AnyCommand, now_us: int) -> None:
        self.commands.append(command)

    def read_back(self, recognise: object, now_us: int) -> None:
        """Report no vehicle."""


class Again(NamedTuple):
    service: Engine
    guidance: BurnFlight
    executed: list[AnyCommand]
    journal: Journal
    ordered: set[tuple[str, int]]  # drops counted by the interlock


def continued(flown: Burn, path: Path) -> Again:
    """Continue from a truncated journal, as the daemon does."""
    scenario, landscape, _ = flown
    digest = landscape.digest()
    cut_off = unfinished(path, Known(scenario, landscape), scenario)
    assert cut_off is not None
    journal = Journal(path, header_of(scenario, digest, ""), durable=True, rest=cut_off.rest())
    core, kept = Core(scenario, landscape), Kept()
    fires = (cameras_of(scenario, landscape), RunEstimate(scenario, landscape))
    gateways = {NAME: cast(Gateway, kept)}
    service = Engine(scenario, core, *fires, journal, StateView(scenario, landscape, 0), gateways)
    replay(cut_off, service)
    assert kept.commands == []
    plans = service.status()["plans"]
    ordered = {(plan["plan_hash"], number) for plan in plans for number in plan["ordered"]}
    service.resume(cut_off.missing, resumed(cut_off.last_us, 5.0), 0)
    return Again(service, burn_flight(core.guidance), kept.commands, journal, ordered)


def cuts(journal: bytes) -> dict[str, int]:
    """Yield the lines after which a kill matters: the first of each type, and the last line."""
    lines = journal.splitlines(keepends=True)
    ends = np.cumsum([len(line) for line in lines]).tolist()

    def first(kind: str, number: int = 0) -> int:
        found = [place for place, line in enumerate(lines) if f'"type":"{kind}"'.encode() in line]
        return int(found[number])

    return {
        "in the approval": ends[first("Approved")] - 3,
        "in an order to drop": ends[first("Drop", 2)] - 20,
        "after an order to drop": ends[first("Drop", 2)],
        "in the word that it fell": ends[first("DropFinished", 2)] - 1,
        "at the end": ends[-1],
    }


def test_the_state_is_restored_and_the_approval_is_void(flown: Burn, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    for where, cut in cuts(flown.journal).items():
        path.write_bytes(flown.journal[:cut])
        events = [entry.content for entry in SegmentReader(path) if entry.is_event]
        counts = Counter(type(event).__name__ for event in events)
        again = continued(flown, path)
        again.journal.close()

        entries = [entry.content for entry in SegmentReader(path)]
        dropped = {(each.plan_hash, each.number) for each in entries if isinstance(each, Drop)}
        guidance = again.guidance
        spheres = guidance.state.account.spheres
        assert {(each.plan_hash, each.number) for each in spheres} == dropped, where
        assert all(each.outcome != "ordered" for each in spheres), where
        lit_m = {(x, y) for x, y, _ in guidance.state.fire._sources.tolist()}
        assert {each.falls_m for each in spheres if each.counts} <= lit_m, where
        assert flown.scenario.burn is not None
        assert guidance.state.account.left == flown.scenario.burn.spheres - len(dropped)
        assert len(guidance.state.fire.log.held()) == counts["Corrected"], where
        assert len(again.service.statistics.vehicles[NAME].drops) == len(dropped)
        assert (guidance.approvals.plan, guidance.approvals.approval) == (None, None), where
        assert not guidance.checklist.complete
        assert again.ordered == dropped, where
        plans = again.service.status()["plans"]
        assert all(plan["approved"] is None for plan in plans), where
        assert not any(isinstance(command, Drop) for command in again.executed), where
        result = verify(path)
        assert (result.difference, result.cut_at_line) == (None, None), where


def test_a_kill_between_an_event_and_its_commands_is_no_difference(
    flown: Burn, tmp_path: Path
) -> None:
    lines = flown.journal.splitlines(keepends=True)
    approved = next(place for place, line in enumerate(lines) if b'"type":"Approved"' in line)
    path = tmp_path / "journal.jsonl"
    path.write_bytes(b"".join(lines[: approved + 1]))
    result = verify(path)
    assert (result.difference, result.cut_at_line) == (None, approved + 2)
    journal = Journal(path, {}, durable=True, rest=_rest(path))
    journal.end()
    journal.close()
    assert "the journal lacks" in str(verify(path).difference)


def _rest(path: Path) -> Rest:
    reader = SegmentReader(path)
    for _ in reader:
        pass
    return reader.rest


def test_the_fire_is_lit_where_it_was(flown: Burn, tmp_path: Path) -> None:
    """Compare with the true fire of a service that was never killed."""
    path = tmp_path / "journal.jsonl"
    path.write_bytes(flown.journal)
    again = continued(flown, path)
    scenario, landscape, _ = flown
    truth = SimulatedFire(fire_of(scenario, landscape), landscape)
    falls: dict[int, tuple[float, float]] = {}
    assert scenario.burn is not None
    for entry in SegmentReader(path):
        thing = entry.content
        if isinstance(thing, Drop):
            falls[thing.number] = (thing.lat_deg, thing.lon_deg)
        elif isinstance(thing, Telemetry):
            truth.advance(thing.at_us)
        elif isinstance(thing, IgnitionReported):
            truth.light(thing.points, thing.lit_at_us / 1e6)
        elif isinstance(thing, DropFinished) and not thing.refused:
            truth.light([falls[thing.number]], thing.at_us / 1e6 + scenario.burn.ignition_delay_s)
    again.journal.close()
    later_us = 400_000_000
    truth.advance(later_us)
    again.service.estimate.advance(later_us)
    assert len(falls) > 3
    burned = np.isfinite(truth.fire.arrival_time_s)
    assert np.array_equal(burned, np.isfinite(again.service.estimate.fire.arrival_time_s))


def test_nothing_is_dropped_or_begun_before_a_new_list_and_a_new_approval(
    flown: Burn, tmp_path: Path
) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(flown.journal[: cuts(flown.journal)["after an order to drop"]])
    again = continued(flown, path)
    service, guidance = again.service, again.guidance
    fix = service.statistics.vehicles[NAME].fix
    assert fix is not None
    at_us = fix[0] + 5_000_000
    assert guidance.phase != "flying"
    moved = partial(Telemetry, vehicle=NAME, lat_deg=fix[1], lon_deg=fix[2],
                    altitude_amsl_m=fix[3] + 60.0, altitude_relative_m=75.0,
                    velocity_north_m_s=0.0, velocity_east_m_s=0.0, heading_deg=0.0)  # fmt: skip
    service.handle_events([VehicleConnected(at_us, NAME, "ardupilot copter", False)], 0)
    service.handle_events([GpsFixChanged(at_us, NAME, True, "3d")], 0)
    for step in range(60):
        service.handle_events([moved(at_us=at_us + step * 100_000)], 0)
    proposed = guidance.approvals.plan_hash
    assert proposed
    before = cuts_hash(flown.journal)
    assert proposed != before
    service.submit(Approved(at_us + 6_000_000, *OPERATOR_FIELDS, before), 0)
    assert guidance.approvals.approval is None
    assert flown.scenario.burn is not None
    for item in flown.scenario.burn.go_items:
        service.submit(ChecklistAnswered(at_us + 6_000_000, *OPERATOR_FIELDS, item, True), 0)
    for step in range(60, 70):
        service.handle_events([moved(at_us=at_us + step * 100_000)], 0)
    again.journal.close()
    unwanted = [c for c in again.executed if isinstance(c, Drop | UploadMission | StartMission)]
    assert unwanted == []
    events = [entry.content for entry in SegmentReader(path) if entry.is_event]
    assert sum(isinstance(event, Resumed) for event in events) == 1


def cuts_hash(journal: bytes) -> str:
    """Return the hash of the first plan that was approved."""
    line = next(line for line in journal.splitlines() if b'"type":"Approved"' in line)
    return line.split(b'"plan_hash":"')[1][:64].decode()
