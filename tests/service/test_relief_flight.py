"""Reliefs in flight in virtual time: handovers, failures, sign-offs, a restart of the service."""

import math
from pathlib import Path
from typing import Any, cast

import pytest

from autopilot_bridge.mock.failsafe_causes import Battery
from mission_service.commands import Announce, RaiseAlarm
from mission_service.config.scenario import Scenario
from mission_service.core.landings import LANDS_BELOW_M
from mission_service.events import AirspaceClosed, ClearingOrdered, Order, OrderGiven
from mission_service.journal.journal_file import SegmentReader
from mission_service.relief.task_relief import TaskRole
from mission_service.replay.decisions import decide
from mission_service.replay.verification import verify
from mission_service.vehicles.landing_state import LandingPhase
from tests.service.dead_autopilot import Dead
from tests.service.relief_flights import (
    relief_scenario,
    reliefs_in,
    takeoffs_in,
    unsigned_takeoffs_in,
)
from tests.service.test_read_back_missions import Flight as RestartableFlight

MAX_RESUME_M = 50.0


class Flight(RestartableFlight):
    """A flight with reliefs that can be restarted."""

    def texts(self) -> list[str]:
        """Return the shown relief of each vehicle."""
        states = self.simulation.service.state_view.vehicles
        return [state.relief for state in states.values()]

    def role(self, name: str) -> TaskRole:
        reliefs = self.simulation.core._reliefs
        assert reliefs is not None
        return reliefs.task.members[name].role

    def until(self, name: str, role: TaskRole, limit_s: float = 1200.0) -> None:
        end_s = self.now_s + limit_s
        while self.role(name) is not role:
            assert self.now_s < end_s, f"{name} is not {role.value} but {self.role(name).value}"
            self.fly(1.0)

    @property
    def now_s(self) -> float:
        return self.simulation.clock.now_us / 1e6

    def order(self, order: Order, name: str) -> None:
        event = OrderGiven(self.simulation.clock.now_us, "ann", "", name, order)
        self.simulation.service.submit(event, self.simulation.link_us)

    def kill(self, name: str) -> None:
        """Destroy a vehicle: it sends nothing any more."""
        rig = next(each for each in self.simulation.rigs if each.gateway.name == name)
        rig.mock = cast(Any, Dead())
        rig._weather = None

    def mock(self, name: str) -> Any:
        return next(each for each in self.simulation.rigs if each.gateway.name == name).mock

    def over(self) -> list[Any]:
        """Close and verify the journal; return its entries."""
        self.simulation.core.validate_state()
        self.simulation.service.recording.journal.close()
        assert verify(self.path).difference is None
        assert decide(self.path).difference is None
        return [entry.content for entry in SegmentReader(self.path)]


def standing(count: int = 3) -> Scenario:
    return relief_scenario(count, standing_signoff=True)


@pytest.mark.long
def test_each_vehicle_is_relieved_in_the_air_and_its_task_resumed_where_it_was_left(
    tmp_path: Path,
) -> None:
    flight = Flight(tmp_path, standing())
    flight.fly(4.0)
    assert flight.texts() == ["takes off", "stands by", "stands by"]
    flight.until("hawk", TaskRole.ON_TASK)
    hawk = flight.simulation.core.decision_engine.planners["hawk"]
    flight.until("kite", TaskRole.RELIEVES)
    assert flight.role("hawk") is TaskRole.ON_TASK  # the next one takes off before it leaves
    assert flight.texts()[0] == "on task"
    assert flight.texts()[1].startswith("relieves hawk in ")
    flight.until("kite", TaskRole.ON_TASK)
    assert flight.simulation.core.decision_engine.planners["kite"] is hawk
    assert flight.texts()[0] == "flies home"
    flight.until("hawk", TaskRole.STANDS_BY)
    home = flight.mock("hawk").flight
    assert not home.armed
    assert not home.crashed
    assert flight.texts()[0] == "waits for a full battery"  # none is reported
    flight.until("swift", TaskRole.ON_TASK)
    flight.fly(30.0)
    closest = flight.simulation.service.statistics.closest
    assert closest is not None
    assert closest.distance_m >= flight.scenario.mission.separation_m
    flight.over()
    assert [name for _, name in takeoffs_in(flight.path)] == ["hawk", "kite", "swift"]
    found = reliefs_in(flight.path)
    assert [(each.left_by, each.resumed_by) for each in found] == [
        ("hawk", "kite"),
        ("kite", "swift"),
    ]
    for each in found:
        assert each.distance_m <= MAX_RESUME_M
        assert each.gap_s < 120.0
        assert len(set(each.directions)) == 1, each


