"""Flight in a formation, event by event, with a scripted agent."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autopilot_bridge.missions.plan_file import read_any
from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    ChangeSpeed,
    Orbit,
    RaiseAlarm,
    ReportChecks,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    AnyEvent,
    CommandFinished,
    LinkLost,
    LinkRestored,
    ModeChanged,
    Observed,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.formation import members as formation_seats
from mission_service.guidance.formation.agent import Intention, OwnState
from mission_service.guidance.formation.manual_control import ObservedMotion, expected_orbit
from mission_service.peer_messages import AnyMessage, FireUpdate, Leaving, State
from mission_service.position_fix import PositionFix
from mission_service.simulation.demo import write_plan

LOITER_UNLIM, TAKEOFF, LAND_START = 17, 22, 189


class Scripted:
    """An agent that is scripted by the test and records its messages."""

    def __init__(self, name: str, settings: Any, *rest: Any) -> None:
        self.name, self.settings = name, settings
        self.means = Intention(0.0, 0.0, -150.0, 17.5, 0.0, False, 0.0, 0.0)
        self.owns: list[OwnState] = []
        self.received: list[AnyMessage] = []
        self.seen: list[tuple[list[int], list[int]]] = []
        self.left: list[int] = []
        self.home_m: tuple[float, float] | None = None
        self.outgoing: list[AnyMessage] = []

    def on_message(self, message: AnyMessage) -> None:
        self.received.append(message)

    def add_view(self, burning: Any, unburned: Any, at_us: int) -> None:
        self.seen.append((burning.tolist(), unburned.tolist()))

    def step(self, own: OwnState) -> Intention:
        self.owns.append(own)
        return self.means

    def messages(self, at_us: int) -> list[AnyMessage]:
        sent, self.outgoing = self.outgoing, []
        return sent

    def leave(self, at_us: int, why: str) -> None:
        self.left.append(at_us)

    def go_home(self, x_m: float, y_m: float) -> None:
        self.home_m = (x_m, y_m)

    def come_back(self) -> None:
        self.home_m = None


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("virtual-agents"))


class Flight:
    """The scenario's first vehicle with the events of a test; places are metres from its home."""

    def __init__(self, land: Landscape, *overrides: str) -> None:
        overrides = ("fire.initial_cells=40", *overrides)
        scenario = load_scenario("virtual-agents", overrides)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(formation_seats, "Agent", Scripted)
            self.core = Core(scenario, land)
        self.land, self.section = land, scenario.vehicles[0]
        self.name = self.section.name
        self.home_m = land.xy_of_lat_lon(self.section.home_lat_deg, self.section.home_lon_deg)
        self.ground_m = float(land.elevation_at(*self.home_m))
        self.at_s = 0.0
        self.place_m = (-800.0, 0.0)
        self.handle(VehicleConnected(0, self.name, "a stack", True))

    @property
    def agent(self) -> Scripted:
        agent = self.core.guidance.formation.members[self.name].agent  # type: ignore[attr-defined]
        assert isinstance(agent, Scripted)
        return agent

    @property
    def at_us(self) -> int:
        return round(self.at_s * 1e6)

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        return self.core.handle(event)

    def at(self, height_m: float, later_s: float = 0.25) -> list[AnyCommand]:
        self.at_s += later_s
        x_m, y_m = (home + off for home, off in zip(self.home_m, self.place_m, strict=True))
        lat_deg, lon_deg = self.land.lat_lon_of(x_m, y_m)
        return self.handle(
            Telemetry(
                self.at_us,
                self.name,
                float(lat_deg),
                float(lon_deg),
                self.ground_m + height_m,
                height_m,
                0.0,
                17.5,
                90.0,
            )
        )

    def means(self, east_m: float, north_m: float, **others: Any) -> None:
        """Let the agent plan an orbit around a place in metres from home."""
        orbit = {"orbit_x_m": self.home_m[0] + east_m, "orbit_y_m": self.home_m[1] + north_m}
        self.agent.means = replace(self.agent.means, **orbit, **others)

    def mode(self, name: str, armed: bool = True) -> list[AnyCommand]:
        return self.handle(ModeChanged(self.at_us, self.name, 0, armed, name))

    def done(self, command: str, accepted: bool = True) -> list[AnyCommand]:
        return self.handle(CommandFinished(self.at_us, self.name, command, accepted, "no"))

    def uploaded(self, mission: UploadMission) -> list[AnyCommand]:
        return self.handle(
            UploadFinished(self.at_us, self.name, mission.mission_id, "accepted", "")
        )

    def orbiting(self) -> Orbit:
        """Return a flight that is in the air, on its first orbit at -800, 0."""
        self.place_m = (0.0, 0.0)
        (mission,) = of(self.at(0.0), UploadMission)
        self.uploaded(mission)
        self.mode("mission")
        self.place_m = (-800.0, 0.0)
        self.means(-800.0, 0.0)
        orbit: Orbit = of(self.at(300.0, later_s=60.0), Orbit)[0]
        self.carried_out(orbit)
        return orbit

    def for_s(self, seconds: float) -> list[tuple[float, AnyCommand]]:
        """Advance; every order is carried out at once. Returns pairs of time and order."""
        found: list[tuple[float, AnyCommand]] = []
        for _ in range(round(seconds / 0.25)):
            commands = self.at(300.0)
            while commands:
                found += [(self.at_s, command) for command in commands]
                commands = [answer for command in commands for answer in self.carried_out(command)]
        return found

    def carried_out(self, command: AnyCommand) -> list[AnyCommand]:
        match command:
            case Orbit():
                guided = self.section.stack == "ardupilot"
                return [*self.done("orbit"), *self.mode("guided" if guided else "hold")]
            case ChangeSpeed():
                return self.done("change speed")
            case StartMission():
                return [*self.done("start mission"), *self.mode("mission")]
            case UploadMission():
                return self.uploaded(command)
            case _:
                return []


