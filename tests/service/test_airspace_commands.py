"""Commands beside closed airspace: a volume that closes during an upload, low and raised holds."""

import math
from typing import TypeVar

import pytest

from autopilot_bridge.items import has_position, waypoint
from benchmarks.worlds.ground import CENTRE, Terrain, lat_lon_of, plane_m
from benchmarks.worlds.light_flight import LightCore
from benchmarks.worlds.random_world import landscape_of
from mission_service.commands import (
    AnyCommand,
    HoldAt,
    RaiseAlarm,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    AirspaceClosed,
    ModeChanged,
    OrderGiven,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
)
from tests.service.people_flights import ANN

GROUND_M, MARGIN_M, RADIUS_M = 300.0, 60.0, 90.0
LEVEL = Terrain(GROUND_M)
Kind = TypeVar("Kind")
FAR = (770.0, 730.0)  # of the demo's home


class Flight:
    """A core with one vehicle in the air at a place (metres east and north of ``CENTRE``)."""

    def __init__(
        self,
        place_m: tuple[float, float],
        height_m: float,
        *settings: str,
        terrain: Terrain = LEVEL,
    ) -> None:
        scenario = load_scenario("demo", settings)
        scenario = scenario.model_copy(update={"vehicles": scenario.vehicles[:1]})
        self.core = LightCore(scenario, landscape_of(terrain))
        self.now_s = scenario.deploy_at_s
        self.place_m, self.height_m = place_m, height_m
        self.core.handle(VehicleConnected(self.us, "hawk", "px4", True))
        self.core.handle(ModeChanged(self.us, "hawk", 0, True, "mission"))
        self.report(100.0)
        self.report(height_m)

    @property
    def us(self) -> int:
        return round(self.now_s * 1e6)

    def report(self, height_m: float, above_home_m: float | None = None) -> list[AnyCommand]:
        self.now_s += 1.0
        ground_m = float(LEVEL.ground_m(*self.place_m))
        place = lat_lon_of(*self.place_m)
        relative_m = height_m if above_home_m is None else above_home_m
        return self.core.handle(
            Telemetry(self.us, "hawk", *place, ground_m + height_m, relative_m, 0.0, 0.0, 0.0)
        )

    def close(
        self,
        name: str,
        at_m: tuple[float, float],
        half_m: float,
        floor_amsl_m: float | None = None,
    ) -> None:
        corners = tuple(
            lat_lon_of(at_m[0] + east * half_m, at_m[1] + north * half_m)
            for east, north in ((1, 1), (1, -1), (-1, -1), (-1, 1))
        )
        self.core.handle(AirspaceClosed(self.us, *ANN, name, corners, floor_amsl_m))

    def order(self, order: str) -> list[AnyCommand]:
        return self.core.handle(OrderGiven(self.us, *ANN, "hawk", order))  # type: ignore[arg-type]


def of_kind(kind: type[Kind], commands: list[AnyCommand]) -> list[Kind]:
    return [each for each in commands if isinstance(each, kind)]


def test_a_way_home_across_which_a_volume_has_closed_meanwhile_is_not_started() -> None:
    flight = Flight((-770.0, -730.0), 150.0)
    flight.close("between", (0.0, 0.0), 150.0)
    (around,) = of_kind(UploadMission, flight.order("return"))
    assert around.why == "fly home clear of closed airspace and terrain"
    items = around.items[: [item.command for item in around.items].index(189)]  # before its landing
    _, corner = (item for item in items if item.command == 16)
    corner_m = plane_m(corner.x / 1e7, corner.y / 1e7)
    flight.close("over the corner", corner_m, 100.0)
    flight.core.handle(ModeChanged(flight.us, "hawk", 0, True, "hold"))  # for the upload
    accepted = UploadFinished(flight.us, "hawk", around.mission_id, "accepted", "")
    assert not of_kind(StartMission, flight.core.handle(accepted))
    (again,) = of_kind(UploadMission, flight.report(150.0))
    assert again.why == around.why


def test_a_way_home_that_is_still_free_is_started() -> None:
    flight = Flight((-770.0, -730.0), 150.0)
    flight.close("between", (0.0, 0.0), 150.0)
    (around,) = of_kind(UploadMission, flight.order("return"))
    flight.close("elsewhere", (0.0, 1900.0), 100.0)
    accepted = UploadFinished(flight.us, "hawk", around.mission_id, "accepted", "")
    assert of_kind(StartMission, flight.core.handle(accepted))