@pytest.mark.long
def test_no_vehicle_takes_off_without_its_sign_off(tmp_path: Path) -> None:
    flight = Flight(tmp_path, relief_scenario(2))
    flight.fly(60.0)
    assert flight.texts() == ["waits for sign-off"] * 2
    flight.order("start", "kite")
    flight.until("kite", TaskRole.ON_TASK)
    assert flight.texts()[0] == "waits for sign-off"
    flight.until("kite", TaskRole.LEAVES)  # hawk has no sign-off, and kite leaves in time
    place = flight.simulation.core._reliefs.task.place  # type: ignore[union-attr]
    flight.fly(5.0)
    alarms = flight.simulation.service.state_view.alarms
    assert alarms["relief/kite"].severity == "severe"
    assert "hawk waits for sign-off" in alarms["relief/kite"].text
    flight.until("kite", TaskRole.STANDS_BY)
    assert not flight.mock("kite").flight.crashed
    flight.order("start", "hawk")
    flight.until("hawk", TaskRole.ON_TASK)
    flight.fly(5.0)
    assert "relief/kite" not in flight.simulation.service.state_view.alarms
    flight.over()
    assert [name for _, name in takeoffs_in(flight.path)] == ["kite", "hawk"]
    assert unsigned_takeoffs_in(flight.path) == []
    (found,) = reliefs_in(flight.path)
    assert found.distance_m <= MAX_RESUME_M
    assert place is not None


@pytest.mark.long
def test_a_vehicle_that_is_signed_off_takes_off_only_when_its_relief_is_due(tmp_path: Path) -> None:
    flight = Flight(tmp_path, relief_scenario(2))
    flight.fly(3.0)
    flight.order("start", "hawk")
    flight.until("hawk", TaskRole.ON_TASK)
    flight.order("start", "kite")
    flight.fly(60.0)
    assert not flight.mock("kite").flight.armed
    flight.until("kite", TaskRole.RELIEVES)
    found = flight.simulation.core.vehicles["hawk"].energy.estimate
    assert found is not None
    assert 0.0 < found.time_on_task_s < 240.0
    flight.until("kite", TaskRole.ON_TASK)
    flight.over()
    assert unsigned_takeoffs_in(flight.path) == []


@pytest.mark.long
def test_after_the_loss_of_the_vehicle_on_task_the_next_one_takes_its_place(tmp_path: Path) -> None:
    flight = Flight(tmp_path, standing(2))
    flight.until("hawk", TaskRole.ON_TASK)
    flight.fly(150.0)
    flight.kill("hawk")
    flight.until("kite", TaskRole.ON_TASK, 400.0)
    assert flight.texts() == ["no link", "on task"]
    flight.over()
    (found,) = reliefs_in(flight.path)
    assert (found.left_by, found.resumed_by) == ("hawk", "kite")
    assert found.distance_m <= MAX_RESUME_M


@pytest.mark.long
def test_if_the_next_one_is_lost_or_does_not_take_off_another_one_is_sent(tmp_path: Path) -> None:
    flight = Flight(tmp_path, relief_scenario(4, standing_signoff=True, overlap_s=200.0))
    flight.until("hawk", TaskRole.ON_TASK)
    flight.mock("kite").flight.crashed = True  # it does not arm
    flight.until("kite", TaskRole.RELIEVES)
    flight.until("swift", TaskRole.RELIEVES)
    flight.fly(30.0)
    flight.kill("swift")
    flight.until("wren", TaskRole.ON_TASK)
    entries = flight.over()
    texts = [each.text for each in entries if isinstance(each, Announce)]
    assert any("has not taken off for its relief" in text for text in texts)
    (found,) = reliefs_in(flight.path)
    assert (found.left_by, found.resumed_by) == ("hawk", "wren")
    assert found.distance_m <= MAX_RESUME_M


@pytest.mark.long
def test_an_operator_who_orders_a_vehicle_down_keeps_it_down(tmp_path: Path) -> None:
    flight = Flight(tmp_path, relief_scenario(2, standing_signoff=True, ready_after_s=1.0))
    for name in ("hawk", "kite"):
        flight.mock(name).flight.battery.percent = 100.0  # full all the time
    flight.until("hawk", TaskRole.ON_TASK)
    flight.fly(100.0)
    flight.order("return", "hawk")
    flight.until("kite", TaskRole.ON_TASK, 400.0)
    flight.order("land", "hawk")
    flight.until("hawk", TaskRole.STANDS_BY)
    flight.fly(60.0)
    assert flight.texts()[0] == "waits for sign-off"
    assert flight.simulation.core.vehicles["hawk"].waits_for_operator
    flight.over()


