"""VTOLs in the service: the items of takeoff and landing, the phases of a landing, the kind."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.check import check
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.commands import GoAround, Hold, ReportChecks, Return
from mission_service.config.scenario import load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.events import ParametersReported, VehicleConnected
from mission_service.fire.scenario_fire import landscape_of
from mission_service.missions.departure import takeoff_items
from mission_service.missions.from_path import mission_along
from mission_service.missions.landing import vtol_leg_m
from mission_service.missions.landing_mission import landing_mission
from mission_service.missions.mission_figures import figures_of
from mission_service.missions.separation import descent_of
from tests.service.landing_core import CRUISE_M, Vehicles, every, landing_uploads
from tests.service.test_landing import FLAT, HOME_M, X, course_deg, section
from tests.service.test_landing import land as terrain
from tests.service.test_preflight import WAITS, Ground

VTOL = 'vehicles.0.kind="vtol"'
ARDUPILOT = 'vehicles.0.stack="ardupilot"'
STACKS = ("px4", "ardupilot")
TAKEOFF, CLIMB = mavlink.MAV_CMD_NAV_VTOL_TAKEOFF, mavlink.MAV_CMD_NAV_LOITER_TO_ALT
LAND = mavlink.MAV_CMD_NAV_VTOL_LAND
FORWARD = mavlink.MAV_CMD_DO_VTOL_TRANSITION
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
FROM_M = (500_000.0, 4_000_000.0)  # of HOME_M on the map
ON_MAP_M = (FROM_M[0] + HOME_M[0], FROM_M[1] + HOME_M[1])
NORTH_ON_MAP_M = (ON_MAP_M[0], ON_MAP_M[1] + 2000.0)


@pytest.fixture(scope="module")
def demo() -> Landscape:
    return landscape_of(load_scenario("demo"))


def vtol(stack: str = "px4", **more: object) -> VehicleSection:
    return section(kind="vtol", stack=stack, **more)


def place_m(item: MissionItem) -> tuple[float, float]:
    """Return the x, y of an item, as for ``HOME_M``."""
    x_m, y_m = FLAT.xy_of_lat_lon(item.x / 1e7, item.y / 1e7)
    return float(x_m) - FROM_M[0], float(y_m) - FROM_M[1]


@pytest.mark.parametrize("stack", STACKS)
def test_a_mission_from_the_ground_climbs_vertically_and_then_in_a_loiter(stack: str) -> None:
    vehicle, path = vtol(stack), np.array([ON_MAP_M, NORTH_ON_MAP_M])
    items = mission_along(path, True, vehicle, FLAT, from_ground=True)
    up, climb, *rest = items
    assert (up.command, up.frame, up.z) == (TAKEOFF, RELATIVE, 40.0)
    leaves_m = place_m(up)
    assert leaves_m == pytest.approx((HOME_M[0], HOME_M[1] + vtol_leg_m(vehicle)), abs=1.0)
    assert (climb.command, climb.z) == (CLIMB, 450.0)
    assert math.dist(place_m(climb), leaves_m) == pytest.approx(vehicle.loiter_radius_m, abs=1.0)
    assert TAKEOFF not in [item.command for item in rest]
    assert check(items, stack_named(stack, "vtol")) == []


@pytest.mark.parametrize(("stack", "first"), [("px4", FORWARD), ("ardupilot", 178)])
def test_a_mission_in_the_air_ends_a_hover_of_px4(stack: str, first: int) -> None:
    path = np.array([ON_MAP_M, NORTH_ON_MAP_M])
    items = mission_along(path, True, vtol(stack), FLAT, from_ground=False)
    assert items[0].command == first
    assert [item.command for item in items].count(FORWARD) == (stack == "px4")
    assert check(items, stack_named(stack, "vtol")) == []


def test_a_hill_ahead_turns_the_departure_aside() -> None:
    east = terrain(np.where(HOME_M[0] + 100.0 < X, 500.0, 300.0))
    straight_m = vtol_leg_m(vtol())
    for landscape, aside in ((FLAT, False), (east, True)):
        up, _ = takeoff_items(vtol(), landscape, 450.0, (ON_MAP_M[0] + 2000.0, ON_MAP_M[1]))
        east_m = place_m(up)[0] - HOME_M[0]
        assert (east_m < straight_m / 2.0) is aside


def test_a_narrow_bowl_has_no_departure_and_no_approach() -> None:
    bowl = terrain(np.where(np.hypot(X - HOME_M[0], X.T[::-1] - HOME_M[1]) > 150.0, 600.0, 300.0))
    with pytest.raises(ScenarioError, match="no departure from home"):
        takeoff_items(vtol(), bowl, 700.0, NORTH_ON_MAP_M)
    with pytest.raises(ScenarioError, match="no landing approach"):
        landing_mission(vtol(), bowl, (0.0, 0.0), NORTH_ON_MAP_M)


@pytest.mark.parametrize("stack", STACKS)
def test_the_landing_ends_at_home_after_a_straight_line_into_the_wind(stack: str) -> None:
    vehicle = vtol(stack)
    mission = landing_mission(vehicle, FLAT, (10.0, 200.0), NORTH_ON_MAP_M)
    loiter, touchdown = mission.items[mission.final_seq - 1 : mission.final_seq + 1]
    assert (loiter.command, touchdown.command) == (CLIMB, LAND)
    assert (loiter.z, touchdown.z, mission.height_m) == (40.0, 0.0, 40.0)
    assert place_m(touchdown) == pytest.approx(HOME_M, abs=0.1)
    away_m = math.dist(place_m(loiter), HOME_M)
    line_m = math.sqrt(away_m**2 - vehicle.loiter_radius_m**2)
    assert line_m == pytest.approx(vtol_leg_m(vehicle), abs=1.0)
    assert mission.course_deg == pytest.approx(200.0)
    problems = check(mission.items, stack_named(stack, "vtol"))
    assert {each.kind for each in problems} <= {"changed"}  # ArduPilot drops the exit's heading


@pytest.mark.parametrize("stack", STACKS)
def test_the_figures_and_the_descent_of_a_vtol(stack: str) -> None:
    vehicle, path = vtol(stack), np.array([ON_MAP_M, NORTH_ON_MAP_M])
    items = mission_along(path, True, vehicle, FLAT, from_ground=True)
    figures = figures_of(items, FLAT, vehicle, None)
    assert (figures.min_height_agl_m, figures.highest_amsl_m) == (150.0, 450.0)
    mission = landing_mission(vehicle, FLAT, (10.0, 200.0), NORTH_ON_MAP_M)
    descent_m = descent_of(mission.items, FLAT, vehicle.loiter_radius_m)
    away_m = np.hypot(*(descent_m - ON_MAP_M).T)
    assert away_m[-1] < 1.0
    assert away_m.max() < vtol_leg_m(vehicle) + 2.0 * vehicle.loiter_radius_m


def test_missions_of_px4s_vtol_end_with_a_vertical_landing() -> None:
    vehicle = vtol()
    assert course_deg(FLAT, vehicle, 45.0) == pytest.approx(45.0, abs=0.1)


def test_its_last_leg_is_the_vertical_descent(demo: Landscape) -> None:
    flight = Vehicles(demo, VTOL)
    flight.approaches()
    mission = flight.core.vehicles["hawk"].landing_state.mission
    assert mission is not None
    flight.progress(mission.final_seq)
    flight.at(mission.height_m, away_deg=0.002)  # it flies to home
    assert flight.phase() == "approach"
    assert every(flight.order("hold"), Hold)
    flight.approaches()
    flight.progress(mission.final_seq)
    flight.at(mission.height_m - 5.0, away_deg=0.0)
    assert flight.phase() == "approach"
    flight.at(mission.height_m - 20.0, away_deg=0.0)
    assert flight.phase() == "final"
    (around,) = every(flight.order("hold"), GoAround)
    home = flight.core.vehicles["hawk"].section
    assert (around.lat_deg, around.lon_deg) == pytest.approx(
        (home.home_lat_deg, home.home_lon_deg), abs=1e-6
    )
    assert flight.phase() == "going around"
    flight.at(mission.height_m, away_deg=0.0)
    assert flight.phase() == "none"
    again = landing_uploads(flight.order("land"))
    assert again[0].items[0].command == FORWARD


def test_its_takeoff_lasts_until_the_end_of_the_climb(demo: Landscape) -> None:
    flight = Vehicles(demo, VTOL)
    vehicle = flight.core.vehicles["hawk"]
    for seq, takes_off in ((0, True), (1, True), (2, False)):
        vehicle.takes_off = True
        flight.progress(seq)
        assert vehicle.takes_off is takes_off


def test_a_quadplane_that_lands_after_its_return_flies_home(demo: Landscape) -> None:
    flight = Vehicles(demo, VTOL, ARDUPILOT)
    assert every(flight.order("return"), Return)
    flight.mode("return")
    flight.at(CRUISE_M, later_s=200.0)
    flight.mode("qrtl")  # by Q_RTL_MODE
    availability = flight.core.vehicles["hawk"].availability
    assert not availability.taken_over
    flight.mode("qland")
    assert availability.taken_over


@pytest.mark.parametrize(
    ("kind", "stack", "values", "reported"),
    [
        ("plane", "ardupilot plane", {"Q_ENABLE": 1.0}, "vtol"),
        ("vtol", "ardupilot plane", {"Q_ENABLE": 0.0}, "plane"),
        ("vtol", "ardupilot plane", {"Q_ENABLE": 1.0}, ""),
        ("plane", "px4 vtol", {}, "vtol"),
        ("plane", "px4 plane", {}, ""),
        ("copter", "ardupilot plane", {"Q_ENABLE": 0.0}, "plane"),
    ],
)
def test_a_vehicle_of_another_kind_does_not_start(
    kind: str, stack: str, values: dict[str, float], reported: str
) -> None:
    overrides = (f'vehicles.0.kind="{kind}"', f'vehicles.0.stack="{stack.split()[0]}"')
    land = landscape_of(load_scenario("default"))
    ground = Ground(land, WAITS, *overrides)
    ground.stands()
    ground.handle(ParametersReported(ground.at_us, "hawk", stack, 255, values))
    checks = [each for each in ground.sent if isinstance(each, ReportChecks)][-1].checks
    (found,) = (each for each in checks if each.name == "kind")
    if not reported:
        assert (found.state, found.text) == ("pass", kind)
        return
    assert found.state == "fail"
    assert found.text.startswith(f'it is a {reported}: set kind = "{reported}"')
    refused = ground.order("takeoff", "because")
    assert "cannot be overridden" in "".join(getattr(each, "text", "") for each in refused)


def test_a_vehicle_of_another_stack_does_not_start() -> None:
    ground = Ground(landscape_of(load_scenario("default")), WAITS)
    ground.handle(VehicleConnected(ground.at_us, "hawk", "ardupilot plane", False))
    ground.stands()
    checks = [each for each in ground.sent if isinstance(each, ReportChecks)][-1].checks
    (found,) = (each for each in checks if each.name == "kind")
    assert found.state == "fail"
    assert 'set stack = "ardupilot" in the scenario, which has "px4"' in found.text
    refused = ground.order("takeoff", "because")
    assert "cannot be overridden" in "".join(getattr(each, "text", "") for each in refused)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"backend": "mavsdk", "link": "udpin:127.0.0.1:1"}, 'requires backend = "native"'),
        ({"stack": "ardupilot", "lost_link": "hold"}, "has no reaction"),
    ],
)
def test_what_a_vtol_cannot_do_is_refused(more: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        section(**{"kind": "vtol", **more})
