"""Sunlight: the direction to the sun, slopes, clouds and measurements."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from firemodel.physics.sunlight import (
    clear_sunlight_w_m2,
    measured_share,
    share_below_clouds,
    sun_at,
)

JUNE = datetime(2026, 6, 21, tzinfo=UTC)
DAY_S = 3600.0 * np.arange(24.0)


def test_the_sun_is_where_the_almanac_algorithm_puts_it() -> None:
    """The example is that of Reda & Andreas (2004, NREL/TP-560-34302), 0.0003° exact."""
    begin = datetime(2003, 10, 17, 12, 30, 30, tzinfo=timezone(timedelta(hours=-7)))
    north, east, up = sun_at(39.742476, -105.1786, begin, np.array([0.0])).direction[:, 0]
    assert np.degrees(np.arccos(up)) == pytest.approx(50.11162, abs=0.25)
    assert np.degrees(np.arctan2(east, north)) % 360.0 == pytest.approx(194.34024, abs=0.25)


def test_noon_at_greenwich_is_when_the_sun_is_in_the_south_and_highest() -> None:
    sun = sun_at(51.5, 0.0, JUNE, DAY_S)
    assert int(np.argmax(sun.direction[2])) == 12
    assert sun.direction[0, 12] < 0.0
    assert abs(sun.direction[1, 12]) < 0.02
    assert np.linalg.norm(sun.direction, axis=0) == pytest.approx(np.ones(24))


def test_level_ground_gets_a_kilowatt_at_noon_and_nothing_at_night() -> None:
    light = clear_sunlight_w_m2(sun_at(36.0, 0.0, JUNE, DAY_S), 300.0, 0.0, 0.0)
    assert light[12] == pytest.approx(1000.0, abs=60.0)
    assert light[0] == 0.0
    assert np.all(light >= 0.0)


def test_slopes_get_more_sun_if_they_face_it_and_high_ground_more_than_low() -> None:
    sun = sun_at(45.0, 0.0, JUNE - timedelta(days=90), DAY_S)
    level, south, north, east = (
        clear_sunlight_w_m2(sun, 0.0, *rise)
        for rise in ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, -0.5))
    )
    assert south[12] > level[12] > north[12]
    assert east[8] > level[8] > east[16]
    assert clear_sunlight_w_m2(sun, 2000.0, 0.0, 0.0)[12] > level[12]


def test_clouds_leave_a_quarter_and_measurements_replace_them() -> None:
    assert share_below_clouds(np.array([0.0, 1.0])) == pytest.approx([1.0, 0.25])
    sun = sun_at(36.0, 0.0, JUNE, DAY_S)
    measured_w_m2 = 0.6 * clear_sunlight_w_m2(sun, 300.0, 0.0, 0.0)
    assert measured_share(sun, 300.0, measured_w_m2) == pytest.approx(np.full(24, 0.6))
    dark = sun_at(36.0, 0.0, JUNE, np.array([0.0]))
    assert measured_share(dark, 300.0, np.zeros(1)) == pytest.approx([1.0])