def test_a_return_is_checked_up_to_its_known_height() -> None:
    for settings, reroutes in (((), False), (("vehicles.0.return_height_m=250",), True)):
        flight = Flight((-770.0, -730.0), 150.0, *settings)
        flight.close("high", (0.0, 0.0), 150.0, floor_amsl_m=GROUND_M + 220.0)
        assert bool(of_kind(UploadMission, flight.order("return"))) == reroutes


def test_a_return_by_a_failsafe_is_checked_whatever_return_was_clear_before() -> None:
    flight = Flight((770.0, 0.0), 150.0)
    flight.close("between", (0.0, 0.0), 150.0)
    assert of_kind(Return, flight.order("return"))
    flight.core.handle(ModeChanged(flight.us, "hawk", 0, True, "return"))
    flight.core.handle(ModeChanged(flight.us, "hawk", 0, True, "mission"))
    flight.place_m = (-770.0, -730.0)
    flight.order("resume")
    flight.now_s += 100.0
    flight.report(150.0)
    commands = flight.core.handle(ModeChanged(flight.us, "hawk", 0, True, "return"))
    texts = [each.text for each in of_kind(RaiseAlarm, [*commands, *flight.report(150.0)])]
    assert any("would enter the closed volume 'between'" in text for text in texts)


def test_a_low_multirotor_leaves_below_a_volume_above() -> None:
    """It is 19 m above the ground, and the volume above it begins at 60 m."""
    flight = Flight((0.0, 0.0), 19.0, 'vehicles.0.kind="copter"')
    flight.close("above", (0.0, 0.0), 1500.0, floor_amsl_m=GROUND_M + 60.0)
    flight.close("here", (0.0, 0.0), 150.0)
    (leaves,) = of_kind(UploadMission, flight.report(19.0))
    assert leaves.why == "leave closed airspace"
    altitudes_m = {item.z for item in leaves.items if item.command in (16, 17)}
    assert altitudes_m == {GROUND_M + 30.0}
    first = next(item for item in leaves.items if item.command == 16)  # it climbs there first
    assert math.dist(plane_m(first.x / 1e7, first.y / 1e7), (0.0, 0.0)) < 1.0


def place_of(hold: HoldAt) -> tuple[float, float]:
    return plane_m(hold.lat_deg, hold.lon_deg)


def test_a_raised_hold_beside_a_volume_is_flown_at_a_free_place() -> None:
    flight = Flight((0.0, 0.0), 20.0)
    flight.close("beside", (250.0, 0.0), 150.0)  # 100 m ahead
    (hold,) = of_kind(HoldAt, flight.order("hold"))
    assert hold.altitude_amsl_m == pytest.approx(GROUND_M + 40.0, abs=0.2)
    assert place_of(hold)[0] + RADIUS_M <= 100.0 - MARGIN_M
    assert math.dist(place_of(hold), (0.0, 0.0)) < 200.0


def test_a_raised_hold_without_a_volume_is_flown_where_it_is() -> None:
    (hold,) = of_kind(HoldAt, Flight((0.0, 0.0), 20.0).order("hold"))
    assert math.dist(place_of(hold), (0.0, 0.0)) < 1.0


def test_a_raised_hold_is_not_raised_into_a_volume_beside_it() -> None:
    """The high ground is outside the circle, but within twice its reach."""
    hill = Terrain(GROUND_M, hills=((-250.0, 0.0, 120.0, 40.0),))
    flight = Flight((0.0, 0.0), 60.0, terrain=hill)
    flight.close("beside", (250.0, 0.0), 150.0, floor_amsl_m=GROUND_M + 100.0)
    (hold,) = of_kind(HoldAt, flight.order("hold"))
    assert math.dist(place_of(hold), (0.0, 0.0)) < 1.0
    assert hold.altitude_amsl_m <= GROUND_M + 100.0 - 15.0


def test_a_raised_hold_stays_below_a_volume_that_begins_lower_than_the_ground_beside_it() -> None:
    """At 40 m above the ground under its circle, the hold would be in the vertical margin."""
    hill = Terrain(GROUND_M, hills=((-250.0, 0.0, 120.0, 40.0),))
    flight = Flight((0.0, 0.0), 20.0, terrain=hill)
    flight.close("above", (0.0, 0.0), 1500.0, floor_amsl_m=GROUND_M + 50.0)
    (hold,) = of_kind(HoldAt, flight.order("hold"))
    assert math.dist(place_of(hold), (0.0, 0.0)) < 1.0
    assert GROUND_M + 30.0 <= hold.altitude_amsl_m < GROUND_M + 50.0


