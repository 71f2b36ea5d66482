"""The safety rules of the core, one by one."""

import numpy as np
import pytest

from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    ClearAlarm,
    Hold,
    RaiseAlarm,
    ReportChecks,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    Aborted,
    AirspeedMeasured,
    AnyEvent,
    AutopilotText,
    CommandFinished,
    EstimatorStatusChanged,
    LandedStateChanged,
    LinkLost,
    LinkRestored,
    MissionProgress,
    MissionReadBack,
    ModeChanged,
    OrderGiven,
    Resumed,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
)
from mission_service.fire.camera import camera_of
from mission_service.fire.camera_views import observed
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.vehicles.availability import AIRBORNE_M

NAV_LOITER_UNLIM, NAV_TAKEOFF = 17, 22
CRITICAL = 2  # MAV_SEVERITY
HOME_AMSL_M = 348.0


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


class Flight:
    """Sends the events of one vehicle to a core."""

    def __init__(self, scenario: Scenario, land: Landscape, atomic: bool = True) -> None:
        self.core = Core(scenario, land)
        self.home = scenario.vehicles[0]
        self.at_us = round(scenario.deploy_at_s * 1e6)
        self.handle(VehicleConnected(self.at_us, "hawk", "a stack", atomic))

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        """Return the commands without the reports of pre-flight checks."""
        commands = self.core.handle(event)
        return [each for each in commands if not isinstance(each, ReportChecks)]

    def at_height(self, height_m: float, later_s: float = 1.0) -> list[AnyCommand]:
        self.at_us += round(later_s * 1e6)
        if height_m >= AIRBORNE_M:
            self.core.vehicles["hawk"].availability.armed = True
        return self.handle(
            Telemetry(
                self.at_us,
                "hawk",
                self.home.home_lat_deg,
                self.home.home_lon_deg,
                HOME_AMSL_M + height_m,
                height_m,
                0.0,
                12.0,
                90.0,
            )
        )

    def restored(self) -> list[AnyCommand]:
        """Lose and restore the link, so that a new mission is due."""
        self.handle(LinkLost(self.at_us, "hawk", 3.0))
        self.handle(LinkRestored(self.at_us, "hawk"))
        return self.at_height(80.0, later_s=10.0)

    def finished(self, mission_id: int, outcome: str) -> list[AnyCommand]:
        return self.handle(UploadFinished(self.at_us, "hawk", mission_id, outcome, "because"))


def uploads(commands: list[AnyCommand]) -> list[UploadMission]:
    return [command for command in commands if isinstance(command, UploadMission)]


def kinds(commands: list[AnyCommand]) -> list[type]:
    return [type(command) for command in commands]


