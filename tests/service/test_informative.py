"""The planner that follows estimated fronts of any shape and chooses routes for information."""

import math

import numpy as np
import pytest

from mission_service.config.scenario import load_scenario
from mission_service.events import EstimatedFront, FrontsEstimated, Observed
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.front.informative.front_nodes import front_of, nodes_of
from mission_service.guidance.front.informative.planner import InformativePlanner, planners_of
from mission_service.guidance.front.informative.route_search import Route, Situation, evaluate
from mission_service.guidance.front.sweeps import NEVER

FAST_M_S, SLOW_M_S = 0.5, 0.01


def circle(
    row: float,
    col: float,
    radius: float,
    *,
    inner: bool = False,
    fast_deg: tuple[float, float] | None = None,
    unseen_s: float = 0.0,
) -> EstimatedFront:
    """Return a circular front; its speed is high only between two bearings, or everywhere."""
    count = max(round(math.tau * radius), 12)
    bearing = np.arange(count) * 360.0 / count
    speed = np.full(count, 0.05)
    if fast_deg is not None:
        fast = (bearing - fast_deg[0]) % 360.0 <= (fast_deg[1] - fast_deg[0]) % 360.0
        speed = np.where(fast, FAST_M_S, SLOW_M_S)
    north, east = radius * np.cos(np.radians(bearing)), radius * np.sin(np.radians(bearing))
    rows, cols, speeds, sds = (
        tuple(values.tolist()) for values in (row - north, col + east, speed, 0.3 * speed)
    )
    return EstimatedFront(inner, rows, cols, speeds, sds, (unseen_s,) * count)


def planners(count: int = 1) -> dict[str, InformativePlanner]:
    """Return the planners of vehicles in the default scenario."""
    scenario = load_scenario("default", ("planner.rule=informative",))
    first = scenario.vehicles[0]
    vehicles = tuple(first.model_copy(update={"name": f"uav{k}"}) for k in range(count))
    scenario = scenario.model_copy(update={"vehicles": vehicles})
    return planners_of(scenario, landscape_of(scenario))


def event(at_s: float, *fronts: EstimatedFront, vehicle: str = "uav0") -> FrontsEstimated:
    """Return an event with fronts."""
    return FrontsEstimated(round(at_s * 1e6), vehicle, fronts)


def test_the_approach_ends_at_the_front() -> None:
    planner = planners()["uav0"]
    assert planner.at(100.0, 100.0, 0.0) is None
    planner.on_fronts(event(10.0, circle(100.0, 100.0, 20.0)))
    assert planner.at(50.0, 100.0, 11.0) is None
    phases = [planner.phase]
    planner.at(80.5, 100.0, 60.0)
    assert [*phases, planner.phase] == ["approach", "monitor"]


def test_the_path_follows_the_front_in_the_flying_direction() -> None:
    planner = planners()["uav0"]
    planner.on_fronts(event(10.0, circle(100.0, 100.0, 40.0)))
    planner.at(60.0, 100.0, 20.0)  # the northernmost place
    path = planner.path(60.0, 100.0)
    assert np.hypot(path[:, 0] - 100.0, path[:, 1] - 100.0) == pytest.approx(
        np.full(len(path), 40.0), abs=1.0
    )
    eastwards = path[5, 1] > path[0, 1]
    assert eastwards == planner.clockwise


def test_an_even_front_is_lapped_without_turns() -> None:
    planner = planners()["uav0"]
    cell_m = 30.0
    for step in range(200):
        at_s = 20.0 * step
        angle = 20.0 * step * 20.0 / cell_m / 40.0
        row, col = 100.0 - 40.0 * math.cos(angle), 100.0 + 40.0 * math.sin(angle)
        behind = (np.degrees(angle) - np.arange(251) * 360.0 / 251) % 360.0
        unseen = tuple((behind / 360.0 * math.tau * 40.0 * cell_m / 20.0).tolist())
        front = circle(100.0, 100.0, 40.0)
        front = EstimatedFront(False, front.rows, front.cols, front.speeds_m_s,
                               front.speed_sds_m_s, unseen)  # fmt: skip
        planner.on_fronts(event(at_s, front))
        planner.at(row, col, at_s)
    assert planner.reversals == 0
    assert planner.clockwise