def test_a_raised_hold_that_is_nowhere_free_is_flown_with_a_severe_alarm() -> None:
    """Below the volume, the hold would be 22 m above the ground."""
    flight = Flight((0.0, 0.0), 20.0)
    flight.close("above", (0.0, 0.0), 6000.0, floor_amsl_m=GROUND_M + 22.0)
    commands = flight.order("hold")
    (hold,) = of_kind(HoldAt, commands)
    assert hold.altitude_amsl_m == pytest.approx(GROUND_M + 40.0, abs=0.2)
    (alarm,) = [each for each in of_kind(RaiseAlarm, commands) if each.severity == "severe"]
    assert "above" in alarm.text
    assert "too near the ground" in alarm.text


@pytest.mark.parametrize(
    ("height_m", "mode", "is_free"),
    [(30.0, "return", True), (5.0, "return", False), (5.0, "mission", True)],
)
def test_a_mission_for_a_vehicle_that_lands_is_checked_as_a_takeoff(
    height_m: float, mode: str, is_free: bool
) -> None:
    """Home is in the margin of a volume: only a vehicle in the air may leave the margin."""
    flight = Flight(FAR, 40.0, 'vehicles.0.kind="copter"')
    flight.core.handle(ModeChanged(flight.us, "hawk", 0, True, mode))
    flight.close("beside", (FAR[0] + 190.0, FAR[1]), 150.0)
    flight.report(height_m)
    away = tuple(waypoint(*lat_lon_of(FAR[0] + east_m, FAR[1]), 450.0) for east_m in (0.0, -400.0))
    obstacle = flight.core.airspace.mission_obstacle(flight.core.vehicles["hawk"], away)
    assert (obstacle == "") is is_free, obstacle


def test_the_home_of_these_flights_is_that_of_the_demo() -> None:
    scenario = load_scenario("demo")
    home = scenario.vehicles[0]
    assert math.dist(plane_m(home.home_lat_deg, home.home_lon_deg), FAR) < 10.0
    assert math.dist(plane_m(*CENTRE), (0.0, 0.0)) < 1.0
    assert scenario.airspace.margin_m == MARGIN_M


def loiter_of(leaves: UploadMission) -> tuple[float, float]:
    """Return the place of the loiter, which must be the only position of a mission."""
    (place,) = [item for item in leaves.items if has_position(item.command)][:1]
    assert place.command == 17
    return plane_m(place.x / 1e7, place.y / 1e7)


def test_a_plane_leaves_over_lower_ground() -> None:
    """The shortest way out leads to the east, where a steep hill is."""
    hill = Terrain(GROUND_M, hills=((350.0, 0.0, 200.0, 150.0),))
    flight = Flight((0.0, 0.0), 60.0, terrain=hill)
    flight.close("here", (-60.0, 0.0), 150.0)
    (leaves,) = of_kind(UploadMission, flight.report(60.0))
    assert leaves.why == "leave closed airspace"
    assert float(hill.ground_m(285.0, 0.0)) > GROUND_M + 180.0
    assert float(hill.ground_m(*loiter_of(leaves))) < GROUND_M + 110.0


def test_a_plane_leaves_without_a_climb_in_a_loiter() -> None:
    """It is between hills on all sides."""
    hills = tuple(
        (350.0 * math.sin(turn), 350.0 * math.cos(turn), 200.0, 100.0) for turn in range(7)
    )
    flight = Flight((0.0, 0.0), 60.0, terrain=Terrain(GROUND_M, hills=hills))
    flight.close("here", (0.0, 0.0), 100.0)
    (leaves,) = of_kind(UploadMission, flight.report(60.0))
    assert leaves.why == "leave closed airspace"
    assert math.hypot(*loiter_of(leaves)) > 150.0


