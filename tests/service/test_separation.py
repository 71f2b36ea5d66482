"""Separation of vehicles: layers above other missions, giving way, takeoffs."""

import math
from typing import Literal

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    AnyCommand,
    ProposeMission,
    StartMission,
    UploadMission,
    WithdrawMission,
)
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    AnyEvent,
    ModeChanged,
    Observed,
    OrderGiven,
    Telemetry,
    UploadFinished,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.missions.from_path import mission_along
from mission_service.missions.landing_mission import landing_mission
from mission_service.missions.separation import (
    AROUND,
    avoidance_position,
    descent_of,
    gives_way,
    has_passed,
    heights_below,
    is_near,
    straight_on,
    track_of,
)
from mission_service.position_fix import PositionFix
from mission_service.vehicles.availability import AIRBORNE_M, VehicleAvailability
from mission_service.vehicles.traffic import TrafficManager

SEPARATION_M = 30.0
TURN_M = 60.0


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("team"))


def fix(
    x_m: float, y_m: float, east_m_s: float, north_m_s: float, altitude_m: float = 500.0
) -> PositionFix:
    return PositionFix(0.0, 0.0, 0.0, x_m, y_m, altitude_m, east_m_s, north_m_s)


def near(own: PositionFix, other: PositionFix) -> bool:
    return is_near(own, other, SEPARATION_M, TURN_M)


def test_two_that_fly_at_each_other_are_near_in_time_and_one_of_them_gives_way() -> None:
    own, other = fix(0, 0, 15, 0), fix(700, 20, -15, 0)
    assert near(own, other)
    assert near(other, own)
    assert not near(own, fix(900, 20, -15, 0))
    assert not near(own, fix(700, 400, -15, 0))
    assert not near(own, fix(700, 20, -15, 0, altitude_m=531.0))
    assert gives_way(own, other, own_comes_later=True)
    assert not gives_way(other, own, own_comes_later=False)


def test_the_one_behind_gives_way_whoever_comes_first() -> None:
    slow, fast = fix(180, 0, 10, 0), fix(0, 0, 18, 0)
    assert near(fast, slow)
    for later in (True, False):
        assert gives_way(fast, slow, own_comes_later=later)
        assert not gives_way(slow, fast, own_comes_later=not later)


def test_of_any_two_exactly_one_gives_way() -> None:
    rng = np.random.default_rng(5)
    for _ in range(500):
        a, b = (fix(*rng.uniform(-400, 400, 2), *rng.uniform(-20, 20, 2)) for _ in range(2))
        assert near(a, b) == near(b, a)
        assert gives_way(a, b, own_comes_later=True) != gives_way(b, a, own_comes_later=False)


def test_it_waits_off_the_line_away_from_the_fire_until_the_other_has_passed() -> None:
    own = fix(0, 0, 0, 15)
    (place,) = avoidance_position(own, straight_on(fix(0, 600, 0, -15)), (-1000.0, 0.0), 400.0)
    assert place[0] == pytest.approx(400.0)
    assert place[1] > 0.0
    (inwards,) = avoidance_position(own, straight_on(fix(300, 100, 0, 15)), (-1000.0, 0.0), 400.0)
    assert inwards[0] == pytest.approx(-400.0)
    assert not has_passed(own, fix(0, 600, 0, -15), SEPARATION_M, TURN_M)
    assert not has_passed(own, fix(0, -200, 0, -15), SEPARATION_M, TURN_M)
    assert has_passed(own, fix(0, -310, 0, -15), SEPARATION_M, TURN_M)


def test_a_scenario_gives_each_vehicle_a_layer_unless_it_sets_an_altitude() -> None:
    team = load_scenario("team", ("mission.layer_m=50", "vehicles.2.altitude_agl_m=120"))
    assert [vehicle.altitude_agl_m for vehicle in team.vehicles] == [150, 200, 120, 300]


def test_a_higher_mission_is_laid_over_a_lower_one_where_they_cross(land: Landscape) -> None:
    """Legs end at different places, so that a hill may lift the lower layer above the higher."""
    scenario = load_scenario("team")
    low, high = scenario.vehicles[:2]
    rng = np.random.default_rng(2)
    gained = 0
    for _ in range(20):
        centre = np.array([land.west_m + 3000.0, land.north_m - 3000.0])
        paths = [centre + rng.uniform(-1500, 1500, (6, 2)) for _ in range(2)]
        below = track_of(mission_along(paths[0], True, low, land, False), land, 90.0)

        def least(points: np.ndarray) -> np.ndarray:
            return heights_below(points, [below]) + SEPARATION_M  # noqa: B023

        alone = track_of(mission_along(paths[1], True, high, land, False), land, 90.0)
        items = mission_along(paths[1], True, high, land, False, min_at=least)
        above = track_of(items, land, 90.0)
        gap = above.lowest_m - heights_below(above.points_m, [below])
        assert gap.min() >= SEPARATION_M
        gained += (alone.lowest_m - heights_below(alone.points_m, [below])).min() < SEPARATION_M
    assert gained > 0  # otherwise the test checks nothing


