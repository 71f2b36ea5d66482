"""Behaviour of the service when a vehicle's autopilot or pilot takes control."""

import errno
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from autopilot_bridge.links.memory_link import MemoryLink
from mission_service.commands import (
    AnyCommand,
    DirectionDecision,
    Hold,
    ProposeMission,
    StartMission,
    UploadMission,
    WithdrawMission,
)
from mission_service.events import (
    SERVICE,
    Aborted,
    AnyEvent,
    CommandFinished,
    GpsFixChanged,
    LandedStateChanged,
    MissionAccepted,
    MissionRefused,
    MissionRequested,
    OrderGiven,
    Resumed,
)
from mission_service.runtime.gateway import printable
from tests.service.people_flights import ANN, Flight, Fly, flights_in

STACKS = ("px4", "ardupilot")


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


def on(stack: str) -> str:
    return f'vehicles.0.stack="{stack}"'


def times_s(lines: list[AnyEvent | AnyCommand], kind: type[AnyCommand]) -> list[float]:
    """Return the times of commands of a type, by the event that each follows."""
    found, at_s = [], 0.0
    for line in lines:
        if hasattr(line, "at_us"):
            at_s = line.at_us / 1e6
        elif isinstance(line, kind):
            found.append(at_s)
    return found


def alarm(flight: Flight, name: str) -> str:
    """Return the text of an alarm of hawk; empty if there is none."""
    raised = flight.state_view.alarms.get(f"{name}/hawk")
    return "" if raised is None else raised.text


def order(flight: Flight, what: str, confirmed: bool = False, by: str = "ann") -> list[str]:
    return flight.submit(OrderGiven(flight.now_us, by, "desk", "hawk", what, confirmed))  # type: ignore[arg-type]


def until_landed(flight: Flight) -> None:
    for _ in range(200):
        flight.run(10.0)
        if not flight.state_view.vehicles["hawk"].armed:
            return
    raise AssertionError("it has not landed")


def test_ordered_home_after_a_refused_start_it_lands_and_stays(fly: Fly) -> None:
    flight = fly(on("px4"))
    flight.run(400.0)
    order(flight, "hold")
    flight.run(10.0)
    # A start that is refused in flight, as by PX4 1.17 and ArduPlane 4.6.2.
    order(flight, "resume")
    refused = CommandFinished(flight.now_us, "hawk", "start mission", False, "denied")
    flight.sim.service.handle_events([refused], flight.sim.link_us)
    order(flight, "return")
    flight.run(60.0)
    flight.sim.rigs[0].client.command("land", flight.sim.link_us)  # as its pilot would order
    until_landed(flight)
    landed_s = flight.now_s
    flight.run(300.0)
    assert not flight.state_view.vehicles["hawk"].armed
    assert not flight.sim.rigs[0].mock.flight.armed
    order(flight, "start")
    flight.run(20.0)
    assert not flight.sim.rigs[0].mock.flight.armed  # it has landed far from home
    takeoff = OrderGiven(flight.now_us, *ANN, "hawk", "takeoff", override="it lies on a meadow")
    flight.submit(takeoff)
    flight.run(60.0)
    assert flight.sim.rigs[0].mock.flight.armed
    starts = times_s(flight.over(), StartMission)
    assert not [at_s for at_s in starts if landed_s <= at_s < landed_s + 300.0]


@pytest.mark.parametrize("stack", STACKS)
def test_an_engine_failure_is_reported_and_the_vehicle_left_alone(fly: Fly, stack: str) -> None:
    flight = fly(on(stack))
    flight.run(400.0)
    assert not alarm(flight, "thrust")
    failed_s = flight.now_s
    flight.sim.rigs[0].mock.flight.fail_engine(True)
    flight.run(4.0)
    # Sink rates at detection: 2.4 m/s in level flight, 3 m/s in a climb.
    assert re.match(r"hawk: sinks at (2\.4|3) m/s with 100 % throttle", alarm(flight, "thrust"))
    assert flight.state_view.alarms["thrust/hawk"].severity == "severe"
    for kind in (Hold, StartMission):
        assert not [at_s for at_s in times_s(flight.over(), kind) if at_s >= failed_s]
    flight.sim.rigs[0].mock.flight.fail_engine(False)
    flight.run(15.0)
    assert not alarm(flight, "thrust")


