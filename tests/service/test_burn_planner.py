"""Ignition lines: the scenarios of the paper's section VI, and forbidden plans."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from benchmarks.burn_check import faults
from firemodel.ellipses.ellipse import EllipseFire
from firemodel.ellipses.line_ignitions import line_sources
from mission_service.config.sections import BurnSection
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.burn_unit import ExclusionCircle
from mission_service.guidance.burn.lines.flight_constraints import FlightPoint
from mission_service.guidance.burn.lines.line_flight import fly_line
from mission_service.guidance.burn.lines.line_planner import (
    LinePlan,
    NoPlan,
    Situation,
    constraints_of,
    drop_orders,
    fastest_flight,
    next_line,
)
from mission_service.guidance.burn.plan_validity import plan_problem
from mission_service.guidance.burn.whole_burn import CombinedFires
from tests.service.burns import (
    AREA,
    NO_FIRE,
    SETTINGS,
    SIDE_M,
    SPREADS,
    Formula,
    backing_line,
    lights,
    situation,
    unit,
)

NOTHING = np.empty((0, 3))
SAFE_M, LOW_M = SETTINGS.safe_height_m, SETTINGS.drop_height_m
BACKING = EllipseFire(SPREADS, backing_line())
# The front in the middle of the southern side backs six times as fast as at its ends.
UNEVEN = Formula(lambda x, y: y / (0.01 + 0.05 * np.exp(-np.square((x - SIDE_M / 2.0) / 30.0))))


def planned(
    given: Situation, settings: BurnSection = SETTINGS, sources: np.ndarray[Any, Any] = NOTHING
) -> LinePlan:
    """Return the plan; check it by brute force."""
    plan = next_line(given, settings)
    assert isinstance(plan, LinePlan), plan
    assert faults(plan, given, settings, sources) == []
    return plan


def after(given: Situation, plan: LinePlan) -> Situation:
    """Return the situation after a plan was flown."""
    x, y, height, after_s = plan.path[-1].tolist()
    delay = np.array([0.0, 0.0, plan.begin_s + SETTINGS.ignition_delay_s])
    return replace(
        given,
        area=plan.area_left,
        dropped_m=np.concatenate([given.dropped_m, plan.drops[:, :2]]),
        fire=CombinedFires([given.fire, lights(plan.drops + delay)]),
        at_s=plan.begin_s + after_s,
        x_m=x,
        y_m=y,
        height_m=height,
        spheres=plan.spheres_left,
        battery_s=given.battery_s - after_s,
    )


def over_at_safe_height(plan: LinePlan) -> list[float]:
    """Return the lengths of level legs at the safe height."""
    steps = np.diff(plan.path, axis=0)
    high = np.minimum(plan.path[:-1, 2], plan.path[1:, 2]) >= SAFE_M - 1e-6
    lengths = np.hypot(steps[:, 0], steps[:, 1])[high]
    return [float(length) for length in lengths if length > 0.0]


def test_scenario_1_lines_parallel_to_a_backing_front_and_into_the_wind() -> None:
    now = situation(fire=BACKING)
    first = planned(now, sources=backing_line())
    assert first.drops[:, 1] == pytest.approx(np.full(len(first.drops), 20.0))
    # The line begins at the nearer end; drops are 15 m apart over the whole width less the margin,
    # and the path stays below 15 m.
    assert first.drops[0, 0] < 20.0
    assert np.diff(first.drops[:, 0]) == pytest.approx(np.full(len(first.drops) - 1, 15.0))
    assert len(first.drops) == 19
    assert not len(first.skipped)
    assert not over_at_safe_height(first)
    assert first.path[-1, 2] == SAFE_M
    assert first.path[-1, :2] == pytest.approx(first.drops[-1, :2])
    assert first.min_time_margin_s > SETTINGS.time_margin_s
    # The next line is 20 m farther upwind, and each drop is directly upwind of an earlier one.
    second = planned(after(now, first))
    assert second.drops[:, 1] == pytest.approx(np.full(len(second.drops), 40.0))
    assert sorted(second.drops[:, 0]) == pytest.approx(sorted(first.drops[:, 0]))
    # It begins where the line before ended.
    assert second.drops[0, 0] == pytest.approx(first.drops[-1, 0])


def test_scenario_2_over_the_fire_at_the_safe_height_and_back() -> None:
    now = situation(fire=UNEVEN, at_s=450.0)
    plan = planned(now)
    burned = UNEVEN.ignition_time_s(np.array([[SIDE_M / 2.0, 20.0]]))[0]
    assert burned < 450.0  # the middle of the line has burned
    assert (plan.drops[:, 0] < SIDE_M / 2 - 20.0).sum() >= 5
    assert (plan.drops[:, 0] > SIDE_M / 2 + 20.0).sum() >= 5
    assert len(plan.skipped) >= 3
    (length,) = over_at_safe_height(plan)
    assert length > 40.0
    # The path climbs before the front, crosses it, and descends behind it: 15, 60, 60, 15.
    turn = int(np.argmax(plan.path[:, 2] == SAFE_M))
    assert plan.path[turn - 1 : turn + 3, 2].tolist() == [LOW_M, SAFE_M, SAFE_M, LOW_M]
    assert plan.path[turn, :2] == pytest.approx(plan.path[turn - 1, :2])
    x = plan.path[turn, 0]
    front_m = 450.0 / float(UNEVEN.time_s(np.array([x]), np.array([1.0]))[0])
    assert front_m < 20.0 - SETTINGS.distance_margin_m + 2.0  # the place of the climb is still safe


def test_scenario_2_the_front_that_will_have_come_when_it_gets_there() -> None:
    """At the planning of the second line, the front has not reached it yet."""
    now = situation(fire=UNEVEN, at_s=450.0)
    now = after(now, planned(now))
    middle = np.array([[SIDE_M / 2.0, 40.0]])
    assert UNEVEN.ignition_time_s(middle)[0] > now.at_s
    second = planned(now)
    assert second.line.along_m == pytest.approx(-40.0)
    away = np.abs(second.drops[:, 0] - SIDE_M / 2.0).min()
    assert away > 7.0  # no drop in the middle
    assert len(second.skipped) >= 1


# From the southern side to the north-east, across half of the unit's east.
DIAGONAL = line_sources(np.array([[SIDE_M - 120.0, 0.0], [SIDE_M, 120.0]]), 0.0, 2.0)


def test_scenario_3_lines_between_two_converging_fronts() -> None:
    sources = np.concatenate([backing_line(), DIAGONAL])
    now = situation(fire=EllipseFire(SPREADS, sources), at_s=200.0)
    plan = planned(now, sources=sources)
    assert plan.drops[:, 1] == pytest.approx(np.full(len(plan.drops), 20.0))
    # The diagonal front crosses this line at x = SIDE - 100; fire beyond it moves south.
    assert plan.drops[:, 0].max() < SIDE_M - 100.0 - SETTINGS.distance_margin_m
    # The plan comes near the front: the next place would have been too near.
    assert plan.drops[:, 0].max() > SIDE_M - 100.0 - 40.0
    second = planned(after(now, plan))
    assert second.drops[:, 1] == pytest.approx(np.full(len(second.drops), 40.0))


def test_scenario_4_a_front_added_in_mid_flight() -> None:
    """The first line is interrupted west of a new front; the faster side is chosen."""
    now = situation(fire=BACKING)
    first = planned(now, sources=backing_line())
    half = len(first.drops) // 2
    after_s = float(first.drops[half, 2]) + 1.0
    done = first.drops[: half + 1]
    sources = np.concatenate(
        [
            backing_line(),
            DIAGONAL - np.array([60.0, 0.0, 0.0]),
            done + np.array([0.0, 0.0, first.begin_s + SETTINGS.ignition_delay_s]),
        ]
    )
    x, y = (float(np.interp(after_s, first.path[:, 3], first.path[:, n])) for n in range(2))
    stopped = replace(
        now,
        fire=EllipseFire(SPREADS, sources),
        at_s=first.begin_s + after_s,
        x_m=x,
        y_m=y,
        dropped_m=done[:, :2],
        spheres=now.spheres - len(done),
    )
    plan = planned(stopped, sources=sources)
    assert plan.climbs_first  # directly above its own spheres
    assert plan.path[1, :3] == pytest.approx([x, y, SAFE_M])
    fire = EllipseFire(SPREADS, sources)
    at_drops = fire.ignition_time_s(plan.drops[:, :2]) - plan.begin_s - plan.drops[:, 2]
    assert (at_drops > SETTINGS.time_margin_s).all()
    # The faster of both sides.
    air, start = (
        constraints_of(stopped, SETTINGS),
        FlightPoint(x, y, stopped.height_m, stopped.at_s),
    )
    trips = [
        fly_line(air, start, places, 450, 1e4)
        for places in drop_orders(stopped, SETTINGS, _area_of(stopped, plan), plan.line)
    ]
    assert plan.duration_s == pytest.approx(min(trip.duration_s for trip in trips))
    assert trips[0].duration_s != pytest.approx(trips[1].duration_s)


def _area_of(given: Situation, plan: LinePlan) -> Any:
    """Return the area that remained when a plan's line was computed."""
    downwind = plan.line.along_m + SETTINGS.line_spacing_m
    return shapely.intersection(given.area, shapely.box(0.0, -downwind, SIDE_M, SIDE_M))


