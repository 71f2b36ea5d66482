"""The agent of one UAV: its virtual agent, orbit, messages, heat, return."""

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as with_fields

from mission_service.errors import MissionServiceError
from mission_service.guidance.formation.agent import Agent, OwnState
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.peer_table import AVOIDED_FOR_S, recent
from mission_service.guidance.formation.settings import Settings
from mission_service.peer_messages import FireUpdate, Leaving, State

GRID = MapGrid(300, 300, 10.0, -1500.0, 1500.0)
MIDDLE = 150 * 300 + 150
SETTINGS = Settings()


def agent_of(name: str = "hawk", **options: object) -> Agent:
    """Return an agent whose map has one burning cell in the middle."""
    return Agent(name, SETTINGS, GRID, np.array([MIDDLE]), 0, **options)  # type: ignore[arg-type]


def own_at(at_s: float, x_m: float, y_m: float, **more: object) -> OwnState:
    """Return the own state: flying north at cruise speed."""
    speed = SETTINGS.airframe.cruise_m_s
    return OwnState(round(at_s * 1e6), x_m, y_m, 300.0, 0.0, speed, speed, **more)  # type: ignore[arg-type]


def state_of(name: str, at_s: float, x_m: float, y_m: float) -> State:
    """Return the state of another UAV that circles around its agent."""
    speed = SETTINGS.airframe.cruise_m_s
    return State(
        round(at_s * 1e6), name, x_m, y_m, 300.0, 0.0, speed, x_m - 150.0, y_m, x_m - 150.0, y_m,
        -150.0, speed, True,
    )  # fmt: skip


def test_a_virtual_agent_begins_a_radius_ahead_of_its_uav() -> None:
    intention = agent_of().step(own_at(0.0, -1000.0, -1000.0))
    assert (intention.agent_x_m, intention.agent_y_m) == pytest.approx((-1000.0, -850.0))
    assert intention.orbit_radius_m == -150.0


def test_it_starts_again_when_its_uav_is_too_far_away() -> None:
    agent = agent_of()
    agent.step(own_at(0.0, -1000.0, -1000.0))
    agent.agent_m = (-1000.0, -1000.0 + SETTINGS.restart_m + 1.0)
    intention = agent.step(own_at(0.0, -1000.0, -1000.0))
    assert (intention.agent_x_m, intention.agent_y_m) == pytest.approx((-1000.0, -850.0))


def test_it_moves_towards_the_fire_and_never_faster_than_it_may() -> None:
    agent = agent_of()
    first = agent.step(own_at(0.0, -1000.0, -1000.0))
    then = agent.step(own_at(0.5, -1000.0, -991.0))
    before_m = math.hypot(first.agent_x_m, first.agent_y_m)
    after_m = math.hypot(then.agent_x_m, then.agent_y_m)
    assert before_m - SETTINGS.agent_speed_m_s * 0.5 - 1e-6 <= after_m < before_m


def test_it_sends_its_state_twice_a_second_and_its_observations_at_once() -> None:
    agent = agent_of(avoidance="none")
    sent = []
    for tick in range(40):
        agent.step(own_at(tick * 0.25, -1000.0, -1000.0 + tick))
        sent += agent.messages(tick * 250_000)
    states = [message for message in sent if isinstance(message, State)]
    assert 20 <= len(states) <= 30
    agent.add_view(np.array([MIDDLE + 1]), np.array([], dtype=np.int64), 10_000_000)
    updates = [m for m in agent.messages(10_000_000) if isinstance(m, FireUpdate)]
    assert [update.burning for update in updates] == [(MIDDLE + 1,)]


def test_what_another_saw_is_on_its_map() -> None:
    agent = agent_of()
    agent.on_message(FireUpdate(1_000_000, "kite", (MIDDLE + 1, MIDDLE + 2)))
    assert agent.maps.fire.sum() == 3
    assert agent.maps.augmentation[150, 152 + 16] > 0


def test_cells_of_another_landscape_are_refused_in_words() -> None:
    with pytest.raises(MissionServiceError, match="use one landscape for all vehicles"):
        agent_of().on_message(FireUpdate(1_000_000, "kite", (300 * 300,)))