@pytest.mark.parametrize("stack", STACKS)
def test_in_a_failsafe_it_is_left_until_an_order_is_confirmed(fly: Fly, stack: str) -> None:
    flight = fly(on(stack))
    flight.run(400.0)
    flight.sim.rigs[0].mock.battery_percent = 10.0
    flight.run(3.0)
    assert flight.mode == "return"
    assert "not ordered" in alarm(flight, "mode")
    assert alarm(flight, "autopilot")
    assert flight.state_view.alarms["front/hawk"].severity == "severe"
    # The order at the end of the service, an abort and an unconfirmed order do not end it.
    (left,) = order(flight, "hold", by=SERVICE)
    assert "stays in mode" in left
    flight.run(5.0)
    flight.submit(Aborted(flight.now_us, *ANN))
    flight.run(5.0)
    (question,) = order(flight, "hold")
    assert question.startswith("confirm:")
    assert flight.state_view.vehicles["hawk"].order == "hold"  # the hold of the abort
    flight.run(20.0)
    assert flight.mode == "return"
    order(flight, "hold", confirmed=True)
    flight.run(5.0)
    assert flight.mode == "hold"
    assert alarm(flight, "mode") == ""
    holds = times_s(flight.over(), Hold)
    assert len(holds) == 1


@pytest.mark.parametrize("stack", STACKS)
def test_a_breached_fence_is_reported_and_the_vehicle_left_alone(fly: Fly, stack: str) -> None:
    flight = fly(on(stack))
    flight.run(400.0)
    began_s = flight.now_s
    flight.sim.rigs[0].mock.breach_fence(True)
    flight.run(2.0)
    assert "not ordered" in alarm(flight, "mode")
    assert alarm(flight, "autopilot") or alarm(flight, "fence")
    flight.run(240.0)
    assert flight.mode != "mission"
    lines = flight.over()
    for kind in (UploadMission, StartMission, Hold, DirectionDecision):
        assert not [at_s for at_s in times_s(lines, kind) if at_s > began_s + 1.5], kind


def test_a_fence_that_holds_it_right_after_an_upload_is_reported_too(fly: Fly) -> None:
    """The hold may belong to the upload; the state reported after it decides (PX4 1.17)."""
    flight = fly(on("px4"))
    flight.run(400.0)
    uploads = flight.state_view.vehicles["hawk"].uploads_accepted
    flight.submit(MissionRequested(flight.now_us, *ANN, "hawk"))
    while flight.state_view.vehicles["hawk"].uploads_accepted == uploads:
        flight.run(0.5)
    flight.sim.rigs[0].mock.breach_fence(True)
    flight.run(4.0)
    assert flight.mode == "hold"
    assert "not ordered" in alarm(flight, "mode")
    flight.run(60.0)
    assert flight.mode == "hold"


def test_without_a_fix_nothing_is_decided_seen_or_sent(fly: Fly) -> None:
    flight = fly()
    flight.run(500.0)
    # Dead-reckoned positions continue: for a minute on ArduPlane 4.6.2 and PX4 1.17 (observed).
    lost = GpsFixChanged(flight.now_us, "hawk", False, "no fix")
    flight.sim.service.handle_events([lost], flight.sim.link_us)
    began_s, seen = flight.now_s, flight.state_view.statistics.observations
    assert flight.state_view.alarms["position/hawk"].severity == "severe"
    flight.run(30.0)
    assert flight.state_view.statistics.observations == seen
    found = GpsFixChanged(flight.now_us, "hawk", True, "3d")
    flight.sim.service.handle_events([found], flight.sim.link_us)
    flight.run(20.0)
    assert flight.state_view.statistics.observations > seen
    lines = flight.over()
    for kind in (UploadMission, DirectionDecision):
        assert not [at_s for at_s in times_s(lines, kind) if began_s < at_s < began_s + 30.0], kind


def test_an_unanswered_proposal_is_withdrawn_and_an_operator_request_is_kept(fly: Fly) -> None:
    flight = fly('mission.approval="each"')
    flight.run(30.0)
    first = flight.state_view.missions["hawk"].proposed
    assert first is not None
    flight.submit(MissionAccepted(flight.now_us, *ANN, "hawk", first.mission_hash))
    flight.run(100.0)
    flight.submit(MissionRequested(flight.now_us, *ANN, "hawk"))
    flight.run(3.0)
    requested = flight.state_view.missions["hawk"].proposed
    assert requested is not None
    assert "requested by ann" in requested.why
    flight.run(66.0)
    again = flight.state_view.missions["hawk"].proposed
    assert again is not None
    assert again.mission_id != requested.mission_id
    assert "requested by ann" in again.why
    withdrawn = [line for line in flight.over() if isinstance(line, WithdrawMission)]
    assert requested.mission_id in [line.mission_id for line in withdrawn]


def test_a_refused_mission_is_not_proposed_again_while_nothing_differs(fly: Fly) -> None:
    flight = fly('mission.approval="each"')
    flight.run(30.0)
    first = flight.state_view.missions["hawk"].proposed
    assert first is not None
    flight.submit(MissionRefused(flight.now_us, *ANN, "hawk", first.mission_hash))
    flight.run(300.0)  # on the ground there is no difference
    assert flight.state_view.missions["hawk"].proposed is None
    flight.submit(MissionRequested(flight.now_us, *ANN, "hawk"))
    flight.run(5.0)
    assert flight.state_view.missions["hawk"].proposed is not None
    proposed = [line for line in flight.over() if isinstance(line, ProposeMission)]
    assert len(proposed) == 2