def test_nothing_is_sent_before_the_time_of_deployment(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    flight.at_us = 10_000_000
    assert flight.at_height(0.0) == []


@pytest.mark.parametrize(("stack", "landing"), [("px4", [189, 31, 16, 16, 21]), ("ardupilot", [])])
def test_the_first_mission_takes_off_and_ends_in_a_loiter(
    land: Landscape, stack: str, landing: list[int]
) -> None:
    flight = Flight(load_scenario("default", (f"vehicles.0.stack={stack}",)), land)
    (mission,) = uploads(flight.at_height(0.0))
    commands = [item.command for item in mission.items]
    assert commands[0] == NAV_TAKEOFF
    # The landing that PX4 requires follows the loiter, and no vehicle reaches it by itself.
    assert commands[commands.index(NAV_LOITER_UNLIM) + 1 :] == landing


def test_a_flight_starts_by_itself_only_where_the_scenario_permits(land: Landscape) -> None:
    for overrides, expected in (((), [StartMission]), (("vehicles.0.autostart=false",), [])):
        flight = Flight(load_scenario("default", overrides), land)
        (mission,) = uploads(flight.at_height(0.0))
        assert kinds(flight.finished(mission.mission_id, "accepted")) == expected


def test_a_place_at_the_other_end_of_the_world_is_no_place(land: Landscape) -> None:
    scenario = load_scenario("default")
    flight = Flight(scenario, land)
    there = Telemetry(flight.at_us, "hawk", 0.1, 0.1, 500.0, 100.0, 0.0, 12.0, 90.0)
    assert not np.isfinite(land.xy_of_lat_lon(0.1, 0.1)).any()
    assert flight.handle(there) == []
    world = SimulatedFire(fire_of(scenario, land), land)
    assert observed(world.fire, there, camera_of(scenario.vehicles[0])) is None
    assert uploads(flight.at_height(0.0))


def test_only_one_upload_is_under_way(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    assert len(uploads(flight.at_height(0.0))) == 1
    assert all(not uploads(flight.at_height(0.0)) for _ in range(20))


def test_a_refused_mission_is_reported_and_retried_later(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    (mission,) = uploads(flight.at_height(0.0))
    (announcement,) = flight.finished(mission.mission_id, "rejected")
    assert isinstance(announcement, Announce)
    assert announcement.level == "warning"
    assert "because" in announcement.text
    assert uploads(flight.at_height(0.0, later_s=1.0)) == []
    assert len(uploads(flight.at_height(0.0, later_s=5.0))) == 1


def test_a_takeoff_is_not_cut_short_by_another_mission(land: Landscape) -> None:
    # Observed on PX4 1.17: with another mission at 15 m a plane sank to the ground and slid on.
    flight = Flight(load_scenario("default"), land)
    (first,) = uploads(flight.at_height(0.0))
    flight.finished(first.mission_id, "accepted")
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, True, "mission"))
    flight.at_height(16.0)
    assert uploads(flight.restored()) == []
    assert uploads(flight.at_height(first.items[0].z - 400.0, later_s=10.0)) == []
    flight.handle(MissionProgress(flight.at_us, "hawk", 1))
    assert len(uploads(flight.at_height(150.0, later_s=10.0))) == 1


def airborne(land: Landscape, atomic: bool) -> tuple[Flight, UploadMission]:
    flight = Flight(load_scenario("default"), land, atomic)
    (first,) = uploads(flight.at_height(0.0))
    flight.finished(first.mission_id, "accepted")
    flight.at_height(80.0)
    (second,) = uploads(flight.restored())
    return flight, second


@pytest.mark.parametrize("outcome", ["failed", "rejected", "unknown"])
def test_a_broken_upload_in_flight_holds_a_vehicle_whose_mission_may_be_a_mixture(
    land: Landscape, outcome: str
) -> None:
    flight, mission = airborne(land, atomic=False)
    assert kinds(flight.finished(mission.mission_id, outcome)) == [Announce, Hold]
    (again,) = uploads(flight.at_height(80.0, later_s=6.0))
    assert kinds(flight.finished(again.mission_id, "accepted")) == [StartMission]


def test_a_broken_upload_leaves_a_vehicle_alone_that_keeps_its_old_mission(
    land: Landscape,
) -> None:
    flight, mission = airborne(land, atomic=True)
    assert kinds(flight.finished(mission.mission_id, "failed")) == [Announce]


def test_a_good_mission_after_an_unfit_one_in_flight_is_started_again(land: Landscape) -> None:
    """PX4 loiters after a mission that it will not fly, and does not resume by itself."""
    flight, mission = airborne(land, atomic=True)
    assert kinds(flight.finished(mission.mission_id, "failed")) == [Announce]
    (again,) = uploads(flight.at_height(80.0, later_s=6.0))
    assert kinds(flight.finished(again.mission_id, "accepted")) == [StartMission]
    (later,) = uploads(flight.restored())
    assert kinds(flight.finished(later.mission_id, "accepted")) == []


def test_nothing_is_sent_while_the_link_is_lost(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    (mission,) = uploads(flight.at_height(0.0))
    flight.finished(mission.mission_id, "accepted")
    (announcement,) = flight.handle(LinkLost(flight.at_us, "hawk", 3.2))
    assert isinstance(announcement, Announce)
    assert "3.2 s" in announcement.text
    assert flight.at_height(80.0, later_s=60.0) == []


def test_a_vehicle_below_its_home_is_not_taken_for_landed(land: Landscape) -> None:
    flight, mission = airborne(land, atomic=True)
    assert mission.items[0].command != NAV_TAKEOFF
    flight.finished(mission.mission_id, "failed")
    (again,) = uploads(flight.at_height(-20.0, later_s=6.0))
    assert again.items[0].command != NAV_TAKEOFF


def test_a_vehicle_that_disarmed_takes_off_again(land: Landscape) -> None:
    flight, mission = airborne(land, atomic=True)
    flight.finished(mission.mission_id, "failed")
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, armed=False))
    (again,) = uploads(flight.at_height(0.0, later_s=6.0))
    assert again.items[0].command == NAV_TAKEOFF