def test_others_keep_clear_of_a_descent_before_the_plane_is_at_their_altitude(
    land: Landscape,
) -> None:
    scenario = load_scenario("team")
    own, lands = scenario.vehicles[:2]
    home_m = np.array(land.xy_of_lat_lon(lands.home_lat_deg, lands.home_lon_deg))
    mission = landing_mission(lands, land, (4.0, 0.0), tuple(home_m))
    descent_m = descent_of(mission.items, land, lands.loiter_radius_m)
    assert np.hypot(*(descent_m - home_m).T).min() < 200.0
    centre = descent_m[:AROUND].mean(axis=0)
    states = {each.name: VehicleAvailability() for each in scenario.vehicles}
    traffic = TrafficManager(scenario, land, states)
    for name in (own.name, lands.name):
        states[name].online = states[name].airborne = True
    ahead_m = 400.0 + lands.loiter_radius_m
    states[own.name].fix = fix(centre[0] - ahead_m, centre[1], 18.0, 0.0, altitude_m=500.0)
    states[lands.name].fix = fix(centre[0], centre[1], 0.0, 18.0, altitude_m=600.0)
    assert traffic.give_way_to(own.name) is None  # 100 m apart
    traffic.on_landing(lands.name, mission.items)
    assert traffic.give_way_to(own.name) is None  # it does not land yet
    states[lands.name].landing = "approach"
    assert traffic.give_way_to(own.name) == lands.name
    place = traffic.waits_at(own.name)[0]
    assert np.hypot(*(descent_m - place).T).min() > 2.0 * SEPARATION_M
    assert traffic.give_way_to(own.name) == lands.name  # until it has landed
    states[own.name].fix = fix(centre[0] - ahead_m, centre[1], 18.0, 0.0, altitude_m=640.0)
    assert traffic.give_way_to(own.name) is None  # above it
    states[own.name].fix = fix(centre[0] - 2.0 * ahead_m, centre[1], -18.0, 0.0)
    assert traffic.give_way_to(own.name) is None  # flies away from it


def test_no_vehicle_takes_off_into_the_approach_of_another(land: Landscape) -> None:
    scenario = load_scenario("team")
    states = {each.name: VehicleAvailability() for each in scenario.vehicles}
    traffic = TrafficManager(scenario, land, states)
    lands, starts = scenario.vehicles[0].name, scenario.vehicles[1].name
    states[lands].airborne = True
    states[lands].fix = fix(0.0, 0.0, 18.0, 0.0)  # far from home
    states[lands].landing = "approach"
    assert traffic.takeoff_obstacle(starts, 0.0) == f"{lands} is landing"
    assert traffic.takeoff_obstacle(starts, 899.0)
    assert not traffic.takeoff_obstacle(starts, 901.0)  # its link was lost on the approach
    states[lands].landing = "none"
    assert not traffic.takeoff_obstacle(starts, 0.0)


class Flight:
    """A core with a team, with events of each vehicle from the test."""

    def __init__(self, scenario: Scenario, land: Landscape) -> None:
        self.core, self.land, self.scenario = Core(scenario, land), land, scenario
        self.at_s = scenario.deploy_at_s
        self.fails: list[str] = []  # reasons of uploads that fail once
        for vehicle in scenario.vehicles:
            self.core.handle(VehicleConnected(self.at_us, vehicle.name, "a stack", True))

    @property
    def at_us(self) -> int:
        return round(self.at_s * 1e6)

    def at(
        self, name: str, x_m: float, y_m: float, velocity: tuple[float, float], height_m: float
    ) -> list[AnyCommand]:
        lat, lon = (float(value) for value in self.land.lat_lon_of(x_m, y_m))
        self.core.vehicles[name].availability.armed |= height_m >= AIRBORNE_M
        report = Telemetry(
            self.at_us, name, lat, lon, 400 + height_m, height_m, velocity[1], velocity[0], 0.0
        )
        commands = self.core.handle(report)
        for command in commands:
            if isinstance(command, UploadMission):
                fails = command.why in self.fails
                outcome: Literal["failed", "accepted"] = "failed" if fails else "accepted"
                done = UploadFinished(self.at_us, name, command.mission_id, outcome, "")
                commands = [*commands, *self.core.handle(done)]
                self.fails = [why for why in self.fails if why != command.why]
        return commands

    def at_home(self, name: str, height_m: float = 0.0, east_m: float = 0.0) -> list[AnyCommand]:
        section = next(each for each in self.scenario.vehicles if each.name == name)
        x_m, y_m = self.land.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
        return self.at(name, x_m + east_m, y_m, (0.0, 0.0), height_m)