def test_another_agent_close_by_pushes_it_away_until_it_has_left() -> None:
    def east_of(with_other: bool, left: bool) -> float:
        agent = agent_of()
        agent.step(own_at(0.0, -600.0, 0.0))
        if with_other:
            agent.on_message(state_of("kite", 0.0, -320.0, 150.0))
        if left:
            agent.on_message(Leaving(1, "kite", "fuel"))
        return agent.step(own_at(0.5, -600.0, 9.0)).agent_x_m

    assert east_of(True, False) < east_of(False, False) - 1.0
    assert east_of(True, True) == east_of(False, False)


def test_a_silent_peer_is_avoided_for_longer_than_its_goal_and_its_phase_count() -> None:
    agent = agent_of()
    agent.on_message(state_of("kite", 0.0, -320.0, 150.0))
    assert len(recent(agent.peers.rows(9_900_000))) == 1
    assert len(recent(agent.peers.rows(10_100_000))) == 0
    assert len(agent.peers.goals(29_900_000)) == 1
    assert len(agent.peers.goals(30_100_000)) == 0
    assert len(agent.peers.rows(round(AVOIDED_FOR_S * 1e6) - 1)) == 1
    assert len(agent.peers.rows(round(AVOIDED_FOR_S * 1e6))) == 0


def test_it_climbs_from_heat_and_comes_down_when_it_has_been_cool_for_a_while() -> None:
    agent = agent_of()
    climbs = [
        agent.step(own_at(tick / 2.0, -600.0, 0.0, hot=tick < 20)).climb_m for tick in range(120)
    ]
    assert climbs[19] == pytest.approx(20 * 0.5 * SETTINGS.airframe.climb_m_s, abs=2.0)
    assert climbs[50] == climbs[19]  # still in the air
    assert climbs[-1] == 0.0


def test_on_its_way_home_it_has_no_agent_and_circles_there() -> None:
    agent = agent_of()
    agent.step(own_at(0.0, -600.0, 0.0))
    agent.go_home(-1200.0, -1200.0)
    intention = agent.step(own_at(1.0, -600.0, 17.5))  # the agent decides twice a second
    assert (intention.orbit_x_m, intention.orbit_y_m) == (-1200.0, -1200.0)
    assert math.isnan(intention.agent_x_m)
    (state,) = (m for m in agent.messages(1_000_000) if isinstance(m, State) and m.at_us)
    assert (state.agent_x_m, state.goal_x_m) == (None, None)
    agent.come_back()
    back = agent.step(own_at(1.25, -600.0, 22.0))
    assert (back.agent_x_m, back.agent_y_m) == pytest.approx((-600.0, 172.0), abs=15.0)


def test_others_go_by_where_its_virtual_agent_is_going() -> None:
    agent = agent_of()
    agent.on_message(
        with_fields(state_of("kite", 0.0, -320.0, 150.0), goal_x_m=10.0, goal_y_m=20.0)
    )
    assert agent.peers.goals(0)[0, :2].tolist() == [10.0, 20.0]
    sent = []
    for tick in range(40):
        agent.step(own_at(tick * 0.25, -400.0, 0.0))
        sent += [m for m in agent.messages(tick * 250_000) if isinstance(m, State)]
    assert sent[-1].goal_x_m is not None


def test_it_is_settled_after_a_while_on_one_orbit() -> None:
    still = replace(SETTINGS, agent_speed_m_s=0.0)
    agent = Agent("hawk", still, GRID, np.array([MIDDLE]), 0, avoidance="none")
    settled = []
    for tick in range(400):
        angle = tick * 0.25 * SETTINGS.airframe.cruise_m_s / 150.0
        x_m, y_m = -600.0 + 150.0 * math.cos(angle), 150.0 * math.sin(angle)
        agent.agent_m = (-600.0, 0.0)
        settled.append(agent.step(own_at(tick * 0.25, x_m, y_m)).settled)
    assert not settled[70]
    assert settled[90]
    agent.agent_m = (-560.0, 0.0)
    assert not agent.step(own_at(100.0, x_m, y_m)).settled