def test_an_autopilot_restarted_before_its_flight_is_sent_to_the_fire_again(
    land: Landscape,
) -> None:
    flight = Flight(load_scenario("default"), land)
    (first,) = uploads(flight.at_height(0.0))
    assert kinds(flight.finished(first.mission_id, "accepted")) == [StartMission]
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))
    (mission,) = uploads(flight.at_height(0.0))
    assert mission.items[0].command == NAV_TAKEOFF
    assert kinds(flight.finished(mission.mission_id, "accepted")) == [StartMission]


def test_an_autopilot_restarted_after_its_flight_waits_for_an_operator(land: Landscape) -> None:
    flight, _ = airborne(land, atomic=True)
    flight.handle(ModeChanged(flight.at_us, "hawk", 4, armed=False, mode="mission"))
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))
    (mission,) = uploads(flight.at_height(0.0))
    assert mission.items[0].command == NAV_TAKEOFF
    assert kinds(flight.finished(mission.mission_id, "accepted")) == [Announce]


def test_the_time_in_the_air_continues_after_a_restart_in_flight(land: Landscape) -> None:
    flight = Flight(load_scenario("default", ("vehicles.0.endurance_s=3600",)), land)
    flight.at_height(0.0)
    flight.at_height(80.0)
    flight.at_height(80.0, later_s=2900.0)
    before = flight.core.vehicles["hawk"].energy.estimate
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))
    flight.at_height(80.0, later_s=2.0)
    after = flight.core.vehicles["hawk"].energy.estimate
    assert before is not None
    assert after is not None
    assert after.time_on_task_s == pytest.approx(before.time_on_task_s - 2.0, abs=1.0)


def test_a_disarmed_vehicle_that_is_carried_uphill_is_not_airborne(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    flight.at_height(0.0)
    carried = flight.core.vehicles["hawk"]
    place = (flight.home.home_lat_deg, flight.home.home_lon_deg, HOME_AMSL_M + 40.0, 40.0)
    flight.handle(Telemetry(flight.at_us, "hawk", *place, 0.0, 0.0, 90.0))
    assert not carried.availability.airborne
    flight.handle(ModeChanged(flight.at_us, "hawk", 4, armed=True, mode="mission"))
    flight.handle(Telemetry(flight.at_us, "hawk", *place, 0.0, 0.0, 90.0))
    assert carried.availability.airborne


def test_a_return_ordered_during_the_takeoff_is_carried_out_in_the_air(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    (mission,) = uploads(flight.at_height(0.0))
    flight.finished(mission.mission_id, "accepted")
    flight.handle(ModeChanged(flight.at_us, "hawk", 4, armed=True, mode="mission"))
    flight.at_height(8.0)
    (announcement,) = flight.handle(OrderGiven(flight.at_us, "ann", "desk", "hawk", "return"))
    assert isinstance(announcement, Announce)
    assert announcement.text == "return ordered by ann: executed after takeoff"
    # Neither the service nor the autopilot loses the mission in a restart.
    flight.handle(Resumed(flight.at_us, "service", "", 1.0))
    flight.handle(VehicleConnected(flight.at_us, "hawk", "a stack", True))
    flight.handle(ModeChanged(flight.at_us, "hawk", 4, armed=True, mode="mission"))
    flight.handle(MissionReadBack(flight.at_us, "hawk", mission.mission_id, 5))
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))
    assert Return not in kinds(flight.at_height(12.0))
    assert kinds(flight.at_height(16.0)) == [Return]
    assert not uploads(flight.at_height(20.0, later_s=10.0))