def of(commands: list[AnyCommand], kind: type[Any]) -> list[Any]:
    return [command for command in commands if isinstance(command, kind)]


def times_s(found: list[tuple[float, AnyCommand]], kind: type[Any]) -> list[float]:
    return [at_s for at_s, command in found if isinstance(command, kind)]


def test_the_first_mission_takes_off_and_loiters_anticlockwise_clear_of_the_fire(
    land: Landscape,
) -> None:
    flight = Flight(land)
    flight.place_m = (0.0, 0.0)
    (mission,) = of(flight.at(0.0), UploadMission)
    up, loiter, *landing = mission.items
    assert (up.command, loiter.command, landing[0].command) == (TAKEOFF, LOITER_UNLIM, LAND_START)
    assert loiter.param3 == -150.0
    x_m, y_m = land.xy_of_lat_lon(loiter.x / 1e7, loiter.y / 1e7)
    formation = flight.core.guidance.formation  # type: ignore[attr-defined]
    off_m = np.hypot(x_m - formation.centre_m[0], y_m - formation.centre_m[1])
    assert off_m > formation.reach_m + 2 * 150.0
    assert loiter.z >= float(land.elevation_at(x_m, y_m)) + 300.0
    starts = flight.uploaded(mission)
    assert of(starts, StartMission)


def test_the_plan_of_a_vehicle_is_its_first_mission(land: Landscape, tmp_path: Path) -> None:
    plan = tmp_path / "heron.plan"
    written = write_plan("virtual-agents", "heron", plan, ("fire.initial_cells=40",))
    flight = Flight(land)
    flight.place_m = (0.0, 0.0)
    (mission,) = of(flight.at(0.0), UploadMission)
    loiter = read_any(plan).mission[1]
    assert written.items == len(mission.items) == 7
    assert (loiter.x, loiter.y, loiter.param3) == (mission.items[1].x, mission.items[1].y, -150.0)


def test_no_two_take_off_together(land: Landscape) -> None:
    flight = Flight(land)
    flight.place_m = (0.0, 0.0)
    (first,) = of(flight.at(0.0), UploadMission)
    assert of(flight.uploaded(first), StartMission)
    flight.name = "stork"
    flight.handle(VehicleConnected(flight.at_us, "stork", "a stack", True))
    (second,) = of(flight.at(0.0), UploadMission)
    assert not of(flight.uploaded(second), StartMission)
    assert not of(flight.at(0.0, later_s=30.0), StartMission)
    assert of(flight.at(0.0, later_s=40.0), StartMission)


