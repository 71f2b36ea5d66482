"""The duration of the flight home equals that of the best flight found by brute force."""

import math
import random

import pytest

from mission_service.vehicles.way_home import copter_home_s, plane_home_s

TURNS = 1000


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