def test_an_order_that_is_refused_leaves_the_mode_as_it_was(land: Landscape) -> None:
    flight, _ = airborne(land, atomic=True)
    flight.handle(OrderGiven(flight.at_us, "ann", "desk", "hawk", "hold"))
    flight.handle(ModeChanged(flight.at_us, "hawk", 9, armed=True, mode="land"))
    taken_over = flight.core.vehicles["hawk"].availability
    assert taken_over.taken_over
    flight.handle(OrderGiven(flight.at_us, "ann", "desk", "hawk", "start", confirmed=True))
    assert taken_over.taken_over
    assert Hold not in kinds(flight.handle(Aborted(flight.at_us, "ann", "desk")))


def test_a_start_that_was_refused_is_tried_again(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    (mission,) = uploads(flight.at_height(0.0))
    flight.finished(mission.mission_id, "accepted")
    refusal = CommandFinished(flight.at_us, "hawk", "start mission", False, "not yet")
    assert kinds(flight.handle(refusal)) == [Announce]
    assert flight.at_height(0.0, later_s=5.0) == []
    assert kinds(flight.at_height(0.0, later_s=6.0)) == [StartMission]
    assert flight.at_height(0.0) == []


@pytest.mark.parametrize("under_way", [False, True])
def test_a_start_ends_when_a_pilot_sets_another_mode_on_the_ground(
    land: Landscape, under_way: bool
) -> None:
    """ArduPlane 4.6.2 armed and took off seconds after MANUAL was selected (observed)."""
    flight = Flight(load_scenario("default"), land)
    flight.handle(ModeChanged(flight.at_us, "hawk", 11, False, "return"))
    (mission,) = uploads(flight.at_height(0.0))
    flight.finished(mission.mission_id, "accepted")
    refusal = CommandFinished(flight.at_us, "hawk", "start mission", False, "not yet")
    if not under_way:
        flight.handle(refusal)
    assert flight.handle(ModeChanged(flight.at_us, "hawk", 10, False, "mission")) == []
    (ended,) = flight.handle(ModeChanged(flight.at_us, "hawk", 0, False, "manual"))
    assert isinstance(ended, Announce)
    assert ended.text.startswith("start cancelled: mode manual was not ordered")
    if under_way:
        (refused,) = flight.handle(refusal)
        assert isinstance(refused, Announce)
        assert refused.text == "start mission refused: not yet"
    assert StartMission not in kinds(flight.at_height(0.0, later_s=11.0))
    ordered = flight.handle(OrderGiven(flight.at_us, "ann", "desk", "hawk", "start"))
    assert StartMission in kinds(ordered)


def test_a_start_ends_when_a_pilot_arms(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, False, "manual"))
    (mission,) = uploads(flight.at_height(0.0))
    flight.finished(mission.mission_id, "accepted")
    flight.handle(CommandFinished(flight.at_us, "hawk", "start mission", False, "not yet"))
    armed = flight.handle(ModeChanged(flight.at_us, "hawk", 0, True, "manual"))
    assert Announce in kinds(armed)
    assert flight.core.vehicles["hawk"].availability.taken_over
    assert StartMission not in kinds(flight.at_height(0.0, later_s=11.0))


