"""A burn while the disk is full: each sphere counts as a source of fire, and drops continue."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mission_service.commands import Drop
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import AnyEvent, AnyOperatorEvent, DropFinished
from mission_service.fire.best_fire import Ignited
from mission_service.fire.ignition_reports import ignition_reports_of
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.burn.controller import BurnFlight, burn_flight
from mission_service.guidance.burn.interlock import Interlock
from mission_service.guidance.burn.sphere_account import Sphere
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.replay.verification import verify
from mission_service.simulation.sim import Simulation
from mission_service.simulation.simulated_crew import SimulatedCrew
from tests.service.test_guarded_journal import no_room

SMALL = ("landscape.rows=120", "landscape.cols=120", "deploy_at_s=5")


class BurnOnDisk:
    """The shipped burn in virtual time; its crew sends no requests while the disk is full."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "journal.jsonl"
        self.scenario = scenario = load_scenario("burn", SMALL)
        assert scenario.burn_flown is not None
        landscape, crew = landscape_of(scenario), SimulatedCrew(scenario.burn_flown)
        self.ignition_delay_s = scenario.burn_flown.ignition_delay_s
        self.is_full = False

        def due(now_us: int, core: Core) -> list[AnyOperatorEvent]:
            return [] if self.is_full else crew.due(now_us, core)

        header = header_of(scenario, landscape.digest(), "")
        journal = Journal(self.path, header, durable=True)
        self.simulation = Simulation(scenario, journal, landscape, due)

    @property
    def guidance(self) -> BurnFlight:
        return burn_flight(self.simulation.service.core.guidance)

    @property
    def spheres(self) -> list[Sphere]:
        return self.guidance.state.account.spheres

    def fly(self, seconds: float) -> None:
        self.simulation.run_until(self.simulation.clock.now_us / 1e6 + seconds)

    def fly_until(self, reached: Callable[[], bool]) -> None:
        end_us = self.simulation.clock.now_us + 900_000_000
        while not reached():
            assert self.simulation.clock.now_us < end_us
            self.simulation.step()

    def retry(self) -> None:
        self.is_full = False
        assert self.simulation.service.retry(self.simulation.clock.now_us, self.simulation.link_us)

    def recorded(self, kind: type) -> list[Any]:
        self.simulation.service.recording.journal.close()
        contents = [entry.content for entry in SegmentReader(self.path)]
        return [each for each in contents if isinstance(each, kind)]


def test_a_drop_whose_reply_came_on_a_full_disk_is_in_the_fire(tmp_path: Path) -> None:
    burn = BurnOnDisk(tmp_path)
    burn.fly_until(lambda: len(burn.spheres) == 2 and burn.spheres[1].outcome == "ordered")
    sphere = burn.spheres[1]
    with no_room(burn.path, 10):
        burn.is_full = True
        burn.fly(20.0)
        assert burn.simulation.service.recording.trouble == "disk full"
        assert sphere.outcome == "ordered"
    burn.retry()
    assert [each.outcome for each in burn.spheres] == ["done", "unknown"]
    burn.fly(20.0)
    latest_s = sphere.at_us / 1e6 + burn.ignition_delay_s
    assert burn.guidance.estimated_fire.burns_s(*sphere.falls_m) <= latest_s
    finished = [each for each in burn.recorded(DropFinished) if each.number == sphere.number]
    assert [each.outcome for each in finished] == ["unknown"]
    assert verify(burn.path).difference is None


def test_a_drop_whose_command_was_not_journalled_has_an_unknown_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    burn, works = BurnOnDisk(tmp_path), os.write

    def fails(file: int, data: memoryview) -> int:
        if bytes(data[:26]) == b'{"command":{"type":"Drop",':
            raise OSError(28, "No space left on device")
        return works(file, data)

    burn.fly_until(lambda: burn.guidance.phase == "flying")
    monkeypatch.setattr(os, "write", fails)
    burn.fly_until(lambda: bool(burn.simulation.service.recording.trouble))
    assert [each.outcome for each in burn.spheres] == ["ordered"]
    burn.is_full = True
    burn.fly(20.0)
    monkeypatch.setattr(os, "write", works)
    given: list[object] = []
    estimate = burn.simulation.service.estimate
    monkeypatch.setattr(estimate, "_queue", given.append)
    burn.retry()
    assert [each.outcome for each in burn.spheres] == ["unknown"]
    assert len(burn.recorded(Drop)) == 1
    replayed = ignition_reports_of(burn.scenario)
    ignitions = []
    for entry in SegmentReader(burn.path):
        if isinstance(entry.content, AnyEvent):
            ignitions.append(replayed.reported_in(entry.content))
        else:
            replayed.on_command(entry.content)
    live = [each.at_s for each in given if isinstance(each, Ignited)]
    assert live == [each.at_s for each in ignitions if each is not None][-1:]
    assert live == [burn.spheres[0].at_us / 1e6 + burn.ignition_delay_s]
    assert verify(burn.path).difference is None


def test_the_next_line_drops_after_a_full_disk(tmp_path: Path) -> None:
    """The number of satellites does not change, so the client reports the GPS fix only once."""
    burn = BurnOnDisk(tmp_path)
    burn.fly_until(lambda: len(burn.spheres) == 2)
    with no_room(burn.path, 10):
        burn.is_full = True
        burn.fly(20.0)
    burn.retry()
    burn.fly_until(lambda: burn.guidance.phase == "flying")
    burn.fly_until(lambda: burn.guidance.phase != "flying")
    later = burn.spheres[2:]
    assert later
    assert {each.outcome for each in later} == {"done"}


def test_a_line_without_any_drop_is_planned_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    burn = BurnOnDisk(tmp_path)
    monkeypatch.setattr(Interlock, "refuses", lambda lock, drop, at_us: "refused in a test")
    state = burn.guidance.state
    area_left = state.area_left
    burn.fly_until(lambda: burn.guidance.phase == "flying")
    burn.fly_until(lambda: burn.guidance.phase == "planning")
    assert {each.outcome for each in burn.spheres} == {"refused"}
    assert (state.line, state.area_left) == (1, area_left)