def starts(commands: list[AnyCommand]) -> bool:
    return any(isinstance(command, StartMission) for command in commands)


def test_vehicles_of_one_home_take_off_one_after_another(land: Landscape) -> None:
    flight = Flight(load_scenario("team"), land)
    assert starts(flight.at_home("hawk"))
    assert not starts(flight.at_home("kite"))
    assert starts(flight.at_home("swift"))  # its home is 370 m away from the other homes
    flight.at_s += 20.0
    flight.at_home("hawk", height_m=100.0)
    flight.at_s += 3.0
    assert not starts(flight.at_home("kite"))
    flight.at_home("hawk", height_m=150.0, east_m=-600.0)
    flight.at_s += 3.0
    assert starts(flight.at_home("kite"))


def reasons(commands: list[AnyCommand]) -> list[str]:
    return [command.why for command in commands if isinstance(command, UploadMission)]


@pytest.mark.parametrize(("altitudes", "yields"), [((150, 150), True), ((150, 190), False)])
def test_head_on_in_one_layer_the_later_in_order_steps_aside_and_goes_on_after(
    land: Landscape, altitudes: tuple[int, int], yields: bool
) -> None:
    layers = tuple(f"vehicles.{n}.altitude_agl_m={height}" for n, height in enumerate(altitudes))
    flight = Flight(load_scenario("team", layers), land)
    x_m, y_m = land.west_m + 2000.0, land.north_m - 1000.0
    given: dict[str, list[str]] = {"hawk": [], "kite": []}
    for second in range(60):
        flight.at_s += 1.0
        for name, side, height_m in zip(("hawk", "kite"), (-1.0, 1.0), altitudes, strict=True):
            along_m = side * (450.0 - 15.0 * second)
            given[name] += reasons(flight.at(name, x_m + along_m, y_m, (-15.0 * side, 0), height_m))
    assert not any("give way" in why for why in given["hawk"])
    if yields:
        assert given["kite"].index("give way to hawk") < len(given["kite"]) - 1
        assert math.isclose(given["kite"].count("give way to hawk"), 1)
    else:
        assert not any("give way" in why for why in given["kite"])


def test_giving_way_waits_for_no_approval(land: Landscape) -> None:
    """A separation mission is sent at once, even while a proposal waits for its approval."""
    settings = (
        'mission.approval="each"',
        "vehicles.0.altitude_agl_m=150",
        "vehicles.1.altitude_agl_m=150",
    )
    flight = Flight(load_scenario("team", settings), land)
    x_m, y_m = land.west_m + 2000.0, land.north_m - 1000.0
    sent: list[AnyCommand] = []
    for second in range(60):
        flight.at_s += 1.0
        for name, side in (("hawk", -1.0), ("kite", 1.0)):
            along_m = side * (450.0 - 15.0 * second)
            sent += flight.at(name, x_m + along_m, y_m, (-15.0 * side, 0), 150)
    (way,) = [command for command in sent if isinstance(command, UploadMission)]
    assert (way.vehicle, way.why, way.keeps_apart) == ("kite", "give way to hawk", True)
    before = sent[: sent.index(way)]
    proposed = [each.mission_id for each in before if isinstance(each, ProposeMission)]
    withdrawn = [each.mission_id for each in before if isinstance(each, WithdrawMission)]
    assert withdrawn
    assert set(withdrawn) <= set(proposed)


class HeadOn(Flight):
    """Two vehicles in one layer that fly at each other; ``sent`` maps a vehicle to its missions."""

    def __init__(self, land: Landscape, *settings: str) -> None:
        layers = ("vehicles.0.altitude_agl_m=150", "vehicles.1.altitude_agl_m=150")
        super().__init__(load_scenario("team", (*layers, *settings)), land)
        self.sent: dict[str, list[tuple[float, str]]] = {"hawk": [], "kite": [], "swift": []}

    def moves(self, name: str, east_m: float, east_m_s: float) -> None:
        """Report a vehicle's position east of the place of the encounter."""
        x_m, y_m = self.land.west_m + 2000.0, self.land.north_m - 1000.0
        commands = self.at(name, x_m + east_m, y_m, (east_m_s, 0.0), 150.0)
        self.sent[name] += [(self.at_s, why) for why in reasons(commands)]

    def flies(self, seconds: int, *names: str) -> None:
        """Fly the named vehicles at each other for a time, from 900 m apart."""
        for second in range(seconds):
            self.at_s += 1.0
            for name, side in (("hawk", -1.0), ("kite", 1.0)):
                if name in names:
                    self.moves(name, side * (450.0 - 15.0 * second), -15.0 * side)

    def gave_way(self, name: str, other: str) -> list[float]:
        """Return the times at which a vehicle gave way to another one."""
        return [at_s for at_s, why in self.sent[name] if why == f"give way to {other}"]


