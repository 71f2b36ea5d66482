"""The predicted time from the end of the flight home to the touchdown."""

import math

import numpy as np
import pytest

from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import Approach, glide_m
from mission_service.vehicles.landing_time import landing_s

CIRCLE_S = math.tau * 90.0 / 15.0
CALM = (0.0, 0.0)


def approach(height_m: float, length_m: float) -> Approach:
    """Return an approach with course 270 and a loiter beside its eastern end."""
    return Approach(270.0, height_m, np.array([length_m, 90.0]), length_m, np.zeros(2))


FROM_50_M = approach(50.0, glide_m(50.0))


def section(**more: object) -> VehicleSection:
    values = {"name": "a", "home_lat_deg": 36.0, "home_lon_deg": -84.0, "loiter_radius_m": 90.0}
    values |= {"airspeed_m_s": 15.0, "min_airspeed_m_s": 10.0, "max_airspeed_m_s": 18.0}
    return VehicleSection.model_validate({**values, **more})


@pytest.mark.parametrize(
    ("stack", "wind_m_s", "glide_m_s"),
    [
        ("px4", 0.0, 10.0),
        ("px4", 3.0, 7.0),
        ("px4", 9.0, 5.0),  # FW_GND_SPD_MIN
        ("px4", 14.0, 4.0),  # at the maximum airspeed
        ("ardupilot", 0.0, 12.5),
        ("ardupilot", 9.0, 3.5),
        ("ardupilot", 14.0, 3.0),
    ],
)
def test_a_plane_circles_down_and_glides_against_the_wind(
    stack: str, wind_m_s: float, glide_m_s: float
) -> None:
    expected_s = CIRCLE_S + (140.0 - 50.0) / 3.0 + glide_m(50.0) / glide_m_s
    found_s = landing_s(section(stack=stack), FROM_50_M, None, 140.0, (wind_m_s, 0.0))
    assert found_s == pytest.approx(expected_s)


@pytest.mark.parametrize("tailwind_m_s", [0.0, 6.0, -6.0])
def test_a_plane_that_returns_home_flies_to_its_approach_loiter_first(tailwind_m_s: float) -> None:
    plane, wind = section(stack="ardupilot"), (tailwind_m_s, 0.0)
    from_loiter_s = landing_s(plane, FROM_50_M, None, 140.0, wind)
    from_home_s = landing_s(plane, FROM_50_M, (0.0, 90.0), 140.0, wind)
    out_s = glide_m(50.0) / (15.0 + tailwind_m_s)
    assert from_home_s - from_loiter_s == pytest.approx(out_s)


def test_a_plane_below_its_approach_does_not_descend_in_the_loiter() -> None:
    at_approach_s = landing_s(section(), FROM_50_M, None, 50.0, CALM)
    assert landing_s(section(), FROM_50_M, None, 20.0, CALM) == at_approach_s


def test_a_landing_without_a_planned_approach_takes_as_long_as_the_highest_approach() -> None:
    plane, highest = section(), approach(150.0, glide_m(150.0))
    unplanned_s = landing_s(plane, None, (0.0, 90.0), 200.0, CALM)
    assert unplanned_s == pytest.approx(landing_s(plane, highest, (0.0, 90.0), 200.0, CALM))
    vtol = section(kind="vtol")
    assert landing_s(vtol, None, None, 150.0, CALM) < CIRCLE_S + 150.0 + 30.0


def test_a_vtol_descends_vertically_after_its_straight_flight_home() -> None:
    found_s = landing_s(section(kind="vtol"), approach(40.0, 300.0), None, 70.0, (3.0, 4.0))
    assert found_s == pytest.approx(CIRCLE_S + 30.0 / 3.0 + 300.0 / 10.0 + 40.0 / 1.0)


def test_a_multirotor_descends_slowly_near_the_ground() -> None:
    copter = section(kind="copter")
    assert landing_s(copter, None, (0.0, 0.0), 70.0, (8.0, 0.0)) == 60.0 / 1.5 + 10.0 / 0.5
    waits = section(kind="copter", stack="ardupilot")
    assert landing_s(waits, None, (0.0, 0.0), 10.0, CALM) == 20.0 + 5.0
