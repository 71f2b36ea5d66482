"""Clearing the airspace: orders, phases, reports, cancelling, restarts; without links."""

import pickle
from pathlib import Path

import pytest

from benchmarks.clear_airspace import MAX_COMMANDED_S, Run, square, times_of
from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    ClearAlarm,
    Hold,
    OrderByService,
    RaiseAlarm,
    ShowClearing,
    StartMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    Aborted,
    AirspaceOpened,
    AnyEvent,
    Approved,
    ClearingCancelled,
    ClearingOrdered,
    LinkLost,
    LinkRestored,
    MissionReadBack,
    ModeChanged,
    OrderGiven,
    PlanRequested,
    Resumed,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.registry import lock_of
from tests.service.landing_core import CRUISE_M, Vehicles, alarms, every, landing_uploads, texts

FIRE = (36.364232, -84.140907)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


ONE_FIELD = ("vehicles.1.home_lat_deg=36.370784", "vehicles.1.home_lon_deg=-84.132309")


class Cleared(Vehicles):
    """Vehicles of one field; orders by the clearing are given at once, as by the engine."""

    def __init__(self, land: Landscape, *overrides: str, count: int = 1) -> None:
        super().__init__(land, *ONE_FIELD, *overrides, count=count)

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = super().handle(event)
        for order in every(commands, OrderByService):
            named = (order.vehicle, order.order)
            commands += self.handle(OrderGiven(self.at_us, order.by, "", *named))
        return commands

    def clear(self, volume: str = "", half_deg: float = 0.0) -> list[AnyCommand]:
        corners = square(*FIRE, half_deg) if half_deg else ()
        return self.handle(ClearingOrdered(self.at_us, "ann", "", volume, corners))

    def cancel(self) -> list[AnyCommand]:
        return self.handle(ClearingCancelled(self.at_us, "ann", ""))

    def row(self, name: str) -> str:
        return self.core.clearing.state.vehicles[name].phase

    @property
    def outcome(self) -> str:
        return self.core.clearing.state.outcome

    def lands(self, name: str) -> list[AnyCommand]:
        """Let a vehicle that was ordered to land fly its landing, and disarm."""
        self.answer_uploads()
        self.mode("mission", name)
        self.at(CRUISE_M, name)
        assert self.row(name) == "on its way"
        return self.mode("mission", name, armed=False)


def last_shown(commands: list[AnyCommand]) -> ShowClearing:
    return every(commands, ShowClearing)[-1]


def commanded(commands: list[AnyCommand]) -> set[str]:
    return {each.vehicle for each in [*landing_uploads(commands), *every(commands, Hold)]}


# All vehicles land --------------------------------------------------------------------------------


