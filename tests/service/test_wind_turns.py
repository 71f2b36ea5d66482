"""Fastest paths between oriented places in wind, compared with an independent computation."""

import itertools
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq, root

from mission_service.guidance.front.informative.wind_turns import (
    Flight,
    Pose,
    heading_on_course,
    turn_times_s,
)
from tests.service.wind_paths import WindPath, fastest_path

Floats = NDArray[np.float64]
HALF = math.pi / 2.0


def end_of(path: WindPath) -> Floats:
    end: Floats = path.poses(np.array([path.duration_s]))[0]
    return end


def assert_arrives(path: WindPath, goal: Pose) -> None:
    x, y, heading = end_of(path)
    tolerance = 1e-4 * path.flight.turn_radius_m
    assert math.hypot(x - goal[0], y - goal[1]) < tolerance
    assert abs(math.remainder(heading - goal[2], math.tau)) < 1e-6


def ground_length_m(path: WindPath) -> float:
    poses = path.poses(np.linspace(0.0, path.duration_s, 5001))
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


@pytest.mark.parametrize(
    ("goal", "family", "length"),
    [
        ((1000.0, 0.0, 0.0), None, 1000.0),
        ((0.0, 0.0, 0.0), None, 0.0),
        ((100.0, 100.0, HALF), None, HALF * 100.0),  # a quarter of a turn circle
        ((0.0, 200.0, math.pi), None, math.pi * 100.0),
        ((500.0, 200.0, math.pi), "LSL", math.pi * 100.0 + 500.0),
        ((500.0, -200.0, math.pi), None, math.pi * 100.0 + 500.0),
        # On the spot, the other way round: three turns of 60, 300 and 60 degrees.
        ((0.0, 0.0, math.pi), None, 7.0 / 3.0 * math.pi * 100.0),
        # Two turns of a quarter circle in opposite directions, without a straight leg.
        ((200.0, 200.0, 0.0), None, math.pi * 100.0),
    ],
)
def test_known_paths_without_wind(goal: Pose, family: str | None, length: float) -> None:
    path = fastest_path((0.0, 0.0, 0.0), goal, Flight(20.0, 100.0, (0.0, 0.0)))
    assert path.duration_s * 20.0 == pytest.approx(length, abs=0.01)
    assert family in (None, path.family)
    assert_arrives(path, goal)


def test_wind_along_a_straight_leg() -> None:
    goal = (1000.0, 0.0, 0.0)
    for wind, speed in ((5.0, 25.0), (-5.0, 15.0)):
        path = fastest_path((0.0, 0.0, 0.0), goal, Flight(20.0, 100.0, (wind, 0.0)))
        assert path.duration_s == pytest.approx(1000.0 / speed, abs=1e-3)
    # Across the wind, the nose points into it and the course stays straight.
    across = Flight(20.0, 100.0, (0.0, 12.0))
    heading = heading_on_course(0.0, across)
    assert heading == pytest.approx(-math.asin(0.6))
    path = fastest_path((0.0, 0.0, heading), (1000.0, 0.0, heading), across)
    assert path.duration_s == pytest.approx(1000.0 / 16.0, abs=1e-3)
    assert np.abs(path.poses(np.linspace(0.0, path.duration_s, 20))[:, 1]).max() < 0.01


def test_a_full_turn_downwind_takes_no_straight_leg() -> None:
    flight = Flight(20.0, 100.0, (5.0, 0.0))
    lap_s = math.tau * 100.0 / 20.0
    path = fastest_path((0.0, 0.0, HALF), (5.0 * lap_s, 0.0, HALF), flight)
    assert path.duration_s <= lap_s + 1e-3


@pytest.mark.parametrize(
    ("start", "goal", "airspeed", "curvature", "wind", "length_m"),
    [  # lengths over the ground from the tests of github.com/castacks/trochoids, within 11 m there
        ((0.0, 0.0, 0.0), (0.0, 1000.0, 0.0), 50.0, 0.015, (0.0, 0.0), 1085.0),
        ((0.0, 0.0, 0.0), (50.0, 100.0, 0.2), 50.0, 0.001, (0.0, 0.0), 6353.0),
        ((0.0, 0.0, 1.5707), (1000.0, 1000.0, 0.0), 50.0, 0.015, (0.0, 0.0), 1425.0),
        ((0.0, 0.0, 1.5707), (1000.0, 1000.0, 1.5707), 50.0, 0.015, (0.0, 0.0), 1425.0),
        ((0.0, 0.0, 0.0), (50.0, 100.0, 0.2), 50.0, 0.001, (10.0, 20.0), 7394.0),
        ((0.0, 0.0, 0.0), (50.0, 100.0, 0.2), 100.0, 0.07, (10.0, 20.0), 116.0),
        ((0.0, 0.0, 0.0), (50.0, 100.0, 0.2), 1.0, 0.001, (0.5, 0.75), 8473.0),
    ],
)
def test_lengths_of_published_cases(
    start: Pose,
    goal: Pose,
    airspeed: float,
    curvature: float,
    wind: tuple[float, float],
    length_m: float,
) -> None:
    path = fastest_path(start, goal, Flight(airspeed, 1.0 / curvature, wind))
    assert ground_length_m(path) == pytest.approx(length_m, abs=11.0)
    assert_arrives(path, goal)