def test_it_follows_its_agent_from_where_it_is_clear_of_home_and_ground(land: Landscape) -> None:
    flight = Flight(land)
    flight.place_m = (0.0, 0.0)
    (mission,) = of(flight.at(0.0), UploadMission)
    flight.uploaded(mission)
    flight.mode("mission")
    assert of(flight.at(300.0), Orbit) == []  # over its home
    flight.place_m = (-800.0, 0.0)
    assert of(flight.at(30.0), Orbit) == []  # between hills
    assert flight.agent.owns == []
    flight.means(-900.0, 50.0)
    (orbit,) = of(flight.at(300.0), Orbit)
    expected = land.lat_lon_of(flight.home_m[0] - 900.0, flight.home_m[1] + 50.0)
    assert (orbit.lat_deg, orbit.lon_deg) == pytest.approx(expected, abs=1e-6)
    assert orbit.radius_m == -150.0
    own = flight.agent.owns[-1]
    assert (own.x_m, own.y_m) == pytest.approx((flight.home_m[0] - 800.0, flight.home_m[1]))
    # East of true north is not exactly east on the grid.
    assert own.velocity_y_m_s == pytest.approx(17.5 * np.sin(np.radians(land.grid_convergence_deg)))


def test_an_orbit_clears_all_ground_within_it(land: Landscape) -> None:
    flight = Flight(land)
    orbit = flight.orbiting()
    x_m, y_m = land.xy_of_lat_lon(orbit.lat_deg, orbit.lon_deg)
    turns = np.linspace(0.0, 2 * np.pi, 100)
    for share in (0.0, 0.5, 1.0, 1.2):
        ring = (x_m + share * 150 * np.cos(turns), y_m + share * 150 * np.sin(turns))
        assert float(np.max(land.elevation_at(*ring))) + 300.0 <= orbit.altitude_amsl_m + 1.0
    flight.means(-800.0, 0.0, climb_m=40.0)
    (higher,) = (command for _, command in flight.for_s(4.0) if isinstance(command, Orbit))
    assert higher.altitude_amsl_m == pytest.approx(orbit.altitude_amsl_m + 40.0)