@pytest.mark.parametrize(("armed", "leaves"), [(True, True), (False, False)])
def test_a_vehicle_restarted_below_the_altitude_of_its_home_leaves_too(
    armed: bool, leaves: bool
) -> None:
    """Its height above home does not show that it flies: its home is on a hill."""
    flight = Flight((0.0, 0.0), 100.0)
    flight.core.handle(VehicleRebooted(flight.us, "hawk"))
    flight.core.handle(ModeChanged(flight.us, "hawk", 0, armed, "hold"))
    flight.report(100.0, above_home_m=-20.0)
    flight.core.handle(OrderGiven(flight.us, *ANN, "hawk", "hold", True))
    flight.close("here", (0.0, 0.0), 150.0)
    sent = of_kind(UploadMission, flight.report(100.0, above_home_m=-20.0))
    assert ("leave closed airspace" in [each.why for each in sent]) is leaves


def least_height_m(flight: Flight, terrain: Terrain, mission: UploadMission) -> float:
    """Return the least height on the way of a multirotor that does not slow down to climb."""
    section = flight.core.scenario.vehicles[0]
    ground_m = float(terrain.ground_m(*flight.place_m))
    altitude_m, here_m = GROUND_M + flight.height_m, flight.place_m
    found = [altitude_m - ground_m]
    for item in mission.items:
        if not has_position(item.command) or item.frame not in (0, 5):
            continue
        place_m = plane_m(item.x / 1e7, item.y / 1e7)
        length_m = math.dist(here_m, place_m)
        if length_m < 1.0:  # it climbs at its place
            altitude_m = item.z
            continue
        for number in range(101):
            share = number / 100.0
            climbed_m = section.climb_m_s / section.airspeed_m_s * length_m * share
            up_m = min(altitude_m + share * (item.z - altitude_m), altitude_m + climbed_m)
            east_m, north_m = (
                one + share * (other - one) for one, other in zip(here_m, place_m, strict=True)
            )
            found.append(up_m - float(terrain.ground_m(east_m, north_m)))
        altitude_m, here_m = up_m, place_m
    return min(found)


def test_a_low_multirotor_between_hills_climbs_no_higher_than_necessary() -> None:
    """It flies faster than it climbs: on a straight line to the loiter it would hit the ground."""
    hills = tuple(
        (350.0 * math.sin(turn), 350.0 * math.cos(turn), 200.0, 100.0) for turn in range(7)
    )
    terrain = Terrain(GROUND_M, hills=hills)
    flight = Flight((0.0, 0.0), 19.0, 'vehicles.0.kind="copter"', terrain=terrain)
    flight.close("here", (0.0, 0.0), 100.0)
    (leaves,) = of_kind(UploadMission, flight.report(19.0))
    first, last = (item for item in leaves.items if item.command in (16, 17))
    assert math.dist(plane_m(first.x / 1e7, first.y / 1e7), (0.0, 0.0)) < 1.0
    assert GROUND_M + 30.0 <= first.z < last.z - 20.0
    assert least_height_m(flight, terrain, leaves) >= 15.0  # as low as it is now


def test_a_low_multirotor_prefers_a_way_out_without_a_climb() -> None:
    hill = Terrain(GROUND_M, hills=((350.0, 0.0, 200.0, 60.0),))
    flight = Flight((0.0, 0.0), 19.0, 'vehicles.0.kind="copter"', terrain=hill)
    flight.close("here", (-60.0, 0.0), 150.0)  # the hill is on the shortest way out
    (leaves,) = of_kind(UploadMission, flight.report(19.0))
    assert math.hypot(*loiter_of(leaves)) > 100.0
    assert least_height_m(flight, hill, leaves) >= 18.0


def test_a_climb_before_the_way_home_clears_all_its_legs() -> None:
    """The first corner is near, and would be dropped from a mission that begins with a climb."""
    terrain = Terrain(GROUND_M, hills=((115.4, 77.7, 218.2, 176.2), (445.7, 220.9, 140.4, 179.1)))
    place_m = (-62.3, 254.4)
    height_m = float(terrain.ground_m(*place_m)) - GROUND_M + 24.2
    flight = Flight(place_m, height_m, 'vehicles.0.kind="copter"', terrain=terrain)
    flight.report(height_m)
    flight.close("here", (10.0, 335.4), 89.7)
    flight.close("on the way", (553.3, 507.8), 54.5)
    commands = flight.order("return") + flight.report(height_m)
    home = of_kind(UploadMission, commands)[-1]
    assert home.why == "fly home clear of closed airspace and terrain"
    assert least_height_m(flight, terrain, home) >= 20.0
