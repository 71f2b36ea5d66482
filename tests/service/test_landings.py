"""Orders to land and to go around: phases, failures, several vehicles, restarts; without links."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    AnyCommand,
    GoAround,
    Hold,
    Land,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    Aborted,
    LandedStateChanged,
    MissionReadBack,
    OrderGiven,
    ParametersReported,
    Resumed,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.fire.scenario_fire import landscape_of
from tests.service.landing_core import (
    CRUISE_M,
    Vehicles,
    alarms,
    every,
    landing_uploads,
    shown,
    texts,
)

ARDUPLANE = 'vehicles.0.stack="ardupilot"'
COPTER = 'vehicles.0.kind="copter"'
TO_VEHICLE = (StartMission, Hold, Return, Land, GoAround, UploadMission)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


def set_terrain(flight: Vehicles, land: Landscape, elevation_m: np.ndarray) -> None:
    """Replace the terrain on which landings are planned."""
    elevation = np.broadcast_to(np.asarray(elevation_m, np.float32), land.fuel_model.shape)
    flight.core._landings.landscape = replace(land, elevation_m=elevation.copy())


def test_one_whose_time_ends_on_its_approach_is_not_overdue(land: Landscape) -> None:
    for lands, expected in ((True, False), (False, True)):
        flight = Vehicles(land, "vehicles.0.endurance_s=600")
        if lands:
            flight.approaches()
        else:
            flight.order("hold")
            flight.mode("hold")
        commands = [each for _ in range(16) for each in flight.at(CRUISE_M, later_s=40.0)]
        assert ("overdue" in alarms(commands)) is expected


def to_vehicle(commands: list[AnyCommand]) -> list[AnyCommand]:
    return [each for each in commands if isinstance(each, TO_VEHICLE)]


# Orders ----------------------------------------------------------------------------------------


def test_a_plane_is_sent_a_mission_that_only_lands(land: Landscape) -> None:
    flight = Vehicles(land)
    commands = flight.order("land")
    (upload,) = landing_uploads(commands)
    commands_sent = [item.command for item in upload.items]
    assert commands_sent[-1] == mavlink.MAV_CMD_NAV_LAND
    assert mavlink.MAV_CMD_NAV_LOITER_UNLIM not in commands_sent
    assert shown(commands) == ["sending"]
    assert to_vehicle(flight.answer_uploads()) == []  # PX4 flies the new mission at once
    assert shown(flight.at(CRUISE_M)) == ["approach"]
    seq = upload.items.index(upload.items[-1])
    flight.progress(seq)
    assert shown(flight.at(50.0, away_deg=0.007)) == ["final"]
    assert to_vehicle(flight.at(0.5, away_deg=0.0)) == []
    landed = flight.mode("mission", armed=False)
    assert "landed" in texts(landed)
    assert shown(landed) == ["none"]


def test_arduplanes_mission_contains_the_place_of_a_go_around(land: Landscape) -> None:
    (upload,) = landing_uploads(Vehicles(land, ARDUPLANE).order("land"))
    last = [item.command for item in upload.items[-3:]]
    ahead = mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT
    assert last == [mavlink.MAV_CMD_NAV_LAND, ahead, mavlink.MAV_CMD_NAV_LOITER_UNLIM]
    assert mavlink.MAV_CMD_DO_LAND_START not in [item.command for item in upload.items]


def test_a_vehicle_in_hold_is_started_into_its_landing_without_arming(land: Landscape) -> None:
    flight = Vehicles(land, ARDUPLANE)
    flight.order("hold")
    flight.mode("hold")
    flight.order("land")
    assert to_vehicle(flight.answer_uploads()) == [Land("hawk")]
    assert flight.phase() == "sending"
    assert to_vehicle(flight.at(CRUISE_M, later_s=11.0)) == [Land("hawk")]  # it was lost
    flight.mode("mission")
    assert shown(flight.at(CRUISE_M)) == ["approach"]


def test_the_measured_wind_sets_the_course_and_after_a_while_the_scenarios(land: Landscape) -> None:
    flight = Vehicles(land)
    set_terrain(flight, land, np.array(300.0))
    flight.handle(WindMeasured(flight.at_us, "hawk", 6.0, 200.0))
    flight.order("land")
    assert abs(course_of(flight) - 200.0) <= 45.0  # the edge of the map is near
    flight.order("hold")
    flight.at(CRUISE_M, later_s=200.0)
    flight.order("land")
    assert abs(course_of(flight) - 45.0) <= 45.0  # the scenario's wind


def course_of(flight: Vehicles) -> float:
    mission = flight.core.vehicles["hawk"].landing_state.mission
    assert mission is not None
    return mission.course_deg


def test_on_the_ground_and_without_a_landing_the_orders_are_rejected(land: Landscape) -> None:
    flight = Vehicles(land)
    assert "rejected: hawk: it is not landing" in texts(flight.order("go-around"))
    flight.mode("mission", armed=False)
    assert "rejected: hawk: it is on the ground" in texts(flight.order("land"))
    assert flight.phase() == "none"


def test_without_a_clear_approach_the_order_is_rejected_and_the_flight_continues(
    land: Landscape,
) -> None:
    flight = Vehicles(land, ARDUPLANE)
    x_m, y_m = flight.core.vehicles["hawk"].home_m
    row, col = (round(float(value)) for value in land.row_col_of(x_m, y_m))
    rows, cols = np.indices(land.fuel_model.shape)
    set_terrain(flight, land, np.where(np.hypot(rows - row, cols - col) > 15.0, 900.0, 300.0))
    commands = flight.order("land")
    assert "no landing approach to home" in texts(commands)
    assert to_vehicle(commands) == []
    assert flight.phase() == "none"


def test_a_plane_that_lands_by_its_return_is_not_sent_around(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.order("return")
    flight.mode("return")
    flight.at(30.0, away_deg=0.002)
    assert "rejected: hawk: it is already landing" in texts(flight.order("land"))


@pytest.mark.parametrize(("return_height_m", "lands"), [(20.0, True), (30.0, False)])
def test_arduplane_that_circles_low_above_home_after_a_return_can_be_landed(
    land: Landscape, return_height_m: float, lands: bool
) -> None:
    """RTL_ALTITUDE is 20 m in the parameters of ArduPilot's simulated quadplane."""
    flight = Vehicles(land, ARDUPLANE)
    values = {"RTL_ALTITUDE": return_height_m}
    flight.order("return")
    flight.mode("return")
    flight.handle(ParametersReported(flight.at_us, "hawk", "ardupilot plane", 255, values))
    flight.at(19.0, away_deg=0.0005)
    commands = flight.order("land")
    assert len(landing_uploads(commands)) == lands
    assert ("rejected: hawk: it is already landing in mode return" in texts(commands)) is not lands