def test_burn_complete_after_all_lines() -> None:
    now = situation(fire=BACKING, battery_s=1e6)
    lines = []
    for _ in range(40):
        plan = next_line(now, SETTINGS)
        if isinstance(plan, NoPlan):
            break
        lines.append(-plan.line.along_m)
        now = after(now, plan)
    assert isinstance(plan, NoPlan)
    assert plan.why == "complete"
    assert lines == pytest.approx(np.arange(20.0, 279.0, 20.0))


def test_a_line_that_has_burned_is_cut_off_for_the_next() -> None:
    burned = Formula(lambda x, y: np.where(y < 25.0, 0.0, 1e5))
    plan = planned(situation(fire=burned, at_s=500.0))
    assert plan.lines_cut == 1
    assert plan.line.along_m == pytest.approx(-40.0)
    everywhere = Formula(lambda x, y: np.zeros(len(x)))
    none = next_line(situation(fire=everywhere, at_s=5000.0), SETTINGS)
    assert isinstance(none, NoPlan)
    assert (none.why, none.lines_cut) == ("complete", 14)


def test_drops_stay_off_edges_holes_no_drop_areas_people_and_inside_the_fence() -> None:
    """The unit is concave and has a hole; the rest of the line is planned, each side once."""
    made = unit(
        area=AREA.difference(shapely.box(100.0, 0.0, 130.0, 60.0)).difference(
            shapely.box(40.0, 10.0, 60.0, 30.0)
        ),
        no_drop=shapely.box(150.0, 0.0, 170.0, 40.0),
        people=(ExclusionCircle("chief", 200.0, 20.0, 14.0),),
        fence=shapely.box(10.0, 0.0, SIDE_M - 10.0, SIDE_M),
    )
    plan = planned(situation(unit=made))
    x = plan.drops[:, 0]
    for low, high in ((-1, 10), (35, 65), (95, 135), (145, 175), (186, 214), (274, 999)):
        assert not ((x > low) & (x < high)).any()
    for low, high in ((10, 35), (65, 95), (135, 145), (175, 186), (214, 274)):
        assert ((x >= low) & (x <= high)).any() or high - low < 15


