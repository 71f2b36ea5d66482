"""The predicted time from the arrival over home or its approach loiter to the touchdown."""

import math

import numpy as np
import pytest

from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import Approach, glide_m
from mission_service.vehicles.landing_time import landing_s

FROM_50_M = Approach(270.0, 50.0, np.zeros(2), glide_m(50.0))
CIRCLE_S = math.tau * 90.0 / 15.0


def section(**more: object) -> VehicleSection:
    values = {"name": "a", "home_lat_deg": 36.0, "home_lon_deg": -84.0, "loiter_radius_m": 90.0}
    values |= {"airspeed_m_s": 15.0, "min_airspeed_m_s": 10.0}
    return VehicleSection.model_validate({**values, **more})


@pytest.mark.parametrize(
    ("stack", "wind_m_s", "glide_m_s"),
    [
        ("px4", 0.0, 10.0),
        ("px4", 3.0, 7.0),
        ("px4", 9.0, 5.0),  # FW_GND_SPD_MIN
        ("ardupilot", 0.0, 12.5),
        ("ardupilot", 9.0, 3.5),
        ("ardupilot", 14.0, 3.0),
    ],
)
def test_a_plane_circles_down_and_glides_against_the_wind(
    stack: str, wind_m_s: float, glide_m_s: float
) -> None:
    expected_s = CIRCLE_S + (140.0 - 50.0) / 3.0 + glide_m(50.0) / glide_m_s
    found_s = landing_s(section(stack=stack), FROM_50_M, 140.0, wind_m_s)
    assert found_s == pytest.approx(expected_s)


def test_a_plane_below_its_approach_does_not_descend_in_the_loiter() -> None:
    at_approach_s = landing_s(section(), FROM_50_M, 50.0, 0.0)
    assert landing_s(section(), FROM_50_M, 20.0, 0.0) == at_approach_s


def test_a_landing_without_a_planned_approach_takes_as_long_as_the_highest_approach() -> None:
    highest = Approach(270.0, 150.0, np.zeros(2), glide_m(150.0))
    assert landing_s(section(), None, 200.0, 4.0) == landing_s(section(), highest, 200.0, 4.0)


def test_a_vtol_descends_vertically_after_its_straight_flight_home() -> None:
    approach = Approach(270.0, 40.0, np.zeros(2), 300.0)
    found_s = landing_s(section(kind="vtol"), approach, 70.0, 5.0)
    assert found_s == pytest.approx(CIRCLE_S + 30.0 / 3.0 + 300.0 / 10.0 + 40.0 / 1.0)


def test_a_multirotor_descends_slowly_near_the_ground() -> None:
    copter = section(kind="copter")
    assert landing_s(copter, None, 70.0, 8.0) == 60.0 / 1.5 + 10.0 / 0.5
    assert landing_s(copter, None, 10.0, 8.0) == 20.0
