"""A return that would be too low for the ground raises an alarm, and is led over the ground."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from pymavlink.dialects.v20.ardupilotmega import MAV_CMD_NAV_LOITER_TO_ALT

from autopilot_bridge.items import AMSL_FRAMES
from autopilot_bridge.stacks.return_flight import ReturnFlight
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import mission_places
from mission_service.commands import (
    AnyCommand,
    ClearAlarm,
    Hold,
    HoldAt,
    RaiseAlarm,
    Return,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    AirspaceClosed,
    MissionReadBack,
    ParametersReported,
    Resumed,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
)
from mission_service.fire.scenario_fire import landscape_of
from tests.service.landing_core import CRUISE_M, Vehicles, every, texts
from tests.service.test_clearing import Cleared

GROUND_M, RIDGE_M = 300.0, 200.0  # the ridge is this high above home, and 600 m west of it


@lru_cache(maxsize=1)
def ridge() -> Landscape:
    demo = load_scenario("demo")
    land, home = landscape_of(demo), demo.vehicles[0]
    lat_deg, lon_deg = home.home_lat_deg, home.home_lon_deg
    assert lat_deg is not None
    assert lon_deg is not None
    _, col = land.cell_of_lat_lon(lat_deg, lon_deg - 0.0067)
    elevation_m = np.full(land.shape, GROUND_M, dtype=np.float32)
    elevation_m[:, col - 2 : col + 3] += RIDGE_M
    return replace(land, elevation_m=elevation_m)


def alarms(commands: list[AnyCommand]) -> list[RaiseAlarm | ClearAlarm]:
    return [
        each
        for each in commands
        if isinstance(each, RaiseAlarm | ClearAlarm) and each.alarm == "return"
    ]


def test_a_return_below_a_ridge_raises_an_alarm_until_the_vehicle_is_high_enough() -> None:
    vehicles = Vehicles(ridge())
    (raised,) = alarms(vehicles.sent)
    assert isinstance(raised, RaiseAlarm)
    assert raised.severity == "severe"
    assert "50 m below the highest ground on the way home (500 m AMSL)" in raised.text
    assert "set the return altitude to at least 230 m above home" in raised.text
    assert not alarms(vehicles.at(CRUISE_M, later_s=20.0))  # not repeated
    assert alarms(vehicles.at(RIDGE_M + 30.0, later_s=20.0)) == [ClearAlarm("hawk", "return")]
    assert alarms(vehicles.at(CRUISE_M, later_s=20.0))
    vehicles.mode("return")
    assert alarms(vehicles.mode("hold", armed=False)) + alarms(vehicles.at(0.0, later_s=20.0)) == [
        ClearAlarm("hawk", "return")
    ]


def test_no_alarm_is_raised_on_the_side_of_home() -> None:
    vehicles = Vehicles(ridge())
    vehicles.sent.clear()
    cleared = vehicles.at(CRUISE_M, later_s=20.0, away_deg=-0.0134)
    assert alarms(cleared) == [ClearAlarm("hawk", "return")]


@pytest.mark.parametrize(("height_m", "raised"), [(100.0, True), (-1.0, False), (230.0, False)])
def test_arduplane_descends_to_the_height_of_its_parameter(height_m: float, raised: bool) -> None:
    """-1 is a return at the altitude of the vehicle."""
    vehicles = Vehicles(ridge(), "vehicles.0.stack=ardupilot")
    vehicles.at(RIDGE_M + 30.0, later_s=20.0)
    values = {"RTL_ALTITUDE": height_m}
    vehicles.handle(ParametersReported(vehicles.at_us, "hawk", "ardupilot plane", 255, values))
    found = alarms(vehicles.at(RIDGE_M + 30.0, later_s=20.0))
    assert [type(each) for each in found] == [RaiseAlarm] * raised


@pytest.mark.parametrize(
    ("kind", "height_m", "raised"),
    [("plane", 215.0, True), ("plane", 225.0, False), ("copter", 215.0, False)],
)
def test_a_px4_plane_ends_its_climb_10_m_below_the_return_altitude(
    kind: str, height_m: float, raised: bool
) -> None:
    vehicles = Vehicles(ridge(), f"vehicles.0.kind={kind}")
    vehicles.at(RIDGE_M + 30.0, later_s=20.0)
    values = {"RTL_RETURN_ALT": height_m}
    vehicles.handle(ParametersReported(vehicles.at_us, "hawk", f"px4 {kind}", 255, values))
    found = alarms(vehicles.at(CRUISE_M, later_s=20.0))
    assert [type(each) for each in found] == [RaiseAlarm] * raised


def test_a_return_below_a_ridge_is_led_over_it_until_the_straight_way_is_clear() -> None:
    vehicles = Vehicles(ridge())
    given = vehicles.order("return")
    (around,) = every(given, UploadMission)
    assert not every(given, Return)
    assert "would enter" not in texts(given)
    assert "flies home around the airspace just above terrain at 500 m AMSL" in texts(given)
    highest_m = max(item.z for item in around.items if item.frame in AMSL_FRAMES)
    assert highest_m >= GROUND_M + RIDGE_M + 30.0
    vehicles.answer_uploads()
    vehicles.mode("mission")
    vehicles.answer("start mission")
    assert not every(vehicles.at(CRUISE_M, later_s=20.0), Return)
    # 12 m above the ridge it flies on, because it does not hold its altitude exactly.
    assert not every(vehicles.at(RIDGE_M + 12.0, later_s=20.0), Return)
    assert every(vehicles.at(RIDGE_M + 30.0, later_s=20.0), Return) == [Return("hawk")]
    # Over a bad link the bridge repeats this order; a second order would end the first.
    assert not every(vehicles.at(RIDGE_M + 30.0, later_s=20.0), Return)
    assert every(vehicles.at(RIDGE_M + 30.0, later_s=20.0), Return) == [Return("hawk")]


def test_after_a_restart_of_the_service_the_return_is_ordered_once() -> None:
    """The mission home could not be read back, and the way home is now clear."""
    vehicles = Vehicles(ridge())
    vehicles.order("return")
    vehicles.answer_uploads()
    vehicles.mode("mission")
    vehicles.answer("start mission")
    vehicles.handle(Resumed(vehicles.at_us, "service", "", 20.0))
    vehicles.handle(VehicleConnected(vehicles.at_us, "hawk", "px4 plane", True))
    vehicles.mode("mission")
    vehicles.at(RIDGE_M + 30.0, later_s=20.0)
    given = vehicles.handle(MissionReadBack(vehicles.at_us, "hawk", 0, None))
    for _ in range(3):
        given += vehicles.at(RIDGE_M + 30.0, later_s=5.0)
    assert every(given, Return) == [Return("hawk")]


def test_a_return_above_the_ridge_is_not_changed() -> None:
    vehicles = Vehicles(ridge())
    vehicles.at(RIDGE_M + 30.0, later_s=20.0)
    assert every(vehicles.order("return"), Return) == [Return("hawk")]


def test_at_the_end_of_its_energy_a_vehicle_is_led_over_the_ridge() -> None:
    vehicles = Vehicles(ridge(), "vehicles.0.endurance_s=600", "vehicles.0.endurance_reserve_s=60")
    given = vehicles.at(CRUISE_M, later_s=560.0)
    assert [each.why for each in every(given, UploadMission)] == [
        "fly home clear of closed airspace and terrain"
    ]
    assert not every(given, Return)


def test_a_vehicle_below_an_altitude_limit_holds_before_the_ridge() -> None:
    vehicles = Vehicles(ridge(), "airspace.max_altitude_agl_m=210.0")
    given = vehicles.order("return")
    assert not every(given, Return) + every(given, UploadMission)
    assert every(given, Hold) == [Hold("hawk")]
    assert "holds short of the airspace just above terrain" in texts(given)


def test_a_multirotor_is_not_ordered_to_land_through_the_ridge() -> None:
    vehicles = Vehicles(ridge(), 'vehicles.0.kind="copter"')
    given = vehicles.order("land")
    assert not every(given, Return)
    assert "its way home would enter the airspace just above terrain" in texts(given)
    assert every(vehicles.order("return"), UploadMission)


def test_the_ground_counts_on_the_way_to_the_landing_to_which_the_return_leads() -> None:
    vehicles = Vehicles(ridge())
    hawk = vehicles.core.vehicles["hawk"]
    fix = hawk.availability.fix
    assert fix is not None
    obstacle = vehicles.core.return_ground.obstacle
    assert obstacle(hawk, fix, hawk.home_m)
    assert obstacle(hawk, fix, (fix.x_m - 500.0, fix.y_m)) is None


@pytest.mark.parametrize(
    ("height_m", "state", "words"),
    [
        (100.0, "fail", "set the return altitude to at least 220 m above home"),
        (260.0, "pass", "above the ground"),
    ],
)
def test_the_return_from_the_mission_is_checked_before_takeoff(
    height_m: float, state: str, words: str
) -> None:
    vehicles = Vehicles(ridge(), "vehicles.0.stack=ardupilot")
    hawk = vehicles.core.vehicles["hawk"]
    hawk.return_flight = ReturnFlight(height_m=height_m)
    vehicles.mode("hold", armed=False)
    places, goal_m = vehicles.core.airspace.mission_and_return(hawk)
    assert places
    assert goal_m == hawk.home_m
    vehicles.at(0.0, later_s=2.0)
    (found,) = [each for each in hawk.preflight.checks if each.name == "return"]
    assert found.state == state
    assert words in found.text


def test_ground_near_home_does_not_prevent_the_return_at_the_end_of_a_mission_home() -> None:
    """A return altitude below 10 m would otherwise never be high enough."""
    vehicles = Vehicles(ridge(), "vehicles.0.stack=ardupilot", "vehicles.0.return_height_m=5")
    assert every(vehicles.order("return"), UploadMission)
    vehicles.answer_uploads()
    vehicles.mode("mission")
    vehicles.answer("start mission")
    assert every(vehicles.at(CRUISE_M, later_s=20.0, away_deg=0.003), Return)


def test_an_altitude_limit_does_not_prevent_a_return() -> None:
    """The limit is lower than the 150 m above home up to which returns are checked."""
    land = replace(ridge(), elevation_m=np.full_like(ridge().elevation_m, GROUND_M))
    limit = ("vehicles.0.altitude_agl_m=100", "vehicles.1.altitude_agl_m=100")
    vehicles = Vehicles(land, *limit, "airspace.max_altitude_agl_m=120.0")
    assert every(vehicles.order("return"), Return) == [Return("hawk")]
    vehicles.mode("return")
    assert "airspace" not in [
        each.alarm for each in every(vehicles.at(100.0, later_s=20.0), RaiseAlarm)
    ]


@pytest.mark.parametrize(("height_m", "led"), [(None, True), (-1.0, False), (230.0, True)])
def test_no_return_of_arduplane_relies_on_a_climb_or_an_unread_parameter(
    height_m: float | None, led: bool
) -> None:
    """The unread parameter may let the plane descend to 100 m; a climb is on the way."""
    vehicles = Vehicles(ridge(), "vehicles.0.stack=ardupilot")
    up_m = RIDGE_M + 30.0 if height_m != 230.0 else CRUISE_M
    if height_m is not None:
        values = {"RTL_ALTITUDE": height_m}
        vehicles.handle(ParametersReported(vehicles.at_us, "hawk", "ardupilot plane", 255, values))
    vehicles.at(up_m, later_s=20.0)
    given = vehicles.order("return")
    assert bool(every(given, UploadMission)) is led
    assert bool(every(given, Return)) is not led


def test_a_restart_of_the_autopilot_does_not_end_the_flight_home() -> None:
    vehicles = Vehicles(ridge(), "vehicles.0.stack=ardupilot")
    vehicles.order("return")
    vehicles.mode("hold")
    vehicles.answer_uploads()
    vehicles.mode("mission")
    vehicles.answer("start mission")
    vehicles.handle(VehicleRebooted(vehicles.at_us, "hawk"))
    vehicles.mode("mission")
    (again,) = every(vehicles.at(CRUISE_M, later_s=1.0), UploadMission)
    assert again.why == "fly home clear of closed airspace and terrain"


def test_to_clear_the_airspace_a_multirotor_behind_a_ridge_flies_home_first() -> None:
    flight = Cleared(ridge(), 'vehicles.0.kind="copter"')
    (around,) = every(flight.clear(), UploadMission)
    assert around.why == "fly home clear of closed airspace and terrain"
    flight.answer_uploads()
    flight.mode("mission")
    flight.answer("start mission")
    assert not every(flight.at(CRUISE_M, later_s=20.0), UploadMission)
    assert flight.row("hawk") == "on its way"
    flight.at(CRUISE_M, later_s=20.0, away_deg=0.001)
    flight.mode("return")
    flight.at(CRUISE_M, later_s=20.0, away_deg=0.001)
    assert flight.row("hawk") == "on its way"


@pytest.mark.parametrize(("stack", "climbs"), [("px4", True), ("ardupilot", False)])
def test_a_vehicle_that_accepts_no_mission_home_climbs_and_returns(
    stack: str, climbs: bool
) -> None:
    """A climb does not help ArduPlane, which descends to the height of its parameter."""
    vehicles = Vehicles(ridge(), f"vehicles.0.stack={stack}")
    found = vehicles.order("return")
    for _ in range(2):
        assert not every(found, HoldAt)
        (upload,) = every(found, UploadMission)
        reason = UploadFinished(vehicles.at_us, "hawk", upload.mission_id, "failed", "no reply")
        vehicles.handle(reason)
        found = vehicles.at(CRUISE_M, later_s=20.0)
    assert every(found, UploadMission)  # the next one may be accepted
    altitudes_m = [each.altitude_amsl_m for each in every(found, HoldAt)]
    assert altitudes_m == [GROUND_M + RIDGE_M + 20.0] * climbs
    words = "climbs to 520 m AMSL to return" if climbs else "its return would be too low"
    (alarm,) = (
        each for each in every(found, RaiseAlarm) if "does not accept a mission home" in each.text
    )
    assert (alarm.alarm, alarm.severity) == ("airspace", "severe")
    assert words in alarm.text
    if climbs:
        vehicles.mode("hold")
        (upload,) = every(found, UploadMission)
        vehicles.handle(UploadFinished(vehicles.at_us, "hawk", upload.mission_id, "failed", ""))
        assert every(vehicles.at(RIDGE_M + 20.0, later_s=20.0), Return) == [Return("hawk")]


def test_a_climb_before_a_return_does_not_enter_closed_airspace() -> None:
    """The volume is above the circle of the climb, and not on the way of the mission home."""
    vehicles = Vehicles(ridge())
    fix = vehicles.core.vehicles["hawk"].availability.fix
    assert fix is not None
    lat_deg, lon_deg = map(float, ridge().lat_lon_of(fix.x_m, fix.y_m))
    corners = tuple(
        (lat_deg + north_deg, lon_deg + east_deg)
        for north_deg, east_deg in (
            (-1e-3, -25e-4),
            (-1e-3, -19e-4),
            (1e-3, -19e-4),
            (1e-3, -25e-4),
        )
    )
    person = (vehicles.at_us, "ann", "test")
    vehicles.handle(AirspaceClosed(*person, "above", corners, GROUND_M + RIDGE_M))
    found = vehicles.order("return")
    for _ in range(2):
        (upload,) = every(found, UploadMission)
        vehicles.handle(UploadFinished(vehicles.at_us, "hawk", upload.mission_id, "failed", ""))
        found = vehicles.at(CRUISE_M, later_s=20.0)
    assert not every(found, HoldAt)
    (alarm,) = (
        each for each in every(found, RaiseAlarm) if "does not accept a mission home" in each.text
    )
    assert "its return would be too low" in alarm.text


def test_a_plane_of_a_formation_climbs_before_the_ridge_and_flies_around_corners() -> None:
    vehicles = Vehicles(ridge(), 'planner.rule="formation"')
    vehicles.at(CRUISE_M, later_s=1.0, away_deg=0.0085)  # 150 m before the ridge
    (home,) = every(vehicles.order("return"), UploadMission)
    assert home.items[0].command == MAV_CMD_NAV_LOITER_TO_ALT
    assert home.items[0].z >= GROUND_M + RIDGE_M + 10.0
    hawk = vehicles.core.vehicles["hawk"]
    assert hawk.availability.fix is not None
    x_m, y_m = hawk.availability.fix.x_m, hawk.availability.fix.y_m
    path_m = np.array([(x_m, y_m), (x_m - 500.0, y_m), (x_m - 500.0, y_m - 900.0)])
    led = vehicles.core.guidance.items(hawk, path_m, hawk.availability.fix)
    places = [each.position for each in mission_places(led, ridge(), 0.0)]
    assert min(np.hypot(x - x_m + 500.0, y - y_m) for x, y, _ in places) < 60.0  # the corner