def arc(heading: Floats | float, angle: Floats | float, side: float, radius: float) -> Floats:
    """Return the displacement (2, ...) through the air on an arc of an angle (0 or more)."""
    later = heading + side * angle
    return np.array(
        [
            side * radius * (np.sin(later) - np.sin(heading)),
            side * radius * (np.cos(heading) - np.cos(later)),
        ]
    )


def with_straight_leg(
    angle: Floats | float, kind: tuple[float, float, float], start: Pose, goal: Pose, flight: Flight
) -> tuple[Any, Any, Any]:
    """Return what a path with first turns by angles (n) misses across its leg, and two times.

    The times are those of the straight leg and of both turns. ``kind`` is the sides of the turns
    and an angle that is added to the last turn.
    """
    one, other, circles = kind
    radius = flight.turn_radius_m
    heading = start[2] + one * angle
    last = (other * (goal[2] - heading)) % math.tau + circles
    turns_s = (angle + last) * radius / flight.airspeed_m_s
    rest_x, rest_y = (
        goal[axis]
        - start[axis]
        - flight.wind_m_s[axis] * turns_s
        - arc(start[2], angle, one, radius)[axis]
        - arc(heading, last, other, radius)[axis]
        for axis in (0, 1)
    )
    speed_x = flight.airspeed_m_s * np.cos(heading) + flight.wind_m_s[0]
    speed_y = flight.airspeed_m_s * np.sin(heading) + flight.wind_m_s[1]
    leg_s = (rest_x * speed_x + rest_y * speed_y) / (speed_x**2 + speed_y**2)
    return (rest_x * speed_y - rest_y * speed_x) / flight.airspeed_m_s, leg_s, turns_s


def straight_path_time_s(start: Pose, goal: Pose, flight: Flight) -> float:
    """Return the shortest time by a turn, a straight leg and a turn, from ground displacements.

    The first turn's angle is found such that what remains between both turns is along the ground
    velocity on the leg.
    """
    best = math.inf
    angles = np.linspace(0.0, 2.0 * math.tau, 1441)
    for kind in itertools.product((1.0, -1.0), (1.0, -1.0), (0.0, math.tau)):
        misses = partial(with_straight_leg, kind=kind, start=start, goal=goal, flight=flight)
        aside = misses(angles)[0]
        for n in np.flatnonzero(np.sign(aside[1:]) != np.sign(aside[:-1])):
            angle = brentq(lambda a, misses=misses: misses(a)[0], angles[n], angles[n + 1])
            off, leg_s, turns_s = misses(angle)
            if abs(off) < 1e-4 * flight.turn_radius_m and leg_s > -1e-6:
                best = min(best, float(leg_s + turns_s))
    return best


def three_turns(
    angles: Floats, side: float, start: Pose, goal: Pose, flight: Flight
) -> tuple[Floats, float]:
    """Return by how much a path of three turns misses the goal, in turn radii, and its time.

    ``angles`` (2) are those of the first and of the middle turn.
    """
    radius = flight.turn_radius_m
    first, middle = angles
    headings = start[2] + side * np.array([0.0, first, first - middle])
    last = (side * (goal[2] - headings[2])) % math.tau
    flown = arc(headings[0], first, side, radius) + arc(headings[1], middle, -side, radius)
    flown = flown + arc(headings[2], last, side, radius)
    time_s = (first + middle + last) * radius / flight.airspeed_m_s
    way = np.array(goal[:2]) - start[:2]
    return (flown + np.array(flight.wind_m_s) * time_s - way) / radius, time_s


def three_turns_time_s(start: Pose, goal: Pose, flight: Flight) -> float:
    """Return the shortest time by three turns, by solving for the angles from many guesses."""
    best = math.inf
    for side in (1.0, -1.0):
        flown = partial(three_turns, side=side, start=start, goal=goal, flight=flight)

        def misses(angles: Floats, flown: Any = flown) -> Any:
            return flown(angles)[0]

        for guess in itertools.product(np.linspace(0.2, 6.0, 6), np.linspace(0.5, 6.2, 6)):
            solved = root(misses, np.array(guess))
            angles = solved.x
            if (
                np.abs(solved.fun).max() < 1e-6
                and -1e-9 < angles[0] < math.tau
                and 0.0 < angles[1] < math.tau
            ):
                best = min(best, flown(angles)[1])
    return best