def test_giving_way_is_repeated_after_a_failed_upload(land: Landscape) -> None:
    flight = HeadOn(land)
    flight.fails = ["give way to hawk"]
    flight.flies(30, "hawk", "kite")
    first_s, again_s = flight.gave_way("kite", "hawk")
    assert again_s - first_s <= 6.0
    assert not flight.gave_way("hawk", "kite")


def test_another_vehicle_gives_way_after_two_failed_uploads_in_a_row(land: Landscape) -> None:
    flight = HeadOn(land)
    for second in range(30):
        flight.fails = ["give way to hawk"]
        flight.at_s += 1.0
        flight.moves("kite", 450.0 - 15.0 * second, -15.0)
        flight.moves("hawk", -450.0 + 15.0 * second, 15.0)
    first_s, again_s = flight.gave_way("kite", "hawk")
    (other_s,) = flight.gave_way("hawk", "kite")
    assert first_s < again_s <= other_s <= again_s + 1.0


def test_a_failed_upload_to_give_way_is_not_repeated_sooner_after_an_observation(
    land: Landscape,
) -> None:
    flight = HeadOn(land)
    for second in range(20):
        flight.at_s += 1.0
        flight.fails = ["give way to hawk"]
        flight.core.handle(Observed(flight.at_us, "kite", 0, 0, ("u",), source="a sensor"))
        for name, side in (("hawk", -1.0), ("kite", 1.0)):
            flight.moves(name, side * (450.0 - 15.0 * second), -15.0 * side)
    attempts_s = flight.gave_way("kite", "hawk")
    assert len(attempts_s) == 2  # then another vehicle gives way
    assert min(np.diff(attempts_s)) >= 5.0


def withhold(flight: HeadOn, monkeypatch: pytest.MonkeyPatch, why: str) -> None:
    """Withhold kite's missions with this reason, as the airspace guard does."""
    checked = flight.core.airspace.checked

    def withheld(commands: list[AnyCommand], at_s: float, accepted: bool) -> list[AnyCommand]:
        if why in reasons(commands):
            flight.core.vehicles["kite"].drop_upload()
            flight.core.vehicles["kite"].not_before_s = at_s + 10.0
            return []
        return checked(commands, at_s, accepted)

    monkeypatch.setattr(flight.core.airspace, "checked", withheld)


