"""Changes of altitude compared with small time steps, and with a published example of DAIDALUS."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.daidalus_alerts import State
from benchmarks.daidalus_bands import KINEMATIC, Band, bands_of, levels_of
from mission_service.surveillance.alerting import ALERT_SETS
from mission_service.surveillance.altitude_change import AltitudeChange, VerticalLimits, violates
from mission_service.surveillance.well_clear import Encounter, WellClearVolume
from tests.service.test_well_clear import encounters, violated

STEP_S, HORIZON_S = 0.05, 90.0
CHANGES_M, CLIMBS_M_S = st.floats(-300.0, 300.0), st.floats(-6.0, 6.0)
LIMITS = st.builds(VerticalLimits, st.floats(0.5, 5.0), st.floats(0.3, 3.0))
BOX = WellClearVolume(610.0, 76.0)
LARGER = WellClearVolume(620.0, 78.0)  # so large that no step misses a violation of the box


@settings(max_examples=100, deadline=None)
@given(change_m=CHANGES_M, climb_m_s=CLIMBS_M_S, limits=LIMITS)
def test_a_change_keeps_the_limits_and_ends_level_at_the_altitude(
    change_m: float, climb_m_s: float, limits: VerticalLimits
) -> None:
    change = AltitudeChange(change_m, climb_m_s, limits)
    end_s = change.times_s[2]
    assert change.motion_after(end_s) == pytest.approx((change_m, 0.0), abs=1e-6)
    height_m, speed_m_s = change.motion_after(0.0)
    assert (height_m, speed_m_s) == pytest.approx((0.0, climb_m_s), abs=1e-6)
    for step in range(1, math.ceil(end_s / STEP_S) + 1):
        later_m, later_m_s = change.motion_after(step * STEP_S)
        allowed_m_s = max(limits.rate_m_s, abs(climb_m_s)) + 1e-6
        assert abs(later_m_s) <= allowed_m_s
        assert abs(later_m_s - speed_m_s) <= limits.acceleration_m_s2 * STEP_S + 1e-6
        mean_m_s = (later_m_s + speed_m_s) / 2.0
        assert later_m - height_m == pytest.approx(mean_m_s * STEP_S, abs=STEP_S**2)
        height_m, speed_m_s = later_m, later_m_s


@settings(max_examples=60, deadline=None)
@example(Encounter(0.0, 9000.0, -300.0, 0.0, -45.0, 0.0), -300.0, 0.0, VerticalLimits(1.5, 1.0))
@given(encounter=encounters(), change_m=CHANGES_M, climb_m_s=CLIMBS_M_S, limits=LIMITS)
def test_a_violation_is_found_as_in_small_steps(
    encounter: Encounter, change_m: float, climb_m_s: float, limits: VerticalLimits
) -> None:
    change = AltitudeChange(change_m, climb_m_s, limits)
    x, y, z, vx, vy, vz = encounter
    inside_s = near_s = 0.0
    for step in range(round(HORIZON_S / STEP_S) + 1):
        at_s = step * STEP_S
        up_m, up_m_s = change.motion_after(at_s)
        moved = Encounter(
            *(x + at_s * vx, y + at_s * vy, z + at_s * (vz + climb_m_s) - up_m),
            *(vx, vy, vz + climb_m_s - up_m_s),
        )
        inside_s += STEP_S * violated(moved, BOX)
        near_s += STEP_S * violated(moved, LARGER)
    if violates(encounter, change, climb_m_s, BOX, HORIZON_S, HORIZON_S):
        assert near_s > 0.0
    else:  # while the vertical speed changes, the check is once a second
        assert inside_s <= 1.0 + 2.0 * STEP_S


def test_the_bands_of_the_example_of_daidalus() -> None:
    feet, knots = 0.3048, 1852.0 / 3600.0
    course, own_speed = math.radians(206.0), 151.0 * knots
    own = State(
        *(math.radians(33.95), math.radians(-96.7), 8700.0 * feet),
        *(own_speed * math.sin(course), own_speed * math.cos(course), 0.0),
    )
    other = State(
        *(math.radians(33.86191658), math.radians(-96.73272601), 9000.0 * feet),
        *(0.0, 210.0 * knots, 0.0),
    )
    levels = levels_of(own, other, ALERT_SETS["do_365_en_route"], KINEMATIC)
    assert bands_of(levels) == [Band(100.0, 8500.0, 0), Band(8500.0, 50_000.0, 3)]


def test_an_altitude_that_changes_at_once_does_not_pass_the_altitudes_between() -> None:
    above = Encounter(0.0, 0.0, 100.0, 0.0, 0.0, 0.0)
    far_above = AltitudeChange(300.0, 0.0, VerticalLimits(0.0, 0.0))
    assert far_above.instant
    assert not violates(above, far_above, 0.0, BOX, HORIZON_S, HORIZON_S)
    slow = AltitudeChange(300.0, 0.0, VerticalLimits(2.0, 1.0))
    assert violates(above, slow, 0.0, BOX, HORIZON_S, HORIZON_S)