@pytest.mark.parametrize("near", [True, False])
def test_random_pairs_in_wind_by_an_independent_computation(near: bool) -> None:
    rng = np.random.default_rng(2 if near else 3)
    by_turns = 0
    for _ in range(10):
        wind_m_s, toward = rng.uniform(0.0, 14.0), rng.uniform(0.0, math.tau)
        wind = (wind_m_s * math.cos(toward), wind_m_s * math.sin(toward))
        flight = Flight(20.0, 60.0, wind)
        reach = 120.0 if near else 900.0
        start = (0.0, 0.0, rng.uniform(0.0, math.tau))
        goal = (rng.uniform(-reach, reach), rng.uniform(-reach, reach), rng.uniform(0.0, math.tau))
        path = fastest_path(start, goal, flight)
        assert_arrives(path, goal)
        expected_s = straight_path_time_s(start, goal, flight)
        if near:
            by_turns_s = three_turns_time_s(start, goal, flight)
            by_turns += by_turns_s < expected_s
            expected_s = min(expected_s, by_turns_s)
        assert path.duration_s == pytest.approx(expected_s, rel=1e-3), (start, goal, flight, path)
    assert by_turns >= (3 if near else 0)


@pytest.mark.parametrize(
    ("heading", "goal", "wind_m_s"),
    [
        (4.0, (-42.0, -21.0, 4.1), 12.0),  # the middle turn is shorter than half a circle
        (3.9, (9.0, -44.0, 2.9), 16.0),
        (4.8, (51.0, -10.0, 1.3), 14.0),  # soon later, the last turn becomes a full circle
        (2.5, (39.0, -34.0, 5.3), 14.0),
    ],
)
def test_paths_that_exist_for_a_short_time(heading: float, goal: Pose, wind_m_s: float) -> None:
    start, flight = (0.0, 0.0, heading), Flight(20.0, 60.0, (wind_m_s, 0.0))
    path = fastest_path(start, goal, flight)
    assert_arrives(path, goal)
    assert path.duration_s == pytest.approx(three_turns_time_s(start, goal, flight), rel=1e-3)
    assert path.duration_s < 0.5 * straight_path_time_s(start, goal, flight)


def test_many_pairs_at_once_and_their_limits() -> None:
    rng = np.random.default_rng(1)
    flight = Flight(20.0, 60.0, (6.0, -8.0))
    starts, goals = (
        np.column_stack([rng.uniform(-800.0, 800.0, (200, 2)), rng.uniform(0.0, 6.3, 200)])
        for _ in range(2)
    )
    times = turn_times_s(starts, goals, flight)
    for n in range(0, 200, 40):
        start, goal = (tuple(poses[n].tolist()) for poses in (starts, goals))
        assert fastest_path(start, goal, flight).duration_s == times[n]
    # No slower than the longest path without wind against it, no faster than the straight line.
    distance = np.hypot(*(goals - starts)[:, :2].T)
    assert (times >= distance / 30.0).all()
    assert (times <= (distance + 7.0 / 3.0 * math.pi * 60.0 + math.tau * 60.0) / 10.0).all()


def test_mirrored_pairs_take_the_same_time() -> None:
    rng = np.random.default_rng(4)
    starts = rng.uniform(-300.0, 300.0, (50, 3))
    goals = rng.uniform(-300.0, 300.0, (50, 3))
    mirror = np.array([1.0, -1.0, -1.0])
    times = turn_times_s(starts, goals, Flight(15.0, 50.0, (4.0, 7.0)))
    mirrored = turn_times_s(starts * mirror, goals * mirror, Flight(15.0, 50.0, (4.0, -7.0)))
    assert mirrored == pytest.approx(times, rel=1e-5)


def test_poses_turn_at_the_turn_radius_through_the_air() -> None:
    flight = Flight(20.0, 60.0, (5.0, 8.0))
    path = fastest_path((0.0, 0.0, 1.0), (150.0, -90.0, 4.0), flight)
    at_s = np.linspace(0.0, path.duration_s, 2001)
    poses = path.poses(at_s)
    air = np.diff(poses[:, :2] - np.outer(at_s, flight.wind_m_s), axis=0) / np.diff(at_s)[:, None]
    assert np.hypot(*air.T) == pytest.approx(20.0, rel=1e-3)
    assert np.abs(np.diff(poses[:, 2]) / np.diff(at_s)).max() <= 20.0 / 60.0 * 1.001
    middle = (poses[1:, 2] + poses[:-1, 2]) / 2.0
    assert np.cos(np.arctan2(air[:, 1], air[:, 0]) - middle) == pytest.approx(1.0, abs=1e-3)


def test_wind_as_fast_as_the_vehicle_is_refused() -> None:
    with pytest.raises(ValueError, match="not slower than the airspeed"):
        Flight(20.0, 60.0, (12.0, 16.0))