def test_the_other_vehicle_gives_way_if_closed_airspace_prevents_the_first(
    land: Landscape, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = HeadOn(land)
    withhold(flight, monkeypatch, "give way to hawk")
    flight.flies(30, "hawk", "kite")
    assert not flight.gave_way("kite", "hawk")
    assert len(flight.gave_way("hawk", "kite")) == 1


def test_a_vehicle_leaves_its_waiting_place_if_closed_airspace_prevents_another_one(
    land: Landscape, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kite has given way to hawk, and then cannot give way to swift, which a pilot flies."""
    flight = HeadOn(land, "vehicles.2.altitude_agl_m=150")
    withhold(flight, monkeypatch, "give way to swift")
    flight.flies(8, "hawk", "kite")
    assert flight.gave_way("kite", "hawk")
    flight.moves("swift", -900.0, 15.0)
    flight.core.handle(ModeChanged(flight.at_us, "swift", 0, True, "manual"))
    for second in range(90):
        flight.at_s += 1.0
        flight.moves("hawk", -330.0 + 15.0 * second, 15.0)
        flight.moves("kite", 330.0, -0.1)
        flight.moves("swift", -660.0 + 15.0 * second, 15.0)
    assert not flight.gave_way("kite", "swift")
    assert [why for _, why in flight.sent["kite"]].count("the path is clear") == 1


def test_a_vehicle_leaves_its_waiting_place_when_the_airspace_beyond_it_opens(
    land: Landscape, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = HeadOn(land)
    flight.flies(8, "hawk", "kite")
    assert flight.gave_way("kite", "hawk")
    withhold(flight, monkeypatch, "the path is clear")
    for second in range(120):
        flight.at_s += 1.0
        flight.moves("hawk", -330.0 + 15.0 * second, 15.0)
        flight.moves("kite", 330.0, -0.1)
    assert [why for _, why in flight.sent["kite"]] == ["fly to the fire", "give way to hawk"]
    monkeypatch.undo()
    for _ in range(30):
        flight.at_s += 1.0
        flight.moves("kite", 330.0, -0.1)
    assert [why for _, why in flight.sent["kite"]].count("the path is clear") == 1


def stopped(flight: HeadOn, how: str) -> AnyEvent:
    """Return the event after which kite no longer flies its missions."""
    if how == "pilot":
        return ModeChanged(flight.at_us, "kite", 0, True, "manual")
    return OrderGiven(flight.at_us, "op", "", "kite", how)  # type: ignore[arg-type]


@pytest.mark.parametrize("how", ["hold", "return", "pilot"])
@pytest.mark.parametrize("waits_s", [0, 600])
def test_a_vehicle_that_has_given_way_and_is_stopped_is_avoided(
    land: Landscape, how: str, waits_s: int
) -> None:
    flight = HeadOn(land)
    flight.flies(8, "hawk", "kite")
    assert flight.gave_way("kite", "hawk")
    flight.core.handle(stopped(flight, how))
    for _ in range(waits_s):
        flight.at_s += 1.0
        flight.moves("kite", 330.0, -0.1)
    for second in range(20):
        flight.at_s += 1.0
        flight.moves("kite", 330.0, -0.1)
        flight.moves("hawk", -330.0 + 15.0 * second, 15.0)
    assert flight.gave_way("hawk", "kite")


def test_a_third_vehicle_avoids_a_held_vehicle_at_its_position(land: Landscape) -> None:
    """The position of the held vehicle is used, not the waiting position that it flew to."""
    flight = HeadOn(land, "vehicles.2.altitude_agl_m=150")
    flight.flies(8, "hawk", "kite")
    flight.core.handle(stopped(flight, "hold"))
    for second in range(20):
        flight.at_s += 1.0
        flight.moves("kite", 330.0, -0.1)
        flight.moves("swift", 900.0 - 15.0 * second, -15.0)
    assert flight.gave_way("swift", "kite")


def test_a_rejected_mission_does_not_replace_the_track_on_board(land: Landscape) -> None:
    """The lower vehicle stays on its mission, which climbs over a hill on its way."""
    scenario = load_scenario("team")
    low, high = scenario.vehicles[:2]
    states = {each.name: VehicleAvailability() for each in scenario.vehicles}
    traffic = TrafficManager(scenario, land, states)
    centre = np.array([land.west_m + 3000.0, land.north_m - 3000.0])
    on_board = mission_along(centre + np.array([(0.0, 0.0), (800.0, 0.0)]), True, low, land, False)
    rejected = mission_along(centre - np.array([(0.0, 0.0), (800.0, 0.0)]), True, low, land, False)
    places = track_of(on_board, land, 90.0).points_m
    traffic.on_mission(low.name, 1, on_board)
    traffic.on_outcome(low.name, 0, 1)
    least_m = traffic.min_altitudes(high.name)(places)
    assert np.isfinite(least_m).all()
    traffic.on_mission(low.name, 2, rejected)
    traffic.on_outcome(low.name, 2, 1)
    assert (traffic.min_altitudes(high.name)(places) >= least_m).all()  # both while it is sent
    traffic.on_outcome(low.name, 0, 1)
    assert (traffic.min_altitudes(high.name)(places) == least_m).all()
    traffic.on_mission(low.name, 3, rejected)
    traffic.on_outcome(low.name, 0, 3)
    assert not np.isfinite(traffic.min_altitudes(high.name)(places)).all()


def test_a_mission_keeps_clear_of_the_track_on_board_after_a_rejected_upload(
    land: Landscape,
) -> None:
    flight = HeadOn(land, "vehicles.2.altitude_agl_m=200")
    flight.flies(5, "hawk", "kite")
    accepted, traffic = flight.core.vehicles["kite"].accepted, flight.core.traffic
    assert accepted is not None
    traffic.forget("hawk")  # it flies to the same fire
    places = np.array(accepted.line.segmentize(50.0).coords)[5:]
    least_m = traffic.min_altitudes("swift")(places)
    assert np.isfinite(least_m).all()
    flight.fails = ["give way to hawk"]
    flight.flies(8, "hawk", "kite")
    assert flight.gave_way("kite", "hawk")
    assert not flight.fails
    assert (traffic.min_altitudes("swift")(places) >= least_m).all()
