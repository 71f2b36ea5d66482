"""A burn in flight: drops, and no drop after a fault or a change."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.mock.kinematics import Wind
from benchmarks.burn_frames import SIDE_M, place, small_burn
from firemodel.landscape.default import jacksboro
from mission_service.config.scenario import Scenario
from mission_service.events import (
    Aborted,
    AnyOperatorEvent,
    Approved,
    BurnUnitSet,
    ChecklistAnswered,
    IgnitionReported,
    PersonReported,
    PlanRequested,
    Rejected,
    WindSet,
)
from mission_service.guidance.burn.controller import burn_flight
from mission_service.journal.journal_file import Journal, header_of
from mission_service.replay.verification import verify
from mission_service.simulation.sim import Simulation
from mission_service.simulation.simulated_crew import SimulatedCrew

START_S = 10.0


def scenario(stack: str = "ardupilot", **burn: object) -> Scenario:
    return Scenario.model_validate(small_burn(stack, **burn) | {"deploy_at_s": START_S})


class Burn:
    """A simulation with simulated operators and the events of a test."""

    def __init__(self, journal: Path, loaded: Scenario) -> None:
        assert loaded.burn is not None
        self.path = journal
        landscape = jacksboro(100, 100, 5.0)
        self._journal = Journal(journal, header_of(loaded, landscape.digest(), ""), durable=False)
        self.operators_present = True
        self.operators = SimulatedCrew(loaded.burn)
        self.simulation = Simulation(loaded, self._journal, landscape, self._due)
        (self.rig,) = self.simulation.rigs
        self.guidance = burn_flight(self.simulation.core.guidance)

    def _due(self, now_us: int, core: object) -> list[AnyOperatorEvent]:
        return self.operators.due(now_us, self.simulation.core) if self.operators_present else []

    @property
    def at_s(self) -> float:
        return self.simulation.clock.now_us / 1e6

    @property
    def at_us(self) -> int:
        return self.simulation.clock.now_us

    @property
    def dropped(self) -> int:
        """Return the spheres that the mock's dropper has released, by the commands on its link."""
        releases = (1900.0, 0.0)  # the PWM of a servo, the open command of a gripper
        return sum(value in releases for _, _, _, value in self.rig.mock.outputs)

    @property
    def height_m(self) -> float:
        fix = self.simulation.core.vehicles["kestrel"].availability.fix
        assert fix is not None
        return self.guidance.state.height_m(fix)

    def run(self, for_s: float) -> None:
        self.simulation.run_until(self.at_s + for_s)

    def until_dropping(self) -> None:
        """Fly until the third sphere of the first line has fallen."""
        while self.dropped < 3:
            assert self.at_s < 300.0
            self.run(0.5)

    def submit(self, event: AnyOperatorEvent) -> None:
        self.simulation.service.submit(event, self.simulation.link_us)

    def texts(self) -> list[str]:
        return [line.text for line in self.simulation.service.state_view.announcements]

    def close(self) -> None:
        self._journal.close()


@pytest.fixture
def burn(tmp_path: Path) -> Iterator[Burn]:
    burn = Burn(tmp_path / "journal.jsonl", scenario())
    yield burn
    burn.close()


def assert_stopped(burn: Burn) -> None:
    """Check that from now on no sphere falls, and that the vehicle holds at the safe height."""
    dropped = burn.dropped
    burn.operators_present = False  # no new approvals
    burn.run(45.0)
    assert burn.dropped == dropped
    assert burn.height_m >= 54.0
    assert burn.guidance.approvals.approval is None


@pytest.mark.parametrize("stack", ["ardupilot", "px4"])
def test_a_line_is_dropped_where_it_was_planned(stack: str, tmp_path: Path) -> None:
    burn = Burn(tmp_path / "journal.jsonl", scenario(stack))
    while burn.guidance.state.line == 1:
        assert burn.at_s < 300.0
        burn.run(5.0)
    (plan,) = [text for text in burn.texts() if text.startswith("line 1 proposed")]
    planned = int(plan.split(": ")[1].split()[0])
    assert planned >= 6
    assert burn.dropped == planned
    assert all(sphere.outcome == "done" for sphere in burn.guidance.state.account.spheres)
    assert max(sphere.max_miss_m for sphere in burn.guidance.state.account.spheres) < 3.0
    burn.close()
    assert verify(burn.path).difference is None


def test_nothing_flies_without_approval(burn: Burn) -> None:
    burn.operators_present = False
    burn.run(120.0)
    assert burn.guidance.phase == "proposed"
    assert burn.rig.mock.flight.items == ()
    assert not burn.rig.mock.flight.airborne


