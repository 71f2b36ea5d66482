"""The duration of the flight home equals that of the best flight found by brute force."""

import math
import random

import pytest

from autopilot_bridge.stacks.return_flight import PX4_CLIMB_RADIUS_M, PX4_CLIMB_WITHIN_M
from mission_service.config.scenario import load_scenario
from mission_service.vehicles.endurance import GRAVITY_M_S2, ReturnPerformance, return_s
from mission_service.vehicles.way_home import circle_climb, copter_home_s, plane_home_s

TURNS = 1000
# Returns of a plane at 15 m/s with a bank limit of 50 degrees in the simulator of PX4 1.17 (SIH):
# home relative to the plane, its velocity, the velocity of the air (each x, y), the climb, and the
# time until it was over home.
FLOWN = (
    ((-1029.0, 40.0), (-7.2, 12.8), (-0.0, -0.0), 9.0, 69.8),
    ((-470.0, -558.0), (11.9, -9.4), (0.0, 0.0), 41.0, 58.8),
    ((449.0, -659.0), (8.7, -12.4), (0.0, 0.0), 69.0, 77.8),
    ((1204.0, -59.0), (4.0, 3.6), (-7.7, -6.4), 70.0, 232.8),
    ((-951.0, -780.0), (2.3, -4.4), (-5.0, 8.7), 50.0, 133.6),
    ((-283.0, 383.0), (3.6, 6.1), (-9.4, -3.4), 34.0, 39.9),
    ((-504.0, -713.0), (-1.9, -6.3), (9.4, 3.4), 9.0, 149.4),
    ((-862.0, -199.0), (3.3, 10.5), (1.0, -5.9), 98.0, 90.4),
    ((295.0, -646.0), (4.8, 11.5), (-6.0, -0.0), 50.0, 70.0),
    ((210.0, -750.0), (3.3, 21.6), (1.0, 5.9), 30.0, 88.9),
    ((452.0, 484.0), (-12.5, -8.3), (0.0, -0.0), 90.0, 79.7),
    ((-433.0, -766.0), (7.9, -3.9), (-6.4, -7.7), 94.0, 70.5),
    ((921.0, 14.0), (-3.5, -19.7), (2.1, -5.6), 14.0, 67.9),
    ((785.0, 669.0), (-3.0, 3.7), (9.4, -3.4), 20.0, 65.9),
)
TURN_RADIUS_M = 15.0**2 / (GRAVITY_M_S2 * math.tan(math.radians(50.0)))
PERFORMANCE = ReturnPerformance(15.0, 3.0, 2.5, TURN_RADIUS_M)


def brute_force_s(
    home: tuple[float, float],
    heading_rad: float,
    wind: tuple[float, float],
    speed: float,
    radius: float,
) -> float:
    """Try many turns to each side, each followed by a straight flight over the ground."""

    def ray(side: float, turned: float) -> tuple[float, float, float]:
        """Return the time of the turn, and how far the straight flight passes beside home."""
        after_s = turned * radius / speed
        course = heading_rad + side * turned
        x = side * radius * (math.sin(course) - math.sin(heading_rad)) + wind[0] * after_s
        y = side * radius * (math.cos(heading_rad) - math.cos(course)) + wind[1] * after_s
        east = speed * math.cos(course) + wind[0]
        north = speed * math.sin(course) + wind[1]
        left = (home[0] - x, home[1] - y)
        along_s = (left[0] * east + left[1] * north) / (east**2 + north**2)
        return after_s, along_s, left[0] * north - left[1] * east

    best = math.inf
    for side in (1.0, -1.0):
        for number in range(TURNS):
            low, high = math.tau * number / TURNS, math.tau * (number + 1) / TURNS
            left_of_home = ray(side, low)[2] > 0.0
            if left_of_home == (ray(side, high)[2] > 0.0):
                continue
            for _ in range(40):
                middle = (low + high) / 2.0
                if (ray(side, middle)[2] > 0.0) == left_of_home:
                    low = middle
                else:
                    high = middle
            after_s, along_s, _ = ray(side, high)
            if along_s > 0.0:
                best = min(best, after_s + along_s)
    return best