def test_a_landing_needs_no_approval(land: Landscape) -> None:
    flight = Vehicles(land, 'mission.approval="each"')
    assert len(landing_uploads(flight.order("land"))) == 1


def test_ordered_during_an_upload_only_the_landing_is_flown(land: Landscape) -> None:
    flight = Vehicles(land, ARDUPLANE)
    flight.order("hold")
    flight.mode("hold")
    flight.order("resume")
    flight.at(CRUISE_M)
    pending = flight.core.vehicles["hawk"].pending
    assert pending is not None
    flight.order("land")
    done = UploadFinished(flight.at_us, "hawk", pending.mission_id, "accepted", "")
    assert to_vehicle(flight.handle(done)) == []
    assert to_vehicle(flight.answer_uploads()) == [Land("hawk")]


def test_while_it_waits_the_mission_of_an_earlier_upload_is_not_started(land: Landscape) -> None:
    flight = two(land, "vehicles.0.autostart=true")
    flight.approaches("kite")
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))  # autostart would start it again
    flight.mode("mission")
    flight.at(CRUISE_M)
    flight.mode("hold")
    assert flight.core.vehicles["hawk"].pending is not None
    flight.order("land")
    assert flight.phase() == "waiting"
    flight.sent.clear()
    flight.answer_uploads()
    assert to_vehicle(flight.sent) == []