def test_a_place_where_an_earlier_drop_lies_is_none_again() -> None:
    now = situation()
    first = planned(replace(now, spheres=7))
    assert (first.ended, first.spheres_left, len(first.drops)) == ("spheres", 0, 7)
    assert first.area_left is now.area
    rest = planned(replace(after(now, first), spheres=100, at_s=2000.0))
    assert rest.line == first.line
    assert not {round(x) for x in rest.drops[:, 0]} & {round(x) for x in first.drops[:, 0]}
    # No drop at a place where a sphere fell and nothing burns.
    again = planned(replace(now, dropped_m=first.drops[:, :2]))
    assert len(again.drops) == 19 - 7
    assert not {round(x) for x in again.drops[:, 0]} & {round(x) for x in first.drops[:, 0]}
    none = next_line(replace(now, spheres=0), SETTINGS)
    assert isinstance(none, NoPlan)
    assert none.why == "spheres"


def test_the_battery_suffices_for_the_way_home() -> None:
    whole = planned(situation())
    needs_s = whole.duration_s + whole.home_s + SETTINGS.battery_reserve_s
    assert planned(situation(battery_s=needs_s + 1e-6)).ended == ""
    short = planned(situation(battery_s=needs_s - 1.0))
    assert short.ended == "battery"
    assert len(short.drops) == len(whole.drops) - 1
    none = next_line(situation(battery_s=SETTINGS.battery_reserve_s + 30.0), SETTINGS)
    assert isinstance(none, NoPlan)
    assert none.why == "battery"