def test_approval_before_the_list_is_complete_does_not_count(burn: Burn) -> None:
    burn.run(START_S + 2.0)
    burn.operators_present = False
    burn.submit(
        ChecklistAnswered(burn.at_us, "ada", "boss", burn.guidance.state.burn.go_items[0], go=False)
    )
    burn.submit(Approved(burn.at_us, "ada", "boss", burn.guidance.approvals.plan_hash))
    burn.run(20.0)
    assert any("items are open" in text for text in burn.texts())
    assert burn.rig.mock.flight.items == ()


def amiss(burn: Burn, what: str) -> None:
    now = burn.at_us
    west = [place(x, y) for x, y in ((0, 60), (SIDE_M, 60), (SIDE_M, SIDE_M), (0, SIDE_M))]
    match what:
        case "abort":
            burn.submit(Aborted(now, "ada", "boss"))
        case "rejected":
            burn.submit(Rejected(now, "ada", "boss", burn.guidance.approvals.plan_hash))
        case "no-go":
            burn.submit(
                ChecklistAnswered(
                    now, "ada", "boss", burn.guidance.state.burn.go_items[3], go=False
                )
            )
        case "wind shift":
            burn.submit(WindSet(now, "ada", "boss", 2.0, 90.0))
        case "wind measured":
            burn.rig.mock.flight.wind = Wind(0.0, 6.0)
            burn.run(25.0)
        case "fire ahead":
            line = (place(70.0, 20.0), place(SIDE_M, 60.0))
            burn.submit(IgnitionReported(now, "ada", "boss", line, now - 60_000_000))
        case "person there":
            burn.submit(PersonReported(now, "bob", "boss", "bob", *place(90.0, 60.0), 40.0))
        case "another unit":
            burn.submit(BurnUnitSet(now, "ada", "boss", tuple(west)))
        case "operator absent":
            burn.operators_present = False
            burn.run(16.0)
        case _:
            raise AssertionError(what)


@pytest.mark.parametrize(
    "what",
    [
        "abort",
        "rejected",
        "no-go",
        "wind shift",
        "wind measured",
        "fire ahead",
        "person there",
        "another unit",
        "operator absent",
    ],
)
def test_what_changes_in_flight_stops_it(what: str, tmp_path: Path) -> None:
    loaded = scenario(drop_spacing_m=5.0, max_drops_per_min=60.0, speed_m_s=3.0)
    burn = Burn(tmp_path / "journal.jsonl", loaded)
    burn.until_dropping()
    assert burn.guidance.phase == "flying"
    amiss(burn, what)
    assert burn.guidance.phase != "flying"
    assert_stopped(burn)
    burn.close()
    assert verify(burn.path).difference is None


def slow_down(client: NativeClient, begin_us: int, share: float) -> None:
    """Slow down the autopilot's time since boot in all following frames."""
    wire, taken = mavlink.MAVLink(None), client.receive_data

    def receive(data: bytes, now_us: int) -> None:
        frames = []
        for message in wire.parse_buffer(data) or []:
            if message.get_type() == "GLOBAL_POSITION_INT":
                passed_ms = message.time_boot_ms - begin_us // 1000
                message.time_boot_ms = begin_us // 1000 + round(share * passed_ms)
            wire.srcSystem, wire.srcComponent = message.get_srcSystem(), message.get_srcComponent()
            frames.append(message.pack(wire))
        taken(b"".join(frames), now_us)

    client.receive_data = receive  # type: ignore[method-assign]


def test_a_mission_clock_that_is_slow_keeps_no_drop_going(tmp_path: Path) -> None:
    loaded = scenario(drop_spacing_m=5.0, max_drops_per_min=600.0, speed_m_s=3.0)
    burn = Burn(tmp_path / "journal.jsonl", loaded)
    burn.until_dropping()
    burn.operators_present = False
    link_us, stopped_us, dropped = burn.simulation.link_us, burn.at_us, burn.dropped
    slow_down(burn.rig.client, link_us, 0.1)
    while burn.guidance.phase == "flying":
        assert burn.simulation.link_us < link_us + 120_000_000
        burn.simulation.step()
    burn.close()
    assert burn.dropped > dropped  # it continued at first
    assert burn.at_us < stopped_us + 5_000_000
    assert burn.simulation.link_us < link_us + 17_000_000
    assert any("plan withdrawn: no input from simulated crew" in text for text in burn.texts())
    assert verify(burn.path).difference is None


def test_a_stopped_line_is_planned_and_approved_again(burn: Burn) -> None:
    burn.until_dropping()
    before = burn.guidance.approvals.plan_hash
    amiss(burn, "fire ahead")
    burn.run(60.0)
    texts = burn.texts()
    assert any("plan withdrawn" in text for text in texts)
    assert sum("line 1 proposed" in text for text in texts) >= 2
    assert burn.guidance.approvals.plan_hash != before