def test_a_starting_estimator_is_announced_once(land: Landscape) -> None:
    flight = Flight(load_scenario("default"), land)

    def reported(*problems: str) -> list[type]:
        event = EstimatorStatusChanged(flight.at_us, "hawk", not problems, problems)
        return kinds(flight.handle(event))

    assert reported("not initialised") == [Announce, RaiseAlarm]
    assert reported("attitude not valid", "position lost") == [RaiseAlarm]
    assert reported() == [ClearAlarm]
    flight.at_height(80.0)
    assert reported("satellite position glitch") == [Announce, RaiseAlarm]
    assert reported("position lost") == [Announce, RaiseAlarm]


def test_what_arducopter_reports_of_an_upload_of_the_service_is_no_alarm(land: Landscape) -> None:
    flight, mission = airborne(land, atomic=False)

    def reported(later_s: float = 0.0) -> list[AnyCommand]:
        text = "Auto mission changed, restarted command"
        return flight.handle(
            AutopilotText(flight.at_us + round(later_s * 1e6), "hawk", CRITICAL, text)
        )

    during = reported()
    flight.finished(mission.mission_id, "accepted")
    for (announcement,) in (during, reported(1.0)):
        assert isinstance(announcement, Announce)
        assert announcement.level == "info"
    assert kinds(reported(10.0)) == [Announce, RaiseAlarm]  # ordered by another station


@pytest.mark.parametrize(
    ("text", "is_alarm"),
    [
        ("Throttle failsafe on", True),
        ("Throttle failsafe off", False),
        ("RC Long Failsafe On: RTL", True),
        ("RC Long Failsafe Cleared", False),
        ("EKF Failsafe Cleared", False),
    ],
)
def test_the_end_of_a_failsafe_of_ardupilot_is_no_alarm(
    land: Landscape, text: str, is_alarm: bool
) -> None:
    flight, _ = airborne(land, atomic=False)
    reported = flight.handle(AutopilotText(flight.at_us, "hawk", CRITICAL, text))
    assert kinds(reported) == [Announce, RaiseAlarm][: 1 + is_alarm]


def test_a_vehicle_on_the_ground_in_its_mission_has_no_wrong_airspeed(land: Landscape) -> None:
    flight, _ = airborne(land, atomic=True)
    flight.handle(ModeChanged(flight.at_us, "hawk", 4, armed=True, mode="mission"))
    flight.handle(AirspeedMeasured(flight.at_us, "hawk", 1.0))
    assert RaiseAlarm not in kinds(flight.at_height(80.0, later_s=91.0))  # takes off
    flight.handle(MissionProgress(flight.at_us, "hawk", 1))
    assert RaiseAlarm not in kinds(flight.at_height(80.0))
    assert RaiseAlarm in kinds(flight.at_height(5.0, later_s=91.0))
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "on ground"))
    assert ClearAlarm("hawk", "airspeed") in flight.at_height(0.0)


def test_an_answer_to_an_older_mission_changes_nothing(land: Landscape) -> None:
    flight, mission = airborne(land, atomic=False)
    assert flight.finished(mission.mission_id - 1, "failed") == []


def test_stacks_declare_what_a_broken_upload_leaves() -> None:
    assert stack_named("px4", "plane").atomic_upload
    assert not stack_named("ardupilot", "plane").atomic_upload
    assert np.isfinite(stack_named("px4", "plane").mission_mode)


def test_only_a_new_start_is_announced(land: Landscape) -> None:
    flight, _ = airborne(land, atomic=True)

    def answered(command: str, accepted: bool) -> list[str]:
        event = CommandFinished(flight.at_us, "hawk", command, accepted, "" if accepted else "no")
        return [each.text for each in flight.handle(event) if isinstance(each, Announce)]

    accepted = ["start mission: accepted"]
    assert answered("start mission", True) == accepted
    assert [answered("start mission", True) for _ in range(3)] == [[], [], []]
    assert answered("orbit", True) == []
    assert answered("start mission", True) == []
    assert answered("start mission", False) != []
    assert answered("start mission", True) == accepted
    assert answered("hold", True) == ["hold: accepted"]
    assert answered("start mission", True) == accepted
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, False, "hold"))
    assert answered("start mission", True) == accepted