def test_from_the_ground_up_to_the_drop_height_and_out() -> None:
    plan = planned(situation(height_m=0.0))
    assert plan.path[1, 2] == LOW_M
    assert plan.path[1, 3] == pytest.approx(LOW_M / SETTINGS.climb_m_s)
    outside = planned(situation(height_m=0.0, x_m=-40.0, home_m=(-40.0, 60.0)))
    assert outside.path[1, :3] == pytest.approx([-40.0, 60.0, SAFE_M])
    burning = Formula(lambda x, y: np.full(len(x), 100.0))
    none = next_line(situation(height_m=0.0, fire=burning), SETTINGS)
    assert isinstance(none, NoPlan)
    assert none.why == "danger"


def test_from_the_safe_height_it_comes_down_at_the_first_drop() -> None:
    plan = planned(situation(height_m=SAFE_M))
    assert plan.path[1, 2] == SAFE_M
    assert plan.path[2, :2] == pytest.approx(plan.drops[0, :2])
    sinks_s = (SAFE_M - LOW_M) / SETTINGS.sink_m_s
    assert plan.drops[0, 2] == pytest.approx(plan.path[1, 3] + sinks_s)


def test_a_descent_must_be_safe_all_the_way_down() -> None:
    """Fire reaches the western half in 75 s, which is too soon only at the end of a descent."""
    west = Formula(lambda x, y: np.where(x < 130.0, 60.0 + 95.0, 1e5))
    low = planned(situation(fire=west, height_m=SAFE_M, x_m=20.0, y_m=20.0))
    assert low.drops[:, 0].min() > 130.0


def test_drops_that_would_burn_before_they_ignite_are_skipped() -> None:
    """With a time margin of 0, the ground must still be unburned when the sphere ignites."""
    settings = SETTINGS.model_copy(update={"time_margin_s": 0.0})
    soon = Formula(lambda x, y: np.where(x > 150.0, 60.0 + 75.0, 1e5))
    plan = planned(situation(fire=soon), settings)
    late = plan.drops[:, 2] > 75.0 - settings.ignition_delay_s
    assert plan.drops[late, 0].max(initial=0.0) < 150.0


def test_no_leg_comes_back_over_own_drops() -> None:
    """A dent in the middle of the line makes the path to its other part lead back at low height."""
    dent = shapely.Polygon(
        [(0, 0), (60, 0), (60, 100), (80, 100), (80, 0), (140, 0), (140, 120), (0, 120)]
    )
    plan = planned(situation(unit=unit(area=dent), x_m=20.0, y_m=110.0))
    assert (plan.drops[:, 0] < 60.0).any()
    assert (plan.drops[:, 0] > 80.0).any()