def test_a_second_fire_that_was_not_seen_for_long_is_visited() -> None:
    planner = planners()["uav0"]
    near, far = circle(60.0, 60.0, 15.0), circle(60.0, 130.0, 15.0, unseen_s=3600.0)
    planner.on_fronts(event(10.0, near, far))
    planner.at(45.0, 60.0, 20.0)
    path = planner.path(45.0, 60.0)
    assert np.hypot(path[:, 0] - 60.0, path[:, 1] - 130.0).min() < 16.0


@pytest.mark.parametrize("unseen_s", [30.0, 300.0])
def test_after_a_lap_of_a_small_fire_a_flight_to_another_one_needs_no_large_gain(
    unseen_s: float,
) -> None:
    planner, radius = planners()["uav0"], 3.0
    left_at = None
    for flown in range(40):
        at_s, angle = flown / planner.settings.speed_cells_s, flown / radius
        far = circle(60.0, 100.0, 15.0, unseen_s=unseen_s + at_s)
        planner.on_fronts(event(at_s, circle(60.0, 60.0, radius), far))
        planner.at(60.0 - radius * math.cos(angle), 60.0 + radius * math.sin(angle), at_s)
        if left_at is None and planner._plan.hop is not None:
            left_at = flown
    assert left_at == math.ceil(math.tau * radius)


def test_a_flight_to_another_fire_begins_ahead_of_the_vehicle() -> None:
    """A path from the vehicle's position would lead back as soon as the vehicle has moved on."""
    planner = planners()["uav0"]
    near, far = circle(60.0, 60.0, 15.0), circle(60.0, 130.0, 15.0, unseen_s=3600.0)
    planner.on_fronts(event(10.0, near, far))
    planner.at(60.0, 76.0, 20.0)
    for col in (76.0, 112.0):
        path = planner.path(60.0, col)
        assert math.dist(path[0], (60.0, col)) >= min(planner.settings.path.lookahead_cells, 3.0)
        assert path[0, 1] > col


def test_a_flight_between_fires_does_not_cross_burned_ground() -> None:
    planner = planners()["uav0"]
    near, far = circle(60.0, 60.0, 15.0), circle(60.0, 130.0, 15.0, unseen_s=3600.0)
    planner.on_fronts(event(10.0, near, far))
    planner.at(61.0, 45.0, 20.0)  # at the far side of the first fire
    path = planner.path(61.0, 45.0)
    inside = np.hypot(path[:, 0] - 60.0, path[:, 1] - 60.0) < 14.0
    assert not inside.any()


def test_a_flight_to_another_fire_is_not_given_up_for_a_small_gain() -> None:
    """The errors of the first fire have grown past those of the second, which is nearer now."""
    planner = planners()["uav0"]
    near, far = circle(60.0, 60.0, 15.0), circle(60.0, 130.0, 15.0, unseen_s=900.0)
    planner.on_fronts(event(10.0, near, far))
    planner.at(60.0, 76.0, 20.0)
    planner.at(60.0, 100.0, 30.0)
    again = circle(60.0, 60.0, 15.0, unseen_s=2700.0)
    planner.on_fronts(event(40.0, again, far))
    planner.at(60.0, 101.0, 41.0)
    path = planner.path(60.0, 101.0)
    assert np.hypot(path[:, 0] - 60.0, path[:, 1] - 130.0).min() < 16.0


