"""Kills before, during and after the sending of an order, while the vehicle flies on.

Virtual time, real frames and real journals: the mocks continue, and all else is restored from
files.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from autopilot_bridge.missions.transfer import TransferResult
from mission_service.commands import (
    Announce,
    AnyCommand,
    Hold,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario, flying, load_scenario
from mission_service.events import MissionReadBack, OrderGiven, Resumed, UploadFinished
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.journal.recovery import resumed, unfinished
from mission_service.journal.segments import newest_state
from mission_service.journal.snapshot import Frozen, Known, write
from mission_service.live.daemon import replay
from mission_service.replay.verification import verify
from mission_service.runtime.gateway import Gateway
from mission_service.simulation.sim import Simulation
from tests.service.test_formation_sim import at_once

FROM_S = 3590.0
DOWN_US = 4_000_000


class KilledError(Exception):
    """Simulates a kill."""


class Flight:
    """A scenario in virtual time that can be killed and restarted."""

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        self.scenario, self.landscape = scenario, landscape_of(scenario)
        self.path = folder / "journal.jsonl"
        self.shared = Known(scenario, self.landscape)
        header = header_of(scenario, self.landscape.digest(), "")
        self.simulation = self._with(Journal(self.path, header, durable=True))

    def _with(self, journal: Journal) -> Simulation:
        return Simulation(self.scenario, journal, self.landscape)

    def fly(self, seconds: float) -> None:
        self.simulation.run_until(self.simulation.clock.now_us / 1e6 + seconds)

    def fly_until(self, kind: type, number: int = 1) -> None:
        """Fly until the n-th order of a kind is to be carried out, and kill the service there."""
        for rig in self.simulation.rigs:
            rig.gateway.execute = self._stopping(rig.gateway, kind, number)  # type: ignore[method-assign,assignment]
        with pytest.raises(KilledError):
            self.fly(400.0)

    def _stopping(
        self, gateway: Gateway, kind: type, number: int
    ) -> Callable[[AnyCommand, int], None]:
        execute, seen = gateway.execute, 0

        def stopping(command: AnyCommand, now_us: int) -> None:
            nonlocal seen
            if isinstance(command, kind):
                seen += 1
                if seen >= number:
                    raise KilledError
            execute(command, now_us)

        return stopping

    def keep_state(self) -> None:
        """Write a snapshot, as the daemon does regularly."""
        service = self.simulation.service
        frozen = Frozen(service.snapshot_fields(), self.shared)
        write(newest_state(self.path), frozen, service.recording.journal.rest)

    def begin_again(self, down_us: int = DOWN_US) -> None:
        """Restart as the daemon does; the vehicles have flown on meanwhile."""
        before = self.simulation
        before.service.recording.journal.close()
        cut_off = unfinished(self.path, self.shared, self.scenario)
        assert cut_off is not None
        journal = Journal(self.path, {}, durable=True, rest=cut_off.rest())
        again = self.simulation = self._with(journal)
        for rig, old in zip(again.rigs, before.rigs, strict=True):
            rig.mock = old.mock
        link_us = before.link_us if before._heap else 0
        for number, rig in enumerate(again.rigs):
            again._heap[number] = (link_us, number)
            while (rig.mock.next_timer() or 0) < link_us + down_us:
                rig.mock.handle_timer(rig.mock.next_timer() or 0)
                rig.mock.data_to_send()
        again._heap = [(link_us + down_us, number) for number in range(len(again.rigs))]
        if cut_off.objects is not None:
            again.service.restore(cut_off.objects)
        replay(cut_off, again.service)
        again.core, again.estimate = again.service.core, again.service.estimate
        announcements = resumed(max(cut_off.last_us, again.service.statistics.at_us), down_us / 1e6)
        again.clock.go_on(announcements.at_us, 0)
        again.service.resume(cut_off.missing, announcements, link_us + down_us)

    def give_order(self, order: str) -> None:
        asked = OrderGiven(self.simulation.clock.now_us, "ann", "", "", order)  # type: ignore[arg-type]
        self.simulation.service.submit(asked, self.simulation.link_us)

    @property
    def modes(self) -> list[str]:
        return [vehicle.mode for vehicle in self.simulation.core.vehicles.values()]

    def after_resumed(self) -> list[Any]:
        """Return the journal after the restart; it must equal the result of a replay."""
        result = verify(self.path)
        assert (result.difference, result.cut_at_line) == (None, None)
        entries: list[Any] = [entry.content for entry in SegmentReader(self.path)]
        last = max(place for place, each in enumerate(entries) if isinstance(each, Resumed))
        return entries[last:]


def alone(stack: str, **changes: object) -> Scenario:
    scenario = flying(load_scenario("default", (f"start_s={FROM_S}",)))
    section = scenario.vehicles[0].model_copy(update={"stack": stack, **changes})
    return scenario.model_copy(update={"vehicles": (section,)})


def kinds(entries: list[Any]) -> list[type]:
    return [type(each) for each in entries]


@pytest.fixture(params=["px4", "ardupilot"])
def flight(request: pytest.FixtureRequest, tmp_path: Path) -> Flight:
    return Flight(tmp_path, alone(request.param))


def test_a_mission_that_never_left_is_not_counted_on_and_the_one_before_is_flown_on(
    flight: Flight,
) -> None:
    flight.fly(60.0)
    flight.fly_until(UploadMission, 2)
    flight.begin_again()
    flight.fly(25.0)
    entries = flight.after_resumed()
    held = next(each for each in entries if isinstance(each, MissionReadBack))
    sent = [entry.content for entry in SegmentReader(flight.path)]
    accepted = [each.mission_id for each in sent if isinstance(each, UploadFinished)]
    assert held.mission_id in accepted
    assert UploadMission not in kinds(entries)[: entries.index(held)]
    assert StartMission not in kinds(entries)
    assert flight.modes == ["mission"]
    vehicle = flight.simulation.core.vehicles["hawk"]
    assert vehicle.flown_line is not None or vehicle.pending is not None


@pytest.mark.parametrize("later_s", [0.05, 0.3])
def test_an_upload_that_was_cut_off_ends_in_a_mission_that_is_flown(
    flight: Flight, later_s: float
) -> None:
    flight.fly(60.0)
    flight.keep_state()
    before = flight.simulation.core._missions._next_id
    while flight.simulation.core._missions._next_id == before:
        flight.simulation.step()
    flight.fly(later_s)
    flight.begin_again()
    flight.fly(40.0)
    entries = flight.after_resumed()
    assert MissionReadBack in kinds(entries)
    assert flight.modes == ["mission"]
    vehicle = flight.simulation.core.vehicles["hawk"]
    assert vehicle.flown_line is not None or vehicle.pending is not None


def test_a_start_that_never_left_is_ordered_again(flight: Flight) -> None:
    flight.fly_until(StartMission)
    flight.begin_again()
    flight.fly(40.0)
    entries = flight.after_resumed()
    held = next(each for each in entries if isinstance(each, MissionReadBack))
    assert held.mission_id == 1
    assert kinds(entries).index(StartMission) > entries.index(held)
    assert flight.simulation.core.vehicles["hawk"].availability.airborne


def test_a_hold_and_a_return_that_never_left_are_ordered_again(flight: Flight) -> None:
    flight.fly(60.0)
    for order, kind, mode in (("hold", Hold, ("hold", "loiter")), ("return", Return, ("return",))):
        execute = flight.simulation.rigs[0].gateway.execute
        flight.simulation.rigs[0].gateway.execute = flight._stopping(  # type: ignore[method-assign,assignment]
            flight.simulation.rigs[0].gateway, kind, 1
        )
        with pytest.raises(KilledError):
            flight.give_order(order)
        flight.simulation.rigs[0].gateway.execute = execute  # type: ignore[method-assign]
        flight.begin_again()
        flight.fly(15.0)
        assert flight.modes[0] in mode, order
        assert flight.simulation.core.vehicles["hawk"].ordered == ("hold" if kind is Hold else "")
    assert kind in kinds(flight.after_resumed())


def test_a_mission_of_another_sender_is_replaced_and_so_is_an_unreadable_one(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight.fly(60.0)
    flight.keep_state()
    (rig,) = flight.simulation.rigs
    mine = rig.mock.missions.items
    rig.mock.missions.items = [*mine[:-1], replace(mine[-1], z=mine[-1].z + 30.0)]
    flight.begin_again()
    flight.fly(20.0)
    entries = flight.after_resumed()
    held = next(each for each in entries if isinstance(each, MissionReadBack))
    assert held.mission_id == 0
    assert held.items
    assert UploadMission in kinds(entries)[entries.index(held) :]

    def unanswered(self: Any, now_us: int) -> list[Any]:
        self.result = TransferResult("failed", "the autopilot did not answer")
        return []

    monkeypatch.setattr("autopilot_bridge.missions.download.MissionDownload.start", unanswered)
    monkeypatch.setattr("autopilot_bridge.missions.ftp.FtpDownload.start", unanswered)
    flight.begin_again()
    flight.fly(10.0)
    held = next(each for each in flight.after_resumed() if isinstance(each, MissionReadBack))
    assert (held.mission_id, held.items) == (0, None)


def test_one_that_landed_unobserved_waits_for_a_start_and_announces_it(flight: Flight) -> None:
    flight.fly(60.0)
    flight.keep_state()
    flight.simulation.rigs[0].mock.reboot(flight.simulation.link_us)
    flight.begin_again()
    flight.fly(30.0)
    entries = flight.after_resumed()
    words = [each.text for each in entries if isinstance(each, Announce)]
    assert any("waits for an operator's order to start" in text for text in words)
    assert StartMission not in kinds(entries)


def test_a_formation_goes_on_with_its_orbits(tmp_path: Path) -> None:
    scenario = flying(load_scenario("virtual-agents"))
    scenario = at_once(scenario.model_copy(update={"vehicles": scenario.vehicles[:2]}))
    flight = Flight(tmp_path, scenario)
    flight.fly(60.0)
    flight.keep_state()
    flight.fly_until(Orbit, 2)
    flight.begin_again()
    flight.fly(25.0)
    orbits_in = ("hold", "guided", "orbit")
    assert all(mode in orbits_in for mode in flight.modes), flight.modes
    entries = flight.after_resumed()
    texts = [each.text for each in entries if hasattr(each, "text")]
    assert not any("not ours" in text for text in texts), texts
    for name in flight.simulation.core.vehicles:
        mine = [each for each in entries if getattr(each, "vehicle", "") == name]
        first = next(place for place, each in enumerate(mine) if isinstance(each, MissionReadBack))
        assert any(isinstance(each, Orbit) for each in mine[first:]), name
        assert not any(isinstance(each, Orbit | UploadMission) for each in mine[:first]), name


def test_a_resumed_formation_member_is_started_when_its_mission_is_read_back(
    tmp_path: Path,
) -> None:
    scenario = flying(load_scenario("virtual-agents"))
    scenario = at_once(scenario.model_copy(update={"vehicles": scenario.vehicles[:2]}))
    flight = Flight(tmp_path, scenario)
    flight.fly_until(Orbit, 2)
    flight.begin_again()
    flight.fly(20.0)
    flight.give_order("hold")
    flight.fly(10.0)
    flight.keep_state()
    flight.begin_again()
    vehicles = flight.simulation.core.vehicles
    while not any(vehicle.availability.online for vehicle in vehicles.values()):
        flight.simulation.step()
    connected = next(name for name, vehicle in vehicles.items() if vehicle.availability.online)
    assert vehicles[connected].unconfirmed is not None
    flight.give_order("resume")
    flight.fly(20.0)
    entries = flight.after_resumed()
    mine = [each for each in entries if getattr(each, "vehicle", "") == connected]
    first = next(place for place, each in enumerate(mine) if isinstance(each, MissionReadBack))
    assert StartMission not in kinds(mine[:first])
    assert StartMission in kinds(mine[first:])