def test_the_mission_of_an_earlier_landing_is_not_taken_for_the_new_one(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.approaches()
    flight.order("hold")
    flight.order("land")
    flight.mode("mission")
    flight.at(CRUISE_M)
    assert flight.phase() == "sending"
    flight.answer_uploads()
    flight.at(CRUISE_M)
    assert flight.phase() == "approach"


def test_a_copter_lands_by_its_return(land: Landscape) -> None:
    flight = Vehicles(land, COPTER)
    commands = flight.order("land")
    assert to_vehicle(commands) == [Return("hawk")]
    assert shown(commands) == ["approach"]
    flight.answer("return", accepted=False)
    assert to_vehicle(flight.at(CRUISE_M, later_s=11.0)) == [Return("hawk")]
    flight.mode("return")
    assert shown(flight.at(10.0, away_deg=0.0)) == ["final"]
    (around,) = every(flight.order("hold"), GoAround)
    assert around.altitude_amsl_m == pytest.approx(flight.home_amsl_m() + 30.0)
    flight.mode("hold")
    assert shown(flight.at(25.0, away_deg=0.0)) == ["none"]
    assert flight.core.vehicles["hawk"].ordered == "hold"


# The last leg -----------------------------------------------------------------------------------


@pytest.mark.parametrize("word", ["go-around", "hold", "abort"])
@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_on_the_last_leg_each_order_to_stop_goes_around(
    land: Landscape, stack: str, word: str
) -> None:
    flight = Vehicles(land, f'vehicles.0.stack="{stack}"')
    flight.is_on_last_leg()
    if word == "abort":
        commands = flight.handle(Aborted(flight.at_us, "ann", ""))
    else:
        commands = flight.order(word)  # type: ignore[arg-type]
    assert [type(each) for each in to_vehicle(commands)] == [GoAround]
    assert shown(commands) == ["going around"]
    mission = flight.core.vehicles["hawk"].landing_state.mission
    assert mission is not None
    (around,) = every(commands, GoAround)
    assert around.altitude_amsl_m == pytest.approx(flight.home_amsl_m() + mission.height_m)
    if stack == "px4":
        flight.mode("hold")
    assert to_vehicle(flight.at(mission.height_m - 20.0)) == []
    up = flight.at(mission.height_m - 5.0)
    assert shown(up) == ["none"]
    assert "holds at" in texts(up)
    assert flight.core.vehicles["hawk"].ordered == "hold"
    for _ in range(20):  # it stays there until an order
        assert to_vehicle(flight.at(mission.height_m)) == []
    assert len(landing_uploads(flight.order("land"))) == 1


@pytest.mark.parametrize("order", ["resume", "return", "start", "land"])
def test_on_the_last_leg_and_in_a_go_around_other_orders_are_rejected(
    land: Landscape, order: str
) -> None:
    flight = Vehicles(land)
    flight.is_on_last_leg()
    assert "rejected: hawk" in texts(flight.order(order))  # type: ignore[arg-type]
    assert flight.phase() == "final"
    flight.order("go-around")
    assert "rejected: hawk" in texts(flight.order(order))  # type: ignore[arg-type]
    assert flight.phase() == "going around"


def test_a_refused_go_around_is_reported_and_the_landing_continues(land: Landscape) -> None:
    flight = Vehicles(land, ARDUPLANE)
    flight.is_on_last_leg()
    flight.order("go-around")
    refused = flight.answer("go around", accepted=False)
    assert alarms(refused) == ["landing"]
    assert flight.phase() == "final"
    assert len(every(flight.order("go-around"), GoAround)) == 1


def test_before_the_last_leg_a_hold_and_a_go_around_hold_at_once(land: Landscape) -> None:
    for order in ("hold", "go-around"):
        flight = Vehicles(land)
        flight.approaches()
        commands = flight.order(order)
        assert to_vehicle(commands) == [Hold("hawk")]
        assert shown(commands) == ["none"]
        assert flight.core.vehicles["hawk"].ordered == "hold"


def test_the_low_height_alone_shows_the_last_leg(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.approaches()  # the report of the current item is lost
    assert shown(flight.at(20.0, away_deg=0.003)) == ["final"]
    assert len(every(flight.order("hold"), GoAround)) == 1


def test_an_armed_vehicle_on_the_ground_after_a_landing_is_no_accident(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.is_on_last_leg()
    flight.at(0.0, away_deg=0.0)
    assert alarms(flight.handle(LandedStateChanged(flight.at_us, "hawk", "on ground"))) == []


def test_a_landed_vehicle_is_not_started(land: Landscape) -> None:
    flight = Vehicles(land, "vehicles.0.autostart=true")
    flight.is_on_last_leg()
    flight.at(0.0, away_deg=0.0)
    flight.mode("mission", armed=False)
    flight.sent.clear()
    for _ in range(30):
        flight.at(0.0, away_deg=0.0)
        flight.answer_uploads()
    assert every(flight.sent, StartMission) == []
    assert every(flight.sent, Land) == []
    assert every(flight.order("start"), StartMission) == [StartMission("hawk")]


# Failures ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_after_three_failed_uploads_it_holds_with_an_alarm(land: Landscape, stack: str) -> None:
    flight = Vehicles(land, f'vehicles.0.stack="{stack}"')
    flight.order("land")
    for _ in range(2):
        assert to_vehicle(flight.answer_uploads("failed")) == [Hold("hawk")]
        assert flight.phase() == "sending"
        assert len(landing_uploads(flight.at(CRUISE_M, later_s=6.0))) == 1
    commands = flight.answer_uploads("failed")
    assert to_vehicle(commands) == [Hold("hawk")]
    assert alarms(commands) == ["landing"]
    assert flight.phase() == "none"
    assert flight.core.vehicles["hawk"].ordered == "hold"


def test_a_refused_start_of_the_landing_is_repeated_and_then_reported(land: Landscape) -> None:
    flight = Vehicles(land, ARDUPLANE)
    flight.mode("hold")
    flight.order("land", confirmed=True)
    for _ in range(2):
        flight.answer_uploads()
        flight.answer("fly landing", accepted=False)
        flight.at(CRUISE_M, later_s=6.0)
    flight.answer_uploads()
    assert alarms(flight.answer("fly landing", accepted=False)) == ["landing"]
    assert flight.phase() == "none"


@pytest.mark.parametrize("late", ["mode", "refusal"])
def test_a_landing_that_began_after_a_refused_start_is_not_sent_again(
    land: Landscape, late: str
) -> None:
    """The acknowledgement of the start was lost, but the vehicle flies its landing mission."""
    flight = Vehicles(land)
    flight.mode("hold")
    flight.order("land", confirmed=True)
    flight.answer_uploads()
    if late == "mode":
        flight.answer("fly landing", accepted=False)
    flight.mode("mission")
    if late == "refusal":
        assert not to_vehicle(flight.answer("fly landing", accepted=False))
    assert not to_vehicle(flight.at(CRUISE_M, later_s=2.0))
    assert flight.phase() == "approach"
    assert not to_vehicle(flight.at(CRUISE_M, later_s=6.0))


def test_after_the_hold_of_a_failed_upload_the_landing_is_sent_again(land: Landscape) -> None:
    """The start of the first landing mission took effect while the second one was uploaded."""
    flight = Vehicles(land)
    flight.mode("hold")
    flight.order("land", confirmed=True)
    flight.answer_uploads()
    flight.answer("fly landing", accepted=False)
    assert len(landing_uploads(flight.at(CRUISE_M, later_s=6.0))) == 1
    flight.mode("mission")
    assert to_vehicle(flight.answer_uploads("failed")) == [Hold("hawk")]
    flight.at(CRUISE_M)
    assert flight.phase() == "sending"
    flight.mode("hold")
    assert len(landing_uploads(flight.at(CRUISE_M, later_s=6.0))) == 1


@pytest.mark.parametrize("replaced", [True, False])
def test_a_hold_that_replaced_another_one_may_take_effect_later(
    land: Landscape, replaced: bool
) -> None:
    flight = Vehicles(land)
    flight.order("hold")
    if replaced:
        flight.order("hold")
    flight.answer("hold", accepted=False)
    flight.at(CRUISE_M, later_s=10.0)
    flight.mode("hold")
    assert flight.core.vehicles["hawk"].availability.taken_over != replaced


def phase_reached(flight: Vehicles, phase: str) -> None:
    """Let a vehicle reach a phase of a landing."""
    if phase == "waiting":
        flight.approaches("kite")
        flight.order("land")
    elif phase == "sending":
        flight.order("land")
    elif phase == "approach":
        flight.approaches()
    else:
        flight.is_on_last_leg()
        if phase == "going around":
            flight.order("go-around")
    assert flight.phase() == phase


PHASES = ("waiting", "sending", "approach", "final", "going around")


def two(land: Landscape, *overrides: str) -> Vehicles:
    """Return two vehicles with homes at the same field."""
    hawk = load_scenario("demo").vehicles[0]
    home = (
        f"vehicles.1.home_lat_deg={hawk.home_lat_deg}",
        f"vehicles.1.home_lon_deg={hawk.home_lon_deg + 0.001}",
    )
    return Vehicles(land, *home, *overrides, count=2)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("mode", ["manual", "return", "land"])
def test_a_pilot_or_a_failsafe_ends_the_landing_and_nothing_more_is_sent(
    land: Landscape, phase: str, mode: str
) -> None:
    flight = two(land)
    phase_reached(flight, phase)
    assert shown(flight.mode(mode))[-1:] == ["none"]
    flight.sent.clear()
    for height_m in (40.0, 20.0, 60.0, 10.0):
        flight.at(height_m, away_deg=0.003)
        flight.answer_uploads()
    assert [each for each in to_vehicle(flight.sent) if each.vehicle == "hawk"] == []


@pytest.mark.parametrize("phase", PHASES)
def test_a_restart_of_the_autopilot_ends_the_landing(land: Landscape, phase: str) -> None:
    flight = two(land)
    phase_reached(flight, phase)
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))
    assert flight.phase() == "none"


def test_back_in_the_landing_mission_the_landing_continues(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.is_on_last_leg()
    flight.mode("manual")
    flight.at(40.0, away_deg=0.004)
    back = flight.mode("mission")
    assert shown(back) == ["approach"]
    flight.sent.clear()
    flight.at(30.0, away_deg=0.003)
    assert flight.phase() == "final"
    assert to_vehicle(flight.sent) == []  # in particular no new mission


def test_in_a_failsafe_a_landing_must_be_confirmed(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.handle(SystemStateChanged(flight.at_us, "hawk", "critical"))
    flight.mode("return")
    assert "confirm: hawk" in texts(flight.order("land"))
    assert flight.phase() == "none"
    assert len(landing_uploads(flight.order("land", confirmed=True))) == 1


# Several vehicles ---------------------------------------------------------------------------------


def test_at_one_field_the_second_waits_until_the_first_has_landed(land: Landscape) -> None:
    flight = two(land)
    commands = flight.order("land", "")
    assert shown(commands) == ["sending", "waiting"]
    (upload,) = landing_uploads(commands)
    first, second = upload.vehicle, "kite" if upload.vehicle == "hawk" else "hawk"
    assert to_vehicle([each for each in commands if each.vehicle == second]) == [Hold(second)]
    flight.answer_uploads()
    flight.mode("hold", second)
    flight.at(CRUISE_M, first)
    assert landing_uploads(flight.at(CRUISE_M, second)) == []
    flight.at(0.0, first, away_deg=0.0)
    flight.mode("mission", first, armed=False)
    begun = flight.at(CRUISE_M, second)
    assert [each.vehicle for each in landing_uploads(begun)] == [second]
    assert shown(begun) == ["sending"]


def test_the_vehicle_at_the_front_keeps_clear_of_the_descent_of_another(land: Landscape) -> None:
    """Between the order to land and the descent to its altitude it flies around the approach."""
    flight = two(land)
    flight.progress(2, "hawk")  # after its takeoff
    (upload,) = landing_uploads(flight.order("land", "kite"))
    flight.answer_uploads()
    flight.mode("mission", "kite")
    flight.at(2.0 * CRUISE_M, "kite")
    assert flight.phase("kite") == "approach"
    loiter = next(
        item for item in upload.items if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT
    )
    place = (loiter.x / 1e7 - 0.001, loiter.y / 1e7)  # 110 m south of its centre
    flight.at_s += 1.0
    height = (flight.home_amsl_m("hawk") + CRUISE_M, CRUISE_M)
    commands = flight.handle(Telemetry(flight.at_us, "hawk", *place, *height, 12.0, 0.0, 0.0))
    why = [each.why for each in commands if isinstance(each, UploadMission)]
    assert why == ["give way to kite"]


def test_a_vehicle_that_waits_too_long_raises_an_alarm_and_waits_on(land: Landscape) -> None:
    flight = two(land)
    flight.approaches("kite")
    flight.order("land")
    flight.mode("hold")
    assert alarms(flight.at(CRUISE_M, later_s=290.0)) == []
    assert alarms(flight.at(CRUISE_M, later_s=20.0)) == ["landing"]
    assert alarms(flight.at(CRUISE_M, later_s=300.0)) == []
    assert flight.phase() == "waiting"


def test_a_vehicle_that_waits_is_sent_home_at_the_end_of_its_endurance(land: Landscape) -> None:
    flight = two(land, "vehicles.0.endurance_s=1000", ARDUPLANE)
    flight.approaches("kite")
    flight.order("land")
    flight.mode("hold")
    assert to_vehicle(flight.at(CRUISE_M, later_s=100.0)) == []
    assert to_vehicle(flight.at(CRUISE_M, later_s=800.0)) == [Return("hawk")]
    flight.mode("return")
    flight.at(CRUISE_M, "kite")
    assert to_vehicle(flight.at(CRUISE_M, away_deg=0.002)) == []
    assert flight.phase() == "waiting"
    flight.mode("mission", "kite", armed=False)
    assert len(landing_uploads(flight.at(CRUISE_M, away_deg=0.002))) == 1


def test_a_vehicle_whose_link_is_lost_in_its_landing_is_not_waited_for_any_longer(
    land: Landscape,
) -> None:
    flight = two(land)
    flight.approaches("kite")
    flight.is_on_last_leg("kite")
    flight.order("land")
    flight.mode("hold")
    flight.at(CRUISE_M, later_s=230.0)
    assert flight.phase() == "waiting"
    assert len(landing_uploads(flight.at(CRUISE_M, later_s=15.0))) == 1


def test_at_other_fields_vehicles_land_at_the_same_time(land: Landscape) -> None:
    flight = two(land, "vehicles.1.home_lat_deg=36.36")
    assert shown(flight.order("land", "")) == ["sending", "sending"]


# Endurance ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_at_the_end_of_its_endurance_only_arduplane_is_sent_a_landing(
    land: Landscape, stack: str
) -> None:
    override = ("vehicles.0.endurance_s=1000", f'vehicles.0.stack="{stack}"')
    flight = Vehicles(land, *override)
    assert len(every(flight.at(CRUISE_M, later_s=900.0), Return)) == 1
    flight.mode("return")
    assert landing_uploads(flight.at(CRUISE_M)) == []  # it is not yet home
    home = flight.at(CRUISE_M, away_deg=0.002)
    assert len(landing_uploads(home)) == (stack == "ardupilot")
    assert flight.phase() == ("sending" if stack == "ardupilot" else "none")


def test_a_failed_landing_at_the_end_of_the_endurance_leaves_it_above_home(land: Landscape) -> None:
    flight = Vehicles(land, "vehicles.0.endurance_s=1000", ARDUPLANE)
    flight.at(CRUISE_M, later_s=900.0)
    flight.mode("return")
    flight.at(CRUISE_M, away_deg=0.002)
    for _ in range(2):
        assert to_vehicle(flight.answer_uploads("failed")) == []
        flight.at(CRUISE_M, later_s=6.0, away_deg=0.002)
    failed = flight.answer_uploads("failed")
    assert alarms(failed) == ["landing"]
    assert to_vehicle(failed) == []  # it circles above home by its return
    assert to_vehicle(flight.at(CRUISE_M, later_s=60.0, away_deg=0.002)) == []


# Restarts of the service ------------------------------------------------------------------------


def restart(flight: Vehicles, mode: str, mission_id: int, armed: bool = True) -> None:
    """Restart the service from a snapshot; the vehicle then reports a mode and a mission."""
    flight.core = pickle.loads(pickle.dumps(flight.core))
    flight.sent.clear()
    flight.at_s += 5.0
    flight.handle(Resumed(flight.at_us, "service", "", 5.0))
    flight.handle(VehicleConnected(flight.at_us, "hawk", "a stack", True))
    flight.mode(mode, armed=armed)
    flight.at(CRUISE_M if armed else 0.0)
    assert to_vehicle(flight.sent) == []
    flight.handle(MissionReadBack(flight.at_us, "hawk", mission_id, 5))


def last_mission_id(flight: Vehicles) -> int:
    return landing_uploads(flight.sent)[-1].mission_id


@pytest.mark.parametrize("phase", ["approach", "final"])
def test_after_a_restart_a_landing_that_is_flown_continues(land: Landscape, phase: str) -> None:
    flight = Vehicles(land)
    phase_reached(flight, phase)
    restart(flight, "mission", last_mission_id(flight))
    flight.at(20.0, away_deg=0.003)
    assert flight.phase() == "final"
    assert to_vehicle(flight.sent) == []


@pytest.mark.parametrize("phase", ["waiting", "sending", "approach"])
@pytest.mark.parametrize("mode", ["mission", "hold"])
def test_after_a_restart_a_landing_that_is_not_flown_ends_in_a_hold(
    land: Landscape, phase: str, mode: str
) -> None:
    flight = two(land, ARDUPLANE)
    phase_reached(flight, phase)
    flight.mode(mode)
    restart(flight, mode, 0)
    flight.at(CRUISE_M)
    assert flight.phase() == "none"
    assert flight.core.vehicles["hawk"].ordered == "hold"
    assert to_vehicle(flight.sent) != []
    assert set(map(type, to_vehicle(flight.sent))) == {Hold}


def test_after_a_landing_and_a_restart_a_start_needs_another_mission(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.is_on_last_leg()
    landing_id = last_mission_id(flight)
    flight.at(0.0, away_deg=0.0)
    flight.mode("mission", armed=False)
    restart(flight, "mission", landing_id, armed=False)
    assert every(flight.order("start"), StartMission) == []
    flight.at(0.0, away_deg=0.0)
    flight.answer_uploads()
    flight.at(0.0, later_s=5.0, away_deg=0.0)
    (upload,) = every(flight.sent, UploadMission)
    assert not upload.lands
    assert every(flight.sent, StartMission) == [StartMission("hawk")]


def test_on_the_ground_no_landing_is_flown_by_any_order(land: Landscape) -> None:
    flight = Vehicles(land)
    assert not flight.core._withheld(Land("hawk"))
    flight.mode("mission", armed=False)
    assert flight.core._withheld(Land("hawk"))


@pytest.mark.parametrize("mode", ["return", "mission"])
def test_after_a_restart_a_copter_returns_again_if_it_does_not(land: Landscape, mode: str) -> None:
    flight = Vehicles(land, COPTER)
    flight.order("land")
    flight.mode(mode)
    restart(flight, mode, 0)
    assert to_vehicle(flight.sent) == ([] if mode == "return" else [Return("hawk")])
    assert flight.phase() == "approach"


def test_after_a_restart_a_go_around_ends_in_its_hold(land: Landscape) -> None:
    flight = Vehicles(land)
    phase_reached(flight, "going around")
    flight.mode("hold")
    restart(flight, "hold", last_mission_id(flight))
    flight.at(60.0)
    assert flight.phase() == "none"
    assert flight.core.vehicles["hawk"].ordered == "hold"


def test_the_service_gives_no_order_to_a_vehicle_that_lands(land: Landscape) -> None:
    flight = Vehicles(land)
    flight.is_on_last_leg()
    for order in ("hold", "return"):
        given = OrderGiven(flight.at_us, "service", "", "hawk", order)
        assert to_vehicle(flight.handle(given)) == []
    assert flight.phase() == "final"