def test_a_second_approval_of_the_plan_that_is_flown_changes_nothing(burn: Burn) -> None:
    burn.until_dropping()
    flown, given = burn.guidance._flown, burn.guidance.approvals.approval
    assert flown is not None
    assert given is not None
    drops, missions = flown.next_drop, burn.simulation.core.vehicles["kestrel"].accepted
    burn.submit(Approved(burn.at_us, "bob", given.station, given.plan_hash))
    assert burn.texts()[-1] == f"line 1 is already approved by {given.by}"
    assert burn.guidance.phase == "flying"
    assert burn.guidance._flown is flown
    assert burn.guidance.approvals.approval == given
    burn.run(20.0)
    assert flown.next_drop > drops
    assert burn.simulation.core.vehicles["kestrel"].accepted is missions


def test_a_sphere_that_is_acknowledged_after_the_end_of_its_line_is_a_source_of_fire(
    burn: Burn,
) -> None:
    burn.until_dropping()
    spheres, fire = burn.guidance.state.account.spheres, burn.guidance.state.fire
    while spheres[-1].outcome != "ordered":
        burn.simulation.step()
    burn.submit(Aborted(burn.at_us, "ada", "boss"))
    assert spheres[-1].outcome == "ordered"
    burn.run(5.0)
    assert spheres[-1].outcome == "done"
    assert len(fire.held) == 0
    assert math.isfinite(fire.simulation.ignition_time_s(np.array([spheres[-1].falls_m]))[0])


def test_after_an_abort_nothing_is_planned_before_a_new_request(burn: Burn) -> None:
    burn.until_dropping()
    amiss(burn, "abort")
    burn.run(40.0)
    assert burn.guidance.phase == "waiting"
    burn.submit(PlanRequested(burn.at_us, "ada", "boss"))
    burn.run(3.0)
    assert burn.guidance.phase in ("proposed", "approved", "planning")


def test_a_cut_link_drops_nothing_and_the_flight_ends_high(burn: Burn) -> None:
    burn.until_dropping()
    links = (burn.rig._up, burn.rig._down)
    for link in links:
        link._loss = 1.0
    dropped, before_s = burn.dropped, burn.at_s
    run_links(burn, 90.0)
    (position,) = burn.simulation.service.state_view.telemetry.values()
    assert position.at_us / 1e6 < before_s + 1.0  # no messages were received
    assert burn.dropped == dropped
    assert burn.guidance.approvals.approval is None
    assert burn.rig.mock.flight.motion.altitude_m > 350.0 + 54.0
    for link in links:
        link._loss = 0.0
    burn.operators_present = False
    run_links(burn, 30.0)
    assert burn.dropped == dropped
    assert burn.guidance.phase != "flying"
    assert burn.height_m >= 54.0


def test_a_lost_position_drops_nothing(burn: Burn) -> None:
    burn.until_dropping()
    burn.rig.mock.positions = False
    dropped = burn.dropped
    burn.operators_present = False
    run_links(burn, 3.0)  # long before its autopilot lands without a position
    assert burn.guidance.approvals.approval is None
    run_links(burn, 27.0)
    assert burn.dropped == dropped
    burn.rig.mock.positions = True
    run_links(burn, 40.0)
    assert burn.dropped == dropped
    assert burn.height_m >= 54.0 or not burn.rig.mock.flight.airborne


def test_a_low_battery_sends_it_home_at_the_safe_height(burn: Burn) -> None:
    burn.until_dropping()
    burn.rig.mock.battery_percent = 20.0
    dropped = burn.dropped
    highest_m = 0.0
    for _ in range(60):
        burn.run(0.5)
        highest_m = max(highest_m, burn.height_m)
    assert burn.dropped == dropped
    assert highest_m >= 54.0
    assert any("battery is at 20 %" in text for text in burn.texts())
    assert burn.rig.mock.flight.mode == "rtl"


def test_a_return_by_hand_leaves_no_drop_behind(burn: Burn) -> None:
    burn.until_dropping()
    dropped = burn.dropped
    burn.rig.client.command("return", burn.simulation.link_us)
    burn.run(10.0)
    assert burn.dropped == dropped
    assert burn.guidance.approvals.approval is None
    burn.rig.client.command(
        "resume", burn.simulation.link_us
    )  # the mission on board continues without drops
    burn.operators_present = False
    burn.run(60.0)
    assert burn.dropped == dropped


def run_links(burn: Burn, for_s: float) -> None:
    """Advance by the links' clock: mission time does not advance while no messages are received."""
    until_us = burn.simulation.link_us + round(for_s * 1e6)
    while burn.simulation.link_us < until_us:
        burn.simulation.step()