def test_it_equals_a_brute_force_search_within_one_percent() -> None:
    chance = random.Random(5)
    infinite = 0
    for _ in range(150):
        speed, radius = chance.uniform(10.0, 25.0), chance.uniform(30.0, 120.0)
        distance, bearing = chance.uniform(6.0, 60.0) * radius, chance.uniform(0.0, math.tau)
        home = (distance * math.cos(bearing), distance * math.sin(bearing))
        blows, toward = chance.uniform(0.0, 1.6) * speed, chance.uniform(0.0, math.tau)
        wind = (blows * math.cos(toward), blows * math.sin(toward))
        heading = chance.uniform(0.0, math.tau)
        ahead = (math.cos(heading), math.sin(heading))
        found = plane_home_s(home, ahead, wind, speed, radius)
        expected = brute_force_s(home, heading, wind, speed, radius)
        assert found == pytest.approx(expected, rel=0.01), (home, heading, wind, speed, radius)
        infinite += math.isinf(found)
    assert 20 < infinite < 100


@pytest.mark.parametrize("away_m", [500.0, 20_000.0])
def test_no_plane_gets_home_against_a_wind_as_fast_as_its_airspeed(away_m: float) -> None:
    assert math.isinf(plane_home_s((away_m, 0.0), (1.0, 0.0), (-18.0, 0.0), 18.0, 60.0))
    assert math.isinf(plane_home_s((away_m, 0.0), (1.0, 0.0), (-25.0, 0.0), 18.0, 60.0))
    with_wind_s = plane_home_s((away_m, 0.0), (1.0, 0.0), (25.0, 0.0), 18.0, 60.0)
    assert with_wind_s == pytest.approx(away_m / 43.0)


def test_calm_the_turn_and_the_line_are_added() -> None:
    # Half a turn to the left from an eastward course ends 120 m north of the start.
    back_s = plane_home_s((-1000.0, 120.0), (18.0, 0.0), (0.0, 0.0), 18.0, 60.0)
    assert back_s == pytest.approx((math.pi * 60.0 + 1000.0) / 18.0)
    ahead_s = plane_home_s((1800.0, 0.0), (18.0, 0.0), (0.0, 0.0), 18.0, 60.0)
    assert ahead_s == pytest.approx(100.0)
    assert plane_home_s((0.0, 0.0), (18.0, 0.0), (0.0, 0.0), 18.0, 60.0) == 0.0


def test_a_copter_keeps_its_ground_speed_as_far_as_its_airspeed_permits() -> None:
    chance = random.Random(6)
    for _ in range(200):
        wind = (chance.uniform(-12.0, 12.0), chance.uniform(-12.0, 12.0))
        found = copter_home_s((1000.0, 0.0), wind, 8.0, 15.0)
        # Search the fastest speed along the line whose airspeed is permitted.
        speeds = [number / 200.0 for number in range(1, 1601)]
        able = [each for each in speeds if math.hypot(each - wind[0], wind[1]) <= 15.0]
        if not able:
            assert found > 1000.0 / 0.01
        elif max(able) > 0.5:
            assert found == pytest.approx(1000.0 / max(able), rel=0.01)


def test_returns_of_px4_planes_that_climb_first_are_predicted() -> None:
    section = load_scenario("default").vehicles[0]
    assert (section.stack, section.kind) == ("px4", "plane")
    errors = []
    for home_m, over_ground_m_s, wind_m_s, climb_m, flown_s in FLOWN:
        found_s = return_s(section, PERFORMANCE, home_m, over_ground_m_s, wind_m_s, climb_m)
        errors.append(abs(found_s / flown_s - 1.0))
    assert sum(errors) / len(errors) < 0.02
    assert max(errors) < 0.05


@pytest.mark.parametrize("wind", [(0.0, 0.0), (6.0, -4.0), (0.0, 12.0)])
def test_a_climb_in_a_circle_ends_near_its_centre(wind: tuple[float, float]) -> None:
    for climb_s in (1.0, 20.0, 60.0):
        end = circle_climb((15.0, 0.0), wind, 15.0, 30.0, climb_s)
        assert climb_s <= end.after_s <= climb_s + 60.0
        assert math.hypot(*end.place_m) <= PX4_CLIMB_WITHIN_M
        assert math.hypot(*end.through_air_m_s) == pytest.approx(15.0)
    if wind == (0.0, 0.0):  # clockwise on the circle
        assert math.hypot(*end.place_m) == pytest.approx(PX4_CLIMB_RADIUS_M, abs=8.0)
        (x_m, y_m), (east_m_s, north_m_s) = end.place_m, end.through_air_m_s
        assert x_m * north_m_s - y_m * east_m_s < -0.9 * PX4_CLIMB_RADIUS_M * 15.0


def test_a_climb_in_a_wind_that_carries_the_plane_away_does_not_end() -> None:
    assert math.isinf(circle_climb((15.0, 0.0), (30.0, 0.0), 15.0, 30.0, 60.0).after_s)