def test_a_turn_back_before_a_flight_to_another_fire_must_save_half_of_the_cost() -> None:
    planner = planners()["uav0"]
    near, far = circle(60.0, 60.0, 15.0), circle(60.0, 130.0, 15.0, unseen_s=900.0)
    planner.on_fronts(event(10.0, near, far))
    nodes = nodes_of(planner._shared.fronts, 0.5, (0.0, 0.0))
    own, other = 0, int(np.flatnonzero(nodes.front == 1)[0])
    present = Route(own, 1)
    ways = [Route(own, 1, 0.0, 4, NEVER, other), Route(other, 1, 60.0)]
    turned = [Route(own, -1, 20.0, 4, NEVER, other), Route(own, -1, 20.0)]
    assert all(planner._is_hop(way, present, own, nodes) for way in ways)
    assert not any(planner._is_hop(way, present, own, nodes) for way in turned)


def test_the_second_vehicle_takes_over_what_the_first_does_not_visit() -> None:
    team = planners(2)
    both = (circle(60.0, 60.0, 15.0, unseen_s=1800.0), circle(60.0, 120.0, 15.0, unseen_s=1800.0))
    team["uav0"].on_fronts(event(10.0, *both))
    for name in team:
        team[name].at(45.0, 60.0, 20.0)
    goals = {name: float(team[name].path(45.0, 60.0)[-1, 1]) for name in team}
    assert (goals["uav0"] > 90.0) != (goals["uav1"] > 90.0)


def test_a_vehicle_that_left_is_not_counted_on() -> None:
    team = planners(2)
    team["uav0"].on_fronts(event(10.0, circle(60.0, 60.0, 15.0)))
    team["uav0"].at(45.0, 60.0, 20.0)
    shared = team["uav1"]._shared
    assert shared.visits_of_others("uav1").size
    team["uav0"].left(30.0)
    assert not shared.visits_of_others("uav1").size


def test_a_narrow_fast_head_is_dwelt_upon() -> None:
    """On a head 20 times faster, sweeps have a lower cost than laps."""
    front = front_of(circle(100.0, 100.0, 40.0, fast_deg=(0.0, 12.0)), 0.0, 30.0)
    nodes = nodes_of([front], 0.5, (0.0, 0.0))
    error = np.full(nodes.row.size, 0.5)
    hop_s = np.zeros((error.size, error.size))
    situation = Situation(nodes, error, hop_s, 5.0, np.empty((0, 2)))
    start = int(np.argmax(nodes.growth))
    out = int((nodes.growth > nodes.growth.min() * 1.5).sum())
    laps, sweep = evaluate(
        [Route(start, 1), Route(start, 1, 0.0, out, out)], situation
    ).costs.tolist()
    assert sweep < laps


def test_a_turn_is_made_after_the_way_out() -> None:
    front = front_of(circle(100.0, 100.0, 40.0), 0.0, 30.0)
    nodes = nodes_of([front], 0.5, (0.0, 0.0))
    error = np.full(nodes.row.size, 0.5)
    situation = Situation(nodes, error, np.zeros((error.size,) * 2), 5.0, np.empty((0, 2)))
    visits = evaluate([Route(10, 1, 0.0, 3, NEVER)], situation).visits
    assert visits[:7, 0].tolist() == [10, 11, 12, 13, 12, 11, 10]
    assert (np.diff(visits[:, 1]) > 0.0).all()


def test_an_event_replaces_the_map_for_alarms_only_by_observations() -> None:
    planner = planners()["uav0"]
    planner.observe(Observed(0, "uav0", 98, 98, ("bbu", "bbu", "bbu")))
    assert not np.isnan(planner.map.outer).all()


def test_wind_makes_flights_against_it_longer() -> None:
    front = front_of(circle(100.0, 100.0, 40.0), 0.0, 30.0)
    calm, windy = nodes_of([front], 0.5, (0.0, 0.0)), nodes_of([front], 0.5, (0.0, 0.25))
    assert calm.ahead_s == pytest.approx(calm.back_s)
    north = int(np.argmin(calm.row))  # clockwise means east there, with the wind
    assert windy.ahead_s[north] < calm.ahead_s[north] < windy.back_s[north]