@pytest.mark.long
def test_the_task_is_resumed_after_a_restart_of_the_service(tmp_path: Path) -> None:
    flight = Flight(tmp_path, relief_scenario(2))
    flight.fly(3.0)
    flight.order("start", "hawk")
    flight.until("hawk", TaskRole.ON_TASK)
    flight.until("hawk", TaskRole.LEAVES)
    flight.keep_state()
    before = flight.simulation.core._reliefs.task  # type: ignore[union-attr]
    flight.begin_again()
    after = flight.simulation.core._reliefs.task  # type: ignore[union-attr]
    assert after is not before
    assert after.place == before.place is not None
    flight.fly(20.0)
    flight.order("start", "kite")
    flight.until("kite", TaskRole.ON_TASK)
    entries = flight.over()
    assert any(isinstance(each, RaiseAlarm) and each.alarm == "relief" for each in entries)
    (found,) = reliefs_in(flight.path)
    assert (found.left_by, found.resumed_by) == ("hawk", "kite")
    assert found.distance_m <= MAX_RESUME_M


@pytest.mark.long
def test_the_vehicle_on_task_continues_and_is_relieved_after_a_restart(tmp_path: Path) -> None:
    flight = Flight(tmp_path, standing(2))
    flight.until("kite", TaskRole.RELIEVES)
    flight.fly(15.0)
    flight.keep_state()
    flight.begin_again()
    flight.until("kite", TaskRole.ON_TASK)
    flight.over()
    (found,) = reliefs_in(flight.path)
    assert (found.left_by, found.resumed_by) == ("hawk", "kite")
    assert found.distance_m <= MAX_RESUME_M


@pytest.mark.long
def test_a_vehicle_with_a_mission_on_board_takes_off_only_when_its_relief_is_due(
    tmp_path: Path,
) -> None:
    flight = Flight(tmp_path, relief_scenario(3, standing_signoff=True, overlap_s=200.0))
    flight.until("hawk", TaskRole.ON_TASK)
    flight.mock("kite").flight.crashed = True  # it does not arm
    flight.until("swift", TaskRole.RELIEVES)
    flight.mock("kite").flight.crashed = False
    kite = flight.simulation.core.vehicles["kite"]
    assert kite.waits_for_operator
    assert kite.flown_line is not None
    flight.order("start", "kite")
    flight.until("swift", TaskRole.ON_TASK)
    assert flight.role("kite") is TaskRole.STANDS_BY
    assert not flight.mock("kite").flight.armed
    flight.until("kite", TaskRole.ON_TASK)
    entries = flight.over()
    texts = [each.text for each in entries if isinstance(each, Announce)]
    assert "stands by: it takes off when its relief is due" in texts
    assert [found.resumed_by for found in reliefs_in(flight.path)] == ["swift", "kite"]


@pytest.mark.long
def test_a_vehicle_that_is_sent_home_during_its_takeoff_lands(tmp_path: Path) -> None:
    flight = Flight(tmp_path, standing(2))
    hawk = flight.simulation.core.vehicles["hawk"]
    while not hawk.availability.airborne:
        flight.fly(0.5)
    assert hawk.availability.height_m < LANDS_BELOW_M
    hawk.going_home = hawk.lands_after_return = True
    flight.until("hawk", TaskRole.LEAVES)
    flight.until("hawk", TaskRole.STANDS_BY, 400.0)
    assert not flight.mock("hawk").flight.crashed
    assert "landing/hawk" not in flight.simulation.service.state_view.alarms


@pytest.mark.long
def test_with_a_standing_sign_off_a_vehicle_is_ready_some_time_after_its_battery_is_full(
    tmp_path: Path,
) -> None:
    flight = Flight(tmp_path, relief_scenario(2, standing_signoff=True, ready_after_s=100.0))
    flight.until("hawk", TaskRole.ON_TASK)
    for name in ("hawk", "kite"):
        flight.mock(name).flight.battery = Battery(100.0, 800.0)
    flight.until("kite", TaskRole.ON_TASK)
    flight.until("hawk", TaskRole.STANDS_BY)
    flight.fly(150.0)
    assert flight.texts()[0] == "waits for a full battery"
    flight.mock("hawk").replace_battery()
    flight.fly(80.0)
    hawk = flight.simulation.core.vehicles["hawk"]
    assert hawk.waits_for_operator
    flight.fly(60.0)
    assert not hawk.waits_for_operator
    flight.until("hawk", TaskRole.ON_TASK)
    flight.over()