def test_orders_are_few_however_fast_the_agent_moves(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    found = []
    for step in range(240):  # for a minute at 25 m/s, alternately fast and slow
        flight.means(-800.0 - 6.25 * step, 0.0, airspeed_m_s=25.0 if step // 10 % 2 else 10.0)
        found += flight.for_s(0.25)
    orbits, speeds = times_s(found, Orbit), times_s(found, ChangeSpeed)
    assert min(np.diff(orbits)) >= 2.0
    assert min(np.diff(speeds)) >= 3.0
    assert 25 <= len(orbits) <= 30
    assert 10 <= len(speeds) <= 20
    assert len(times_s(found, UploadMission)) <= 2  # the mission on board is kept in the vicinity


def test_a_small_move_is_no_order_and_an_escape_is_one_at_once(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.for_s(5.0)
    flight.means(-815.0, 0.0)
    assert times_s(flight.for_s(10.0), Orbit) == []
    flight.means(-825.0, 0.0)
    assert len(times_s(flight.for_s(0.25), Orbit)) == 1
    flight.means(-740.0, 60.0, orbit_radius_m=90.0)
    (at_s,) = times_s(flight.for_s(1.0), Orbit)
    assert flight.at_s - at_s <= 0.5


def test_near_others_small_moves_are_ordered_too_and_at_once(land: Landscape) -> None:
    """The vehicle must fly exactly the orbits that agents have checked against each other."""
    for away_m, expected in ((400.0, 1), (600.0, 0)):
        flight = Flight(land)
        flight.orbiting()
        flight.for_s(5.0)
        other = flight.core.guidance.formation.members["stork"]  # type: ignore[attr-defined]
        x_m, y_m = flight.home_m[0] - 800.0, flight.home_m[1] + away_m
        other.fix, other.flies = (
            PositionFix(flight.at_s, 0.0, 0.0, x_m, y_m, 700.0, 0.0, 15.0),
            True,
        )
        flight.means(-810.0, 0.0, airspeed_m_s=20.0)
        found = flight.for_s(1.0)
        assert len(times_s(found, Orbit)) == expected
        flight.means(-810.0, 0.0, airspeed_m_s=20.0, settled=True)
        flight.for_s(5.0)
        flight.means(-800.0, 0.0, settled=True)
        assert times_s(flight.for_s(3.0), Orbit) == []


def test_one_order_is_under_way_at_a_time_and_a_refused_one_comes_again(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.for_s(5.0)
    flight.means(-900.0, 0.0, airspeed_m_s=22.0)
    assert of(flight.at(300.0), Orbit)
    assert all(flight.at(300.0) == [] for _ in range(20))  # no reply yet
    (announcement,) = flight.done("orbit", accepted=False)
    assert isinstance(announcement, Announce)
    assert announcement.level == "warning"
    again = flight.for_s(10.0)
    (at_s,) = times_s(again, Orbit)
    assert 4.5 <= at_s - (flight.at_s - 10.0) <= 5.5


def test_speeds_keep_to_the_airframe_and_are_sent_again_in_another_mode(land: Landscape) -> None:
    flight = Flight(land, "vehicles.0.max_airspeed_m_s=21")
    flight.orbiting()
    flight.means(-800.0, 0.0, airspeed_m_s=24.0)
    (speed,) = (command for _, command in flight.for_s(5.0) if isinstance(command, ChangeSpeed))
    assert speed.airspeed_m_s == 21.0
    flight.means(-800.0, 0.0, airspeed_m_s=20.7)
    assert times_s(flight.for_s(5.0), ChangeSpeed) == []
    flight.means(-800.0, 0.0, airspeed_m_s=20.0)
    assert len(times_s(flight.for_s(5.0), ChangeSpeed)) == 1
    flight.mode("mission")
    assert len(times_s(flight.for_s(5.0), ChangeSpeed)) == 1


def test_where_the_agent_has_settled_the_mission_loiters_until_it_moves(land: Landscape) -> None:
    flight = Flight(land)
    orbit = flight.orbiting()
    # It is now far from the loiter of the first mission, so a second mission ends here.
    found = flight.for_s(5.0)
    (mission,) = (command for _, command in found if isinstance(command, UploadMission))
    flight.means(-800.0, 0.0, settled=True)
    found = flight.for_s(30.0)
    assert mission.items[0].command == LOITER_UNLIM
    assert (mission.items[0].param3, mission.items[0].z) == (-150.0, orbit.altitude_amsl_m)
    assert (mission.items[0].x, mission.items[0].y) == pytest.approx(
        (orbit.lat_deg * 1e7, orbit.lon_deg * 1e7), abs=1.0
    )
    assert [type(c) for _, c in found if not isinstance(c, Announce)] == [StartMission, ChangeSpeed]
    assert found[0][0] - (flight.at_s - 30.0) == pytest.approx(20.25, abs=0.3)
    assert flight.core.guidance.in_mission(flight.name)
    assert [type(command) for _, command in flight.for_s(60.0)] == []  # the vehicle remains there
    flight.means(-850.0, 0.0, settled=False)
    assert [type(command) for _, command in flight.for_s(2.0)] == [Orbit, ChangeSpeed]
    flight.means(-850.0, 0.0, settled=True)
    kinds = [type(command) for _, command in flight.for_s(40.0)]
    assert kinds.count(UploadMission) == kinds.count(StartMission) == 1


def test_the_mission_on_board_ends_not_far_from_where_it_is(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.for_s(70.0)
    flight.means(-1300.0, 0.0)
    (mission,) = (
        command for _, command in flight.for_s(30.0) if isinstance(command, UploadMission)
    )
    assert mission.items[0].command == LOITER_UNLIM
    assert not of([command for _, command in flight.for_s(30.0)], StartMission)
    assert not flight.core.guidance.in_mission(flight.name)


def test_a_broken_upload_does_not_end_an_orbit(land: Landscape) -> None:
    """Along the front such an upload makes ArduPilot hold; on an orbit no mission is flown."""
    flight = Flight(land, "vehicles.0.stack=ardupilot")
    flight.handle(VehicleConnected(flight.at_us, flight.name, "a stack", False))
    flight.orbiting()
    commands = flight.at(300.0)
    while not (missions := of(commands, UploadMission)):
        flight.done("change speed")
        commands = flight.at(300.0)
    failed = UploadFinished(flight.at_us, flight.name, missions[0].mission_id, "failed", "no")
    assert [type(command) for command in flight.handle(failed)] == [Announce]
    assert len(times_s(flight.for_s(10.0), UploadMission)) == 1


def test_a_pilot_with_manual_control_has_it_until_it_is_back_in_its_mission(
    land: Landscape,
) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.for_s(5.0)
    announcement, alarm = flight.mode("position")
    assert isinstance(announcement, Announce)
    assert isinstance(alarm, RaiseAlarm)
    assert "position" in announcement.text
    assert len(flight.agent.left) == 1
    flight.means(-1000.0, 0.0)
    assert [command for _, command in flight.for_s(10.0)] == []
    flight.mode("mission")
    assert times_s(flight.for_s(1.0), Orbit) != []


def test_others_receive_the_motion_of_a_vehicle_under_manual_control(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.for_s(5.0)
    received = flight.core.guidance.formation.members["crane"].agent.received  # type: ignore[attr-defined]
    received.clear()
    flight.mode("position")
    flight.for_s(10.0)
    states = [message for message in received if isinstance(message, State)]
    assert 18 <= len(states) <= 22  # twice a second
    assert {(state.sender, state.agent_x_m, state.goal_x_m) for state in states} == {
        (flight.name, None, None)
    }
    fix = (states[-1].x_m, states[-1].y_m)
    assert fix == pytest.approx((flight.home_m[0] - 800.0, flight.home_m[1]))
    received.clear()
    flight.handle(LinkLost(flight.at_us, flight.name, 3.0))
    assert received == [states[-1]]  # from here on, agents decide
    flight.handle(LinkRestored(flight.at_us, flight.name))
    flight.for_s(1.0)
    received.clear()
    flight.mode("position", armed=False)
    assert Leaving(flight.at_us, flight.name, "tracking ended") in received


@pytest.mark.parametrize("turn_rad_s", [0.1, -0.1])
def test_the_circle_of_a_turning_vehicle_is_measured(turn_rad_s: float) -> None:
    def at(time_s: float) -> ObservedMotion:
        course = 1.0 + turn_rad_s * time_s
        place = (200.0 * np.sin(course), -200.0 * np.cos(course))  # around 0, 0 at 20 m/s
        place = place if turn_rad_s > 0 else (-place[0], -place[1])
        return time_s, *place, 20.0 * np.cos(course), 20.0 * np.sin(course)

    x_m, y_m, radius_m = expected_orbit(at(7.0), at(8.0), 150.0)
    assert (x_m, y_m) == pytest.approx((0.0, 0.0), abs=15.0)  # the delay is half a second
    assert radius_m == pytest.approx(-200.0 if turn_rad_s > 0 else 200.0, rel=0.01)


def test_a_vehicle_that_flies_straight_or_stands_is_expected_ahead_or_there() -> None:
    still: ObservedMotion = (0.0, 10.0, 20.0, 0.2, 0.0)
    assert expected_orbit(still, (1.0, 10.0, 20.0, 0.0, 0.1), 150.0) == (10.0, 20.0, -150.0)
    ahead = expected_orbit((0.0, 0.0, 0.0, 15.0, 0.0), (1.0, 15.0, 0.0, 15.0, 0.1), 150.0)
    assert ahead == pytest.approx((15.0 + 900.0, 6.0, -150.0))


def test_a_lost_link_leaves_and_it_is_led_again_when_it_is_back(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.for_s(5.0)
    (announcement,) = flight.handle(LinkLost(flight.at_us, flight.name, 3.0))
    assert isinstance(announcement, Announce)
    assert "continues to circle" in announcement.text
    assert len(flight.agent.left) == 1
    assert flight.for_s(10.0) == []
    flight.handle(LinkRestored(flight.at_us, flight.name))
    assert [type(command) for _, command in flight.for_s(4.0)] == [Orbit, ChangeSpeed]


def test_others_use_the_last_state_of_a_lost_vehicle_until_a_newer_report(
    land: Landscape,
) -> None:
    flight = Flight(land)
    orbit = flight.orbiting()
    x_m, y_m = land.xy_of_lat_lon(orbit.lat_deg, orbit.lon_deg)
    state = State(
        flight.at_us, flight.name, x_m + 150.0, y_m, 700.0, 0.0, 15.0, x_m, y_m, x_m, y_m, -150.0,
        15.0, settled=True,
    )  # fmt: skip
    flight.agent.outgoing.append(state)
    flight.at(300.0)
    received = flight.core.guidance.formation.members["crane"].agent.received  # type: ignore[attr-defined]
    received.clear()
    flight.handle(LinkLost(flight.at_us, flight.name, 3.0))
    assert received == [state]
    flight.handle(VehicleRebooted(flight.at_us, flight.name))
    assert received[1:] == [Leaving(flight.at_us, flight.name, "tracking ended")]


def test_a_restart_in_the_air_leaves_it_alone_until_it_is_in_its_mission(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    flight.handle(VehicleRebooted(flight.at_us, flight.name))
    found = [command for _, command in flight.for_s(5.0)]
    assert {type(command) for command in found} <= {Announce, RaiseAlarm, ReportChecks}
    flight.mode("mission")
    found = [command for _, command in flight.for_s(5.0)]
    assert of(found, UploadMission)[0].items[0].command == LOITER_UNLIM
    assert of(found, Orbit)


def test_it_is_led_home_in_time_and_comes_back_after_a_new_start(land: Landscape) -> None:
    flight = Flight(land, "vehicles.0.endurance_s=800", "vehicles.0.endurance_reserve_s=500")
    flight.orbiting()
    early = flight.for_s(200.0)
    assert flight.agent.home_m is None
    assert times_s(early, Return) == []
    flight.for_s(60.0)
    assert flight.agent.home_m == flight.home_m
    flight.means(0.0, 0.0)
    assert len(times_s(flight.for_s(2.5), Orbit)) == 1  # it follows its agent home
    flight.place_m = (-300.0, 0.0)
    found = flight.for_s(1.0)
    assert len(times_s(found, Return)) == 1
    flight.mode("return")
    flight.mode("return", armed=False)
    assert flight.agent.home_m is None
    flight.place_m = (0.0, 0.0)
    (mission,) = of(flight.at(0.0, later_s=10.0), UploadMission)
    assert mission.items[0].command == TAKEOFF
    assert not of(flight.uploaded(mission), StartMission)  # as operators do
    flight.mode("mission")
    flight.place_m = (-800.0, 0.0)
    assert of(flight.at(300.0, later_s=60.0), Orbit)


def test_observations_measurements_and_states_reach_agents(land: Landscape) -> None:
    flight = Flight(land)
    flight.orbiting()
    cols = land.shape[1]
    flight.handle(Observed(flight.at_us, flight.name, 10, 20, (".ub", "ubb", "uu.")))
    burning, unburned = flight.agent.seen[-1]
    assert burning == [10 * cols + 22, 11 * cols + 21, 11 * cols + 22]
    assert unburned == [10 * cols + 21, 11 * cols + 20, 12 * cols + 20, 12 * cols + 21]
    flight.handle(WindMeasured(flight.at_us, flight.name, 5.0, 270.0))
    update = FireUpdate(flight.at_us, flight.name, (1, 2))
    flight.agent.outgoing.append(update)
    flight.at(300.0)
    own = flight.agent.owns[-1]
    assert own.hot  # fire in the middle of the image
    assert own.wind_x_m_s == pytest.approx(5.0, abs=0.01)
    assert own.airspeed_m_s == pytest.approx(12.5)
    seats = flight.core.guidance.formation.members  # type: ignore[attr-defined]
    others = [member.agent.received for name, member in seats.items() if name != flight.name]
    assert len(others) == 7
    assert all(received == [update] for received in others)
    assert flight.agent.received == []
