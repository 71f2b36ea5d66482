"""Well clear volumes compared with their definition in small time steps, and alert levels."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.daidalus_alerts import CYLINDER, State, encounter_of
from mission_service.ground_distance import M_PER_FT, M_PER_NMI
from mission_service.surveillance.alerting import (
    ALERT_SETS,
    AlertHistory,
    AlertLevel,
    AlertSet,
)
from mission_service.surveillance.well_clear import Encounter, WellClearVolume, violation

STEP_S, LOOKAHEAD_S = 0.05, 90.0
VOLUMES = [
    WellClearVolume(0.66 * M_PER_NMI, 450.0 * M_PER_FT, 35.0),
    WellClearVolume(M_PER_NMI, 450.0 * M_PER_FT, 35.0, 20.0),
    WellClearVolume(2000.0 * M_PER_FT, 250.0 * M_PER_FT),
]


def violated(encounter: Encounter, volume: WellClearVolume) -> bool:
    """Return whether the definition of the volume holds now."""
    x, y, z, vx, vy, vz = encounter
    square, closing, speed_2 = x * x + y * y, x * vx + y * vy, vx * vx + vy * vy
    dthr_2 = volume.dthr_m**2
    horizontal = square <= dthr_2
    if not horizontal and closing < 0.0 and speed_2 > 0.0:
        tau_s = (dthr_2 - square) / closing
        miss_2 = square - closing * closing / speed_2
        horizontal = miss_2 <= dthr_2 and 0.0 <= tau_s <= volume.tthr_s
    vertical = abs(z) <= volume.zthr_m
    if not vertical and z * vz < 0.0:
        vertical = -z / vz <= volume.tcoa_s
    return horizontal and vertical


def stepped(encounter: Encounter, volume: WellClearVolume) -> tuple[float, float] | None:
    """Return the first violation in steps of ``STEP_S``."""
    x, y, z, vx, vy, vz = encounter
    begin_s = None
    for step in range(round(LOOKAHEAD_S / STEP_S) + 1):
        at_s = step * STEP_S
        moved = Encounter(x + at_s * vx, y + at_s * vy, z + at_s * vz, vx, vy, vz)
        if violated(moved, volume):
            begin_s = at_s if begin_s is None else begin_s
        elif begin_s is not None:
            return begin_s, at_s
    return None if begin_s is None else (begin_s, LOOKAHEAD_S)


@st.composite
def encounters(draw: Callable[..., float]) -> Encounter:
    place = st.floats(-9000.0, 9000.0)
    speed = st.floats(-150.0, 150.0)
    heights, climbs = st.floats(-700.0, 700.0), st.sampled_from([0.0, -8.0, 3.0, 12.0])
    return Encounter(
        *(draw(place), draw(place), draw(heights)), *(draw(speed), draw(speed), draw(climbs))
    )


@settings(max_examples=60, deadline=None)
@given(encounter=encounters(), volume=st.sampled_from(VOLUMES))
def test_the_closed_form_equals_the_definition_in_small_steps(
    encounter: Encounter, volume: WellClearVolume
) -> None:
    found, expected = violation(encounter, volume, LOOKAHEAD_S), stepped(encounter, volume)
    if found is None or expected is None:
        longest_s = max(end - begin for begin, end in filter(None, [found, expected, (0.0, 0.0)]))
        assert longest_s <= 2.0 * STEP_S, "only a violation shorter than the steps is missed"
        return
    assert found[0] == pytest.approx(expected[0], abs=2.0 * STEP_S)
    assert found[1] == pytest.approx(expected[1], abs=2.0 * STEP_S)


def test_an_aircraft_that_stays_beside_violates_all_the_time_or_never() -> None:
    volume = VOLUMES[2]
    assert violation(Encounter(500.0, 0.0, 0.0, 0.0, 0.0, 0.0), volume, 60.0) == (0.0, 60.0)
    assert violation(Encounter(700.0, 0.0, 0.0, 0.0, 0.0, 0.0), volume, 60.0) is None
    assert violation(Encounter(500.0, 0.0, 80.0, 0.0, 0.0, 0.0), volume, 60.0) is None


# The state of DAIDALUS's example program; its gold output contains these times and levels.
def example() -> Encounter:
    knot, track = M_PER_NMI / 3600.0, math.radians(206.0)
    own = State(
        *(math.radians(33.95), math.radians(-96.7), 8700.0 * M_PER_FT),
        *(151.0 * knot * math.sin(track), 151.0 * knot * math.cos(track), 0.0),
    )
    place = (math.radians(33.86191658), math.radians(-96.73272601), 9000.0 * M_PER_FT)
    return encounter_of(own, State(*place, 0.0, 210.0 * knot, 0.0))


@pytest.mark.parametrize(
    ("alerts", "time_s", "level"),
    [
        (ALERT_SETS["do_365_en_route"], 21.02, 3),
        (ALERT_SETS["buffered_en_route"], 19.42, 3),
        (CYLINDER, 5.46, 1),
    ],
)
def test_daidalus_example_has_the_times_and_levels_of_its_gold_output(
    alerts: AlertSet, time_s: float, level: int
) -> None:
    encounter = example()
    for each in alerts.levels:
        found = violation(encounter, each.volume, alerts.lookahead_s)
        assert found is not None
        assert found[0] == pytest.approx(time_s, abs=0.01)
    assert AlertHistory().add_encounter(alerts, encounter, 0) == level


def head_on(in_s: float) -> Encounter:
    """Return an aircraft that reaches the volume of ``ALERTS`` after ``in_s``."""
    return Encounter(100.0 + 50.0 * in_s, 0.0, 0.0, -50.0, 0.0, 0.0)


FAR = head_on(1000.0)
VOLUME = WellClearVolume(100.0, 100.0)
ALERTS = AlertSet((AlertLevel(VOLUME, 30.0, 50.0), AlertLevel(VOLUME, 10.0, 20.0)))


def levels(*encounters: Encounter, step_s: float = 1.0) -> list[int]:
    history = AlertHistory()
    return [
        history.add_encounter(ALERTS, each, round(number * step_s * 1e6))
        for number, each in enumerate(encounters)
    ]


def test_an_alert_rises_at_the_second_of_four_values() -> None:
    assert levels(FAR, head_on(25.0), *[FAR] * 3, *[head_on(25.0)] * 2)[-2:] == [0, 1]
    assert levels(FAR, head_on(25.0), FAR, head_on(25.0)) == [0, 0, 0, 1]


def test_the_first_value_counts_at_once_and_again_after_a_pause() -> None:
    assert levels(head_on(5.0)) == [2]
    assert levels(FAR, head_on(5.0), step_s=6.0) == [0, 2]
    assert levels(FAR, head_on(5.0), step_s=5.0) == [0, 0]


def test_an_alert_persists_four_seconds_and_until_the_early_time() -> None:
    assert levels(FAR, *[head_on(25.0)] * 2, *[FAR] * 5) == [0, 0, 1, 1, 1, 1, 0, 0]
    assert levels(*[head_on(29.0)] * 6, *[head_on(49.0)] * 4) == [1] * 10, "early time in force"
    assert levels(FAR, *[head_on(49.0)] * 4) == [0] * 5
    assert levels(*[head_on(29.0)] * 6, *[head_on(51.0)] * 4)[-1] == 0


def test_a_more_severe_alert_replaces_one_that_persists() -> None:
    assert levels(*[head_on(25.0)] * 2, *[head_on(9.0)] * 2) == [1, 1, 1, 2]


def test_the_time_to_equal_heights_extends_the_volume_of_a_climbing_aircraft() -> None:
    beside = Encounter(500.0, 0.0, 300.0, 0.0, 0.0, -10.0)  # equal heights in 30 s
    assert violation(beside, VOLUMES[1], 90.0) == pytest.approx((10.0, 43.716), abs=1e-3)
    assert violation(beside, VOLUMES[0], 90.0) == pytest.approx((16.284, 43.716), abs=1e-3)