def always_full(folder: Path, **relief: object) -> Flight:
    """Return a flight of two vehicles with batteries that are full all the time."""
    flight = Flight(folder, relief_scenario(2, standing_signoff=True, ready_after_s=1.0, **relief))
    for name in ("hawk", "kite"):
        flight.mock(name).flight.battery.percent = 100.0
    return flight


@pytest.mark.long
def test_a_vehicle_that_its_pilot_landed_needs_another_sign_off(tmp_path: Path) -> None:
    flight = always_full(tmp_path)
    flight.until("hawk", TaskRole.ON_TASK)
    flight.until("hawk", TaskRole.LEAVES)
    flight.fly(3.0)
    flight.mock("hawk").flight.set_mode("land", flight.simulation.link_us / 1e6)
    flight.until("hawk", TaskRole.STANDS_BY)
    flight.fly(120.0)
    assert flight.texts()[0] == "waits for sign-off"
    assert flight.simulation.core.vehicles["hawk"].waits_for_operator
    flight.over()


@pytest.mark.long
def test_a_vehicle_that_is_lost_on_its_last_leg_keeps_others_on_the_ground_for_four_minutes(
    tmp_path: Path,
) -> None:
    flight = Flight(tmp_path, relief_scenario(2))
    flight.fly(3.0)
    flight.order("start", "hawk")
    flight.until("hawk", TaskRole.ON_TASK)
    flight.order("land", "hawk")
    vehicles = flight.simulation.core.vehicles
    while vehicles["hawk"].landing_state.landing_phase is not LandingPhase.FINAL:
        flight.fly(1.0)
    flight.kill("hawk")
    flight.order("start", "kite")
    flight.fly(150.0)
    assert not vehicles["kite"].availability.airborne
    texts = [each.text for each in flight.simulation.service.state_view.announcements]
    assert "waits to take off: hawk is landing" in texts
    flight.fly(100.0)
    flight.order("start", "kite")
    flight.until("kite", TaskRole.ON_TASK, 400.0)
    flight.over()


@pytest.mark.long
def test_no_standing_sign_off_lasts_while_the_airspace_is_cleared(tmp_path: Path) -> None:
    flight = always_full(tmp_path)
    flight.until("kite", TaskRole.ON_TASK)
    flight.until("hawk", TaskRole.STANDS_BY)
    event = ClearingOrdered(flight.simulation.clock.now_us, "ann", "")
    flight.simulation.service.submit(event, flight.simulation.link_us)
    flight.until("kite", TaskRole.STANDS_BY)
    for name in ("hawk", "kite"):
        flight.mock(name).replace_battery()
    flight.fly(120.0)
    assert flight.texts() == ["waits for sign-off"] * 2
    assert not any(flight.mock(name).flight.armed for name in ("hawk", "kite"))
    flight.order("start", "hawk")
    flight.until("hawk", TaskRole.ON_TASK)
    flight.over()


@pytest.mark.long
def test_a_task_whose_place_lies_in_closed_airspace_is_resumed_outside(tmp_path: Path) -> None:
    flight = Flight(tmp_path, relief_scenario(2))
    flight.fly(3.0)
    flight.order("start", "hawk")
    flight.until("hawk", TaskRole.LEAVES, 2400.0)
    flight.until("hawk", TaskRole.STANDS_BY)
    core, reliefs = flight.simulation.core, flight.simulation.core._reliefs
    assert reliefs is not None
    place = reliefs.task.place
    assert place is not None
    corners = []
    for corner in range(12):
        east_m, north_m = (420.0 * turn(corner * math.tau / 12.0) for turn in (math.cos, math.sin))
        lat, lon = core.landscape.lat_lon_of(place.x_m + east_m, place.y_m + north_m)
        corners.append((float(lat), float(lon)))
    now_us = flight.simulation.clock.now_us
    closed = AirspaceClosed(now_us, "ann", "", "tanker", tuple(corners), None, None)
    flight.simulation.service.submit(closed, flight.simulation.link_us)
    flight.order("start", "kite")
    flight.until("kite", TaskRole.ON_TASK)
    flight.over()