def test_drops_must_not_come_faster_than_may_be() -> None:
    settings = SETTINGS.model_copy(update={"drop_spacing_m": 2.0})
    with pytest.raises(MissionServiceError, match=r"must be at least 2\.5 m at 5 m/s and 120"):
        next_line(situation(), settings)


def test_outside_the_fence_nothing_is_planned() -> None:
    none = next_line(situation(unit=unit(fence=AREA), x_m=-5.0), SETTINGS)
    assert isinstance(none, NoPlan)
    assert none.why == "outside"


def test_the_same_situation_gives_the_same_plan() -> None:
    one, other = (next_line(situation(fire=UNEVEN, at_s=450.0), SETTINGS) for _ in range(2))
    assert isinstance(one, LinePlan)
    assert isinstance(other, LinePlan)
    assert (one.path == other.path).all()
    assert (one.drops == other.drops).all()


def test_of_two_trips_the_faster_unless_it_drops_far_fewer() -> None:
    now = situation()
    air = constraints_of(now, SETTINGS)
    area = now.area
    line = planned(now).line
    left, right = drop_orders(now, SETTINGS, area, line)
    start = FlightPoint(now.x_m, now.y_m, now.height_m, now.at_s)
    slow, fast = (fly_line(air, start, places, 450, 1e4) for places in (left, right))
    assert fastest_flight([slow, fast]) is fast
    fewer = fly_line(air, start, right[:-1], 450, 1e4)
    far_fewer = fly_line(air, start, right[:-4], 450, 1e4)
    assert fastest_flight([slow, fewer]) is fewer
    assert fastest_flight([slow, far_fewer]) is slow
    assert fastest_flight([]) is None


def test_a_plan_holds_until_a_reason_against_it() -> None:
    now = situation(fire=BACKING)
    plan = planned(now, sources=backing_line())
    assert plan_problem(plan, now, SETTINGS) == ""
    half_s = plan.duration_s / 2.0
    half = replace(now, at_s=now.at_s + half_s, battery_s=now.battery_s - half_s)
    assert plan_problem(plan, half, SETTINGS, half_s) == ""
    assert "battery" in plan_problem(plan, replace(half, battery_s=300.0), SETTINGS, half_s)
    assert "spheres" in plan_problem(plan, replace(now, spheres=3), SETTINGS)
    new = line_sources(np.array([[150.0, 0.0], [280.0, 130.0]]), 0.0, 2.0)
    fire = EllipseFire(SPREADS, np.concatenate([backing_line(), new]))
    assert "fire" in plan_problem(plan, replace(half, fire=fire), SETTINGS, half_s)
    person = unit(people=(ExclusionCircle("chief", 250.0, 20.0, 12.0),))
    assert "people" in plan_problem(plan, replace(now, unit=person), SETTINGS)
    assert "no-drop" in plan_problem(plan, replace(now, unit=unit(no_drop=person.area)), SETTINGS)
    fenced = unit(fence=shapely.box(0.0, 0.0, 200.0, SIDE_M))
    assert "fence" in plan_problem(plan, replace(now, unit=fenced), SETTINGS)
    # It begins too late: the backing front is near the line by then.
    assert "fire" in plan_problem(plan, replace(now, at_s=900.0), SETTINGS)


def test_wind_in_the_margin() -> None:
    """A lit line is upwind of the ignition line; with wind it is dangerous from farther away."""
    north = Formula(lambda x, y: np.where(y > 36.0, 100.0, 1e5))
    calm = next_line(situation(fire=north, wind_m_s=0.0), SETTINGS)
    windy = next_line(situation(fire=north, wind_m_s=6.0), SETTINGS)
    assert isinstance(calm, LinePlan)
    assert len(calm.drops) > 0
    assert isinstance(windy, NoPlan)


def test_no_fire_at_all() -> None:
    plan = planned(situation(fire=NO_FIRE))
    assert plan.min_time_margin_s == math.inf