def test_a_hold_that_has_no_answer_yet_is_not_repeated(fly: Fly) -> None:
    """A repetition would replace the command in progress, and neither would be acknowledged."""
    flight = fly()
    flight.run(400.0)
    flight.sim.rigs[0]._up = MemoryLink(loss=1.0)
    order(flight, "hold")
    flight.run(60.0)
    flight.sim.rigs[0]._up = MemoryLink()
    flight.run(20.0)
    assert flight.mode == "hold"
    refused = [line.text for line in flight.state_view.announcements if "replaced it" in line.text]
    assert refused == []
    holds = times_s(flight.over(), Hold)
    assert len(holds) < 10


def test_a_replaced_order_is_announced_as_such_and_raises_no_alarm(fly: Fly) -> None:
    flight = fly()
    flight.run(400.0)
    flight.sim.rigs[0]._up = MemoryLink(loss=1.0)
    order(flight, "hold")
    flight.run(1.0)
    order(flight, "return")
    flight.run(1.0)
    texts = [line.text for line in flight.state_view.announcements]
    assert "hold: return replaced it" in texts
    assert "order/hawk/hold" not in flight.state_view.alarms


def test_the_unwatched_front_is_reported_again_after_a_restart(fly: Fly) -> None:
    flight = fly()
    flight.run(500.0)
    order(flight, "hold")
    flight.run(5.0)
    assert "front/hawk" in flight.state_view.alarms
    flight.state_view.clear_all_but("abort")
    flight.submit(Resumed(flight.now_us, "service", "", 1.0))
    assert "front/hawk" in flight.state_view.alarms


def test_the_front_counts_as_monitored_only_when_a_vehicle_observes_it_again(fly: Fly) -> None:
    flight = fly()
    flight.run(500.0)
    assert "front/hawk" not in flight.state_view.alarms
    image = flight.sim.service._seen_at
    order(flight, "hold")
    flight.run(5.0)
    flight.sim.service._seen_at = lambda fix: iter(())  # type: ignore[method-assign]
    order(flight, "resume")
    flight.run(20.0)
    assert flight.mode == "mission"
    assert "front/hawk" in flight.state_view.alarms
    flight.sim.service._seen_at = image  # type: ignore[method-assign]
    flight.run(10.0)
    assert "front/hawk" not in flight.state_view.alarms


def test_a_disarmed_vehicle_does_not_monitor_the_front(fly: Fly) -> None:
    flight = fly()
    flight.run(500.0)
    flight.sim.rigs[0].mock.reboot(flight.sim.link_us)
    flight.run(5.0)
    assert not flight.state_view.vehicles["hawk"].armed
    assert "front/hawk" in flight.state_view.alarms


def test_a_text_of_the_autopilot_is_one_printable_line() -> None:
    assert printable("\x1b[31m\nlow\r\tbattery\x00") == "[31m low battery"


def test_a_vehicle_on_the_ground_in_its_mission_is_reported(fly: Fly) -> None:
    """Neither stack sends a text about a failed engine: PX4 1.17 sank and landed in its mission."""
    flight = fly()
    flight.run(500.0)
    assert alarm(flight, "front") == ""
    down = LandedStateChanged(flight.now_us, "hawk", "on ground")
    flight.sim.service.handle_events([down], flight.sim.link_us)
    assert "on the ground" in alarm(flight, "landed")
    flight.run(10.0)
    assert "no vehicle monitors the whole front" in alarm(flight, "front")
    up = LandedStateChanged(flight.now_us, "hawk", "in air")
    flight.sim.service.handle_events([up], flight.sim.link_us)
    assert alarm(flight, "landed") == ""


def test_an_abort_leaves_a_failsafe_that_could_not_be_recorded(
    fly: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk the core processes no events; the newest mode is from the autopilot itself."""
    flight = fly()
    flight.run(400.0)
    write = os.write

    def full(file: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(flight.journal, "durable", True)
    monkeypatch.setattr("mission_service.journal.journal_file.os.write", full)
    flight.sim.rigs[0].mock.battery_percent = 10.0
    flight.run(5.0)
    assert "mode return" in alarm(flight, "unrecorded")
    flight.submit(Aborted(flight.now_us, *ANN))
    flight.run(10.0)
    monkeypatch.setattr("mission_service.journal.journal_file.os.write", write)
    assert flight.sim.service.retry(flight.now_us, flight.sim.link_us)
    flight.run(10.0)
    assert flight.mode == "return"
    assert "not ordered" in alarm(flight, "mode")
    assert alarm(flight, "unrecorded") == ""
