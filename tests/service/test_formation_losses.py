"""Formations with lost messages: silent vehicles, first messages, altitude layers, goals."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from mission_service.experiments.virtual_agents.ideal_world import FormationWorld, Rules
from mission_service.experiments.virtual_agents.scenarios import burned
from mission_service.guidance.formation.agent import MAX_WAIT_US, Agent, OwnState
from mission_service.guidance.formation.intent_avoidance import (
    AdoptedOrbit,
    IntendedOrbit,
    OwnMotion,
    avoidance_rules,
    choose_orbit,
    layer_m,
    layered_rules,
)
from mission_service.guidance.formation.link_quality import LinkQuality
from mission_service.guidance.formation.loiter_kernels import heading_step, wanted_heading_rad
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.peer_table import PeerTable
from mission_service.guidance.formation.settings import Settings
from mission_service.peer_messages import Goal, Leaving, State

SETTINGS = Settings()
GRID = MapGrid(300, 300, 10.0, -1500.0, 1500.0)
FIRE = np.array([150 * 300 + 150])
S = 1_000_000
MEETS_M = (-300.0, 150.0)  # a UAV that flies east from here at 4 s meets another one


def state(at_s: float, x_m: float, y_m: float, orbit_x_m: float, number: int = 0) -> State:
    """Return the state of a UAV that flies east at 17.5 m/s, to an orbit around (orbit_x, 0)."""
    return State(
        round(at_s * S), "kite", x_m, y_m, 300.0, 17.5, 0.0, orbit_x_m, 0.0, orbit_x_m, 0.0,
        -150.0, 17.5, settled=False, number=number,
    )  # fmt: skip


def own(at_s: float, x_m: float = -1000.0, y_m: float = -1000.0) -> OwnState:
    return OwnState(round(at_s * S), x_m, y_m, 300.0, 17.5, 0.0, 17.5)


def agent_of(name: str = "hawk", team: tuple[str, ...] = ()) -> Agent:
    return Agent(name, SETTINGS, GRID, FIRE, 0, team=team)


def clear_s(peer: State, layered: bool = False, planned_m: float = 300.0) -> float:
    """Return for how long a UAV's circle around (0, 0) is clear of a peer's path, at 20 s."""
    peers = PeerTable()
    peers.apply_state(peer)
    motion = OwnMotion(1, 0.0, -150.0, 300.0, planned_m, 0.0, 17.5)
    held = AdoptedOrbit(IntendedOrbit(0.0, 0.0, -150.0, 17.5))
    rules = layered_rules(SETTINGS) if layered else avoidance_rules(SETTINGS)
    rows = peers.rows(20 * S)
    return choose_orbit(20.0, motion, held.orbit, held, rows, rules, listens=True).clear_s


def flown(peer: State, for_s: float) -> State:
    """Return the state of a UAV that has flown towards its orbit since its last state."""
    x_m, y_m, heading_rad, airspeed_m_s = peer.x_m, peer.y_m, 0.0, peer.airspeed_m_s
    orbit = (peer.orbit_x_m, peer.orbit_y_m, peer.orbit_radius_m)
    bank_rad = SETTINGS.airframe.bank_rad
    for _ in range(round(4.0 * for_s)):
        now = (x_m, y_m, heading_rad, airspeed_m_s)
        wanted_rad = wanted_heading_rad(*now, *orbit, 0.0, 0.0, 0.25, bank_rad)
        x_m, y_m, heading_rad, airspeed_m_s = heading_step(
            *now, wanted_rad, peer.airspeed_m_s, 0.0, 0.0, 0.25, bank_rad
        )
    return replace(
        peer, at_us=peer.at_us + round(for_s * S), x_m=x_m, y_m=y_m,
        velocity_x_m_s=airspeed_m_s * math.cos(heading_rad),
        velocity_y_m_s=airspeed_m_s * math.sin(heading_rad),
    )  # fmt: skip


def test_a_silent_vehicle_is_on_its_way_to_its_orbit_and_not_on_it() -> None:
    silent = state(4.0, *MEETS_M, 1000.0)
    assert clear_s(silent) == pytest.approx(clear_s(flown(silent, 16.0)), abs=1.0)
    assert clear_s(silent) < 40.0


def test_links_are_lossy_while_most_states_are_lost() -> None:
    rng = np.random.default_rng(1)
    quality, lossy = LinkQuality(), {}
    for number in range(800):
        share = 0.9 if 200 <= number < 500 else 0.2
        if rng.random() >= share:
            quality.store(state(number / 2.0, 0.0, 0.0, 0.0, number))
        lossy[number] = quality.lossy
    assert not any(lossy[number] for number in range(200))
    assert all(lossy[number] for number in range(300, 500))
    assert not any(lossy[number] for number in range(620, 800))


def test_an_agent_waits_for_the_first_message_of_each_of_the_others() -> None:
    def moved_m(waits: bool, received: bool, at_us: int) -> float:
        agent = agent_of()
        if waits:
            agent.wait_for(["hawk", "kite"])
        first = agent.step(own(0.0))
        if received:
            agent.on_message(Leaving(0, "kite", "fuel"))
        for tick in range(4):
            last = agent.step(own(at_us / S + tick))
        return math.dist((first.agent_x_m, first.agent_y_m), (last.agent_x_m, last.agent_y_m))

    assert moved_m(waits=True, received=False, at_us=S) == 0.0
    assert moved_m(waits=True, received=True, at_us=S) > 20.0
    assert moved_m(waits=True, received=False, at_us=MAX_WAIT_US) > 20.0
    assert moved_m(waits=False, received=False, at_us=S) > 20.0


def test_a_layer_counts_only_if_both_stay_in_their_layers_on_the_way() -> None:
    def in_conflict(planned_m: float, altitude_m: float, peer_planned_m: float) -> bool:
        peer = flown(state(4.0, *MEETS_M, 1000.0), 16.0)
        peer = replace(peer, altitude_amsl_m=altitude_m, planned_altitude_amsl_m=peer_planned_m)
        return clear_s(peer, layered=True, planned_m=planned_m) < 40.0

    step_m = layer_m(SETTINGS)
    assert in_conflict(300.0, 300.0, 300.0)
    assert not in_conflict(300.0, 300.0 + step_m, 300.0 + step_m)
    assert in_conflict(300.0, 300.0, 300.0 + step_m)  # the other still climbs
    assert in_conflict(300.0 + 2.0 * step_m, 300.0 + step_m, 300.0 + step_m)


def test_the_goal_of_a_vehicle_beyond_radio_range_keeps_its_place() -> None:
    def goal_m(*others: Goal) -> tuple[float, float]:
        agent = agent_of()
        for other in others:
            agent.on_message(other)
        sent = []
        for tick in range(12):
            agent.step(own(tick / 2.0))
            sent += [m for m in agent.messages(tick * S // 2) if isinstance(m, Goal)]
        assert sent[0].sender == "hawk"
        return sent[-1].x_m, sent[-1].y_m

    alone_m = goal_m()
    assert math.dist(goal_m(Goal(0, "kite", *alone_m)), alone_m) > 200.0


def test_sixteen_keep_apart_in_wind_while_nine_of_ten_messages_are_lost() -> None:
    rules = Rules(loss_at=lambda at_s: 0.9, wind_m_s=(-6.0, 8.0))
    world = FormationWorld(burned(0.01, 2600, 0), 16, SETTINGS, rules, 0)
    for _ in range(4 * 120):
        world.tick()
    assert world.safety.collisions == 0
    assert world.heights_m[0] == SETTINGS.altitude_agl_m
    assert world.heights_m[3] == pytest.approx(SETTINGS.altitude_agl_m + 3.0 * layer_m(SETTINGS))
    assert all(agent.maps.fire.any() for agent in world.agents)