def test_all_are_commanded_by_the_request_and_land_in_the_stated_order(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    commands = flight.clear()
    assert commanded(commands) == {"hawk", "kite"}
    first, second = flight.core.clearing.state.vehicles
    assert f"in this order: {first}, {second}" in texts(commands)
    assert [each.vehicle for each in landing_uploads(commands)] == [first]
    flight.answer("hold", name=second)
    assert flight.row(second) == "waiting"
    commands = flight.lands(first)
    assert "on the ground: 1 of 2 on the ground, last expected at" in texts(commands)
    flight.mode("hold", second)
    (upload,) = landing_uploads(flight.at(CRUISE_M, second))
    assert upload.vehicle == second
    commands = flight.lands(second)
    assert "the airspace is clear: 2 of 2 on the ground" in texts(commands)
    assert last_shown(commands).outcome == flight.outcome == "complete"


def test_the_vehicle_with_the_least_time_on_task_lands_first(land: Landscape) -> None:
    for short, first in ((0, "hawk"), (1, "kite")):
        keys = [
            f"vehicles.{number}.endurance_s={9000 - 1000 * (number == short)}" for number in (0, 1)
        ]
        flight = Cleared(land, *keys, count=2)
        flight.clear()
        assert next(iter(flight.core.clearing.state.vehicles)) == first


def test_stated_times_follow_the_queue_and_a_late_vehicle_raises_an_alarm(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    rows = last_shown(flight.clear()).vehicles
    first, second = rows
    assert None not in (first.expected_us, second.expected_us, first.out_by_us)
    assert flight.at_us < first.expected_us < second.expected_us  # type: ignore[operator]
    assert second.out_by_us > second.expected_us  # type: ignore[operator]
    flight.answer("hold", name=second.vehicle)
    flight.answer_uploads()
    flight.mode("mission", first.vehicle)
    assert "clearing" not in alarms(flight.at(CRUISE_M, first.vehicle))
    later_s = (first.out_by_us - flight.at_us) / 1e6 + 1.0  # type: ignore[operator]
    late = flight.at(CRUISE_M, first.vehicle, later_s=later_s)
    assert "is late: it should have been on the ground by" in texts(late)
    assert "clearing" in alarms(late)


def test_a_vehicle_without_a_link_is_reported_at_once_and_not_waited_for(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.handle(LinkLost(flight.at_us, "hawk", 3.0))
    commands = flight.clear()
    (alarm,) = every(commands, RaiseAlarm)[-1:]
    assert (alarm.vehicle, alarm.alarm, alarm.severity) == ("hawk", "clearing", "severe")
    assert "its link is lost; use the radio" in alarm.text
    assert [each.vehicle for each in landing_uploads(commands)] == ["kite"]
    assert last_shown(commands).vehicles[0].expected_us is None
    flight.lands("kite")
    assert flight.outcome == "in force"
    restored = flight.handle(LinkRestored(flight.at_us, "hawk"))
    assert [each.vehicle for each in landing_uploads(restored)] == ["hawk"]
    assert ClearAlarm("hawk", "clearing") in restored
    flight.lands("hawk")
    assert flight.outcome == "complete"


def test_a_vehicle_that_does_not_answer_is_reported_and_the_next_one_lands(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.clear()
    first, second = flight.core.clearing.state.vehicles
    flight.answer("hold", name=second)
    flight.mode("hold", second)
    flight.at(CRUISE_M, second, later_s=4.0)
    assert flight.row(first) == "ordered"
    silent = flight.at(CRUISE_M, second)
    assert flight.row(first) == "not reached"
    assert "it has not answered for 5 s; use the radio" in texts(silent)
    later = [flight.at(CRUISE_M, second) for _ in range(12)]
    sent = [each for commands in later for each in landing_uploads(commands)]
    assert [each.vehicle for each in sent] == [second]  # the field is free after 15 s
    assert any(Hold(first) in commands for commands in later)
    flight.answer("hold", name=first)
    flight.mode("hold", first)
    assert flight.row(second) == "ordered"
    flight.at(CRUISE_M, first, later_s=11.0)
    assert flight.row(first) == "waiting"  # behind the other


def test_a_vehicle_of_its_pilot_or_in_a_failsafe_is_reported_and_left_alone(
    land: Landscape,
) -> None:
    flight = Cleared(land, count=2)
    flight.mode("manual", "hawk")
    flight.handle(SystemStateChanged(flight.at_us, "kite", "critical"))
    commands = flight.clear()
    assert commanded(commands) == set()
    assert "not cleared: its autopilot or pilot selected mode manual; use the radio" in texts(
        commands
    )
    assert "not cleared: its autopilot reports a failsafe; use the radio" in texts(commands)
    assert commanded(flight.at(CRUISE_M, "hawk", later_s=20.0)) == set()
    assert commanded(flight.at(CRUISE_M, "kite")) == set()
    assert commanded(flight.mode("mission", "hawk")) == {"hawk"}  # under control again


def test_a_vehicle_that_cannot_land_holds_with_an_alarm_and_lands_later(land: Landscape) -> None:
    flight = Cleared(land)
    home = flight.core.vehicles["hawk"].section
    corners = square(home.home_lat_deg, home.home_lon_deg, 0.002)
    closed = ClearingOrdered(flight.at_us, "bob", "", "field", corners)
    flight.handle(closed)
    assert flight.row("hawk") == "out"
    commands = flight.clear()
    assert Hold("hawk") in commands
    assert "it cannot land: its mission would enter the closed volume 'field'" in texts(commands)
    assert "clearing" in alarms(commands)
    flight.answer("hold")
    flight.mode("hold")
    flight.handle(AirspaceOpened(flight.at_us, "bob", "", "field"))
    flight.at(CRUISE_M, later_s=12.0)
    assert len(landing_uploads(flight.sent)) == 1


def test_no_vehicle_takes_off_and_those_on_the_ground_wait_for_an_order(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.mode("hold", "kite", armed=False)
    flight.core.vehicles["kite"].waits_for_operator = False  # as before its first flight
    flight.clear()
    assert list(flight.core.clearing.state.vehicles) == ["hawk"]
    for order in ("start", "resume"):
        refused = flight.order(order, "kite")
        assert "rejected: the airspace is being cleared" in texts(refused)
        assert not every(refused, StartMission)
    flight.lands("hawk")
    assert flight.outcome == "complete"
    assert flight.core.vehicles["kite"].waits_for_operator
    flight.at(0.0, "kite", away_deg=0.0)
    assert "rejected" not in texts(flight.order("start", "kite"))


def test_a_vehicle_that_takes_off_meanwhile_is_ordered_to_land(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.mode("hold", "kite", armed=False)
    flight.clear()
    flight.mode("mission", "kite")
    flight.at(5.0, "kite", away_deg=0.0)
    assert "kite" not in flight.core.clearing.state.vehicles
    assert "kite" in commanded(flight.at(40.0, "kite", away_deg=0.001))


def test_after_cancelling_the_vehicles_hold_until_they_are_resumed(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.clear()
    first, second = flight.core.clearing.state.vehicles
    flight.answer_uploads()
    flight.mode("mission", first)
    flight.mode("hold", second)
    commands = flight.cancel()
    assert {each.vehicle for each in every(commands, Hold)} == {first, second}
    assert last_shown(commands).outcome == "cancelled"
    for name in (first, second):
        flight.answer("hold", name=name)
        flight.mode("hold", name)
    for _ in range(30):
        for name in (first, second):
            assert not commanded(flight.at(CRUISE_M, name, later_s=5.0))
    assert {each.ordered for each in flight.core.vehicles.values()} == {"hold"}
    assert "rejected" not in texts(flight.order("resume", first))


def test_cancelled_on_the_last_leg_a_vehicle_lands(land: Landscape) -> None:
    flight = Cleared(land)
    flight.clear()
    flight.answer_uploads()
    flight.mode("mission")
    flight.at(CRUISE_M)
    mission = flight.core.vehicles["hawk"].landing_state.mission
    assert mission is not None
    flight.progress(mission.final_seq)
    flight.at(20.0, away_deg=0.003)
    assert flight.phase() == "final"
    assert not every(flight.cancel(), Hold)
    assert flight.phase() == "final"


def test_an_abort_ends_it_and_an_operators_order_has_precedence(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.clear()
    held = flight.order("hold", "kite")
    assert flight.row("kite") == "not reached"
    assert "not cleared: hold ordered by ann" in texts(held)
    assert not landing_uploads(flight.at(CRUISE_M, "kite", later_s=30.0))
    flight.order("land", "kite")
    assert flight.row("kite") == "ordered"
    aborted = flight.handle(Aborted(flight.at_us, "ann", ""))
    assert last_shown(aborted).outcome == "cancelled"


def test_impossible_requests_are_rejected(land: Landscape) -> None:
    flight = Cleared(land)
    assert "rejected: the airspace is not being cleared" in texts(flight.cancel())
    assert "rejected: no closed volume 'x'" in texts(flight.clear("x"))
    flight.clear()
    assert "all vehicles are already landing" in texts(flight.clear("x", 0.01))
    assert flight.core.clearing.state.lands


def test_it_survives_a_restart_of_the_service(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    flight.clear()
    first, second = flight.core.clearing.state.vehicles
    flight.core = pickle.loads(pickle.dumps(flight.core))
    flight.at_s += 2.0
    resumed = flight.handle(Resumed(flight.at_us, "service", "", 2.0))
    assert "clearing" not in alarms(resumed)  # links take some seconds
    for name in (first, second):
        flight.handle(VehicleConnected(flight.at_us, name, "a stack", True))
        flight.mode("mission", name)
        flight.at(CRUISE_M, name)
        flight.handle(MissionReadBack(flight.at_us, name, 0, 5))
        flight.answer("hold", name=name)
        flight.mode("hold", name)
    flight.at(CRUISE_M, first)
    assert flight.core.clearing.state.in_force
    assert [flight.phase(name) for name in (first, second)] == ["sending", "waiting"]


# A volume -----------------------------------------------------------------------------------------


def test_vehicles_leave_a_drawn_volume_and_it_stays_closed(land: Landscape) -> None:
    flight = Cleared(land)
    flight.at(CRUISE_M)
    inside_deg = flight.core.vehicles["hawk"].section.home_lon_deg - FIRE[1]
    flight.at(CRUISE_M, away_deg=inside_deg)
    flight.clear("tanker", 0.012)
    commands = flight.at(CRUISE_M, later_s=0.25, away_deg=inside_deg)
    commands += flight.at(CRUISE_M, later_s=0.5, away_deg=inside_deg)
    sent = flight.core.vehicles["hawk"].pending
    assert sent is not None
    assert sent.evades
    assert flight.row("hawk") == "ordered"
    flight.answer_uploads()
    flight.mode("mission")
    flight.at(CRUISE_M, away_deg=inside_deg)
    row = last_shown(flight.sent).vehicles[0]
    assert row.phase == "on its way"
    assert row.expected_us is not None
    commands = flight.at(CRUISE_M, away_deg=0.1)
    assert "the airspace is clear: 1 of 1 out" in texts(commands)
    assert [each.name for each in flight.core.airspace.volumes] == ["tanker"]


def test_cancelling_opens_the_volume_that_was_closed_for_it(land: Landscape) -> None:
    flight = Cleared(land)
    inside_deg = flight.core.vehicles["hawk"].section.home_lon_deg - FIRE[1]
    flight.at(CRUISE_M, away_deg=inside_deg)
    flight.clear("tanker", 0.012)
    flight.at(CRUISE_M, away_deg=inside_deg)
    assert Hold("hawk") in flight.cancel()
    assert flight.core.airspace.volumes == ()
    assert flight.core.vehicles["hawk"].ordered == "hold"


# Burns --------------------------------------------------------------------------------------------


def test_in_a_burn_drops_stop_and_no_plan_is_made_until_it_is_cancelled() -> None:
    scenario = load_scenario("burn")
    landscape = landscape_of(scenario)
    core = Core(scenario, landscape)
    at_us = round(scenario.deploy_at_s * 1e6)
    home = scenario.vehicles[0]
    name = home.name
    for event in (
        VehicleConnected(at_us, name, "a stack", True),
        ModeChanged(at_us, name, 4, True, "mission"),
        Telemetry(at_us, name, home.home_lat_deg, home.home_lon_deg, 500.0, 80.0, 0.0, 0.0, 0.0),
    ):
        core.handle(event)
    commands = core.handle(ClearingOrdered(at_us, "ann", ""))
    assert "airspace clearing ordered by ann" in texts(commands)
    refused = core.handle(PlanRequested(at_us, "ann", ""))
    assert "rejected: the airspace is being cleared" in texts(refused)
    assert "rejected" in texts(core.handle(Approved(at_us, "ann", "", "0" * 64)))
    core.handle(ClearingCancelled(at_us, "ann", ""))
    again = core.handle(PlanRequested(at_us, "ann", ""))
    assert "the airspace is being cleared" not in texts(again)


def test_the_interlock_ends_all_plans_when_the_airspace_is_cleared() -> None:
    scenario = load_scenario("burn")
    lock = lock_of(scenario, landscape_of(scenario))
    assert lock is not None
    lock._go = {"an item"}  # type: ignore[attr-defined]
    lock.apply(ClearingOrdered(0, "ann", ""))
    assert lock._go == set()  # type: ignore[attr-defined]


# Links that lose messages -------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("lands", [True, False])
def test_five_vehicles_over_lossy_links_are_out_by_the_stated_times_except_a_silent_one(
    tmp_path: Path, lands: bool
) -> None:
    run = Run(tmp_path, 3)
    run.run(400.0)
    run.deafen("kite")
    volume = {} if lands else {"volume": "tanker", "corners": square(*FIRE, 0.012)}
    run.clear(**volume)
    run.run(1000.0 if lands else 250.0)
    assert "clearing/kite" in run.simulation.service.state_view.alarms
    found = times_of(run.entries(), "kite")  # verifies the replay of the journal
    others = {each.name for each in run.scenario.vehicles} - {"kite"}
    assert (
        max(found.commanded_s[name] for name in others & found.stated_s.keys()) <= MAX_COMMANDED_S
    )
    assert others <= found.out_s.keys()
    assert found.late == []
    assert found.reported_s is not None
    assert found.reported_s <= 6.0
    assert "kite" not in found.out_s


def test_announcements_are_one_line(land: Landscape) -> None:
    flight = Cleared(land, count=2)
    lines = [each.text for each in every(flight.clear(), Announce)]
    assert lines
    assert not any("\n" in line for line in lines)


def test_an_upload_of_the_planner_does_not_count_as_a_landing(land: Landscape) -> None:
    flight = Cleared(land)
    flight.clear()
    flight.handle(UploadFinished(flight.at_us, "hawk", 0, "accepted", ""))
    assert flight.phase() == "sending"
