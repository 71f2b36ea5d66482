"""The conditions under which the wind no longer agrees with that of a plan."""

import pytest

from mission_service.guidance.burn.plan_validity import mean_wind, wind_differs
from tests.service.test_burn_approval import BURN, a_plan


@pytest.mark.parametrize(
    ("wind", "differs"),
    [
        ((2.0, 0.0), False),
        ((3.9, 0.0), False),
        ((4.1, 0.0), True),
        ((2.0, 29.0), False),
        ((2.0, 331.0), False),
        ((2.0, 31.0), True),
        ((2.0, 329.0), True),
        ((0.5, 180.0), True),  # the wind has turned since the plan was made
    ],
)
def test_a_wind_beyond_the_margins_is_another_one(wind: tuple[float, float], differs: bool) -> None:
    assert (wind_differs(a_plan(), wind, BURN) is not None) is differs


def test_the_text_gives_both_winds() -> None:
    words = wind_differs(a_plan(), (6.04, 90.2), BURN)
    assert words == "the wind is 6.0 m/s from 90°, but the plan assumes 2.0 m/s from 0°"


def test_winds_around_north_have_a_mean_in_the_north() -> None:
    speed_m_s, from_deg = mean_wind([(2.0, 350.0), (2.0, 10.0)])
    assert speed_m_s == pytest.approx(2.0 * 0.98480775)
    assert min(from_deg, 360.0 - from_deg) == pytest.approx(0.0, abs=1e-9)
