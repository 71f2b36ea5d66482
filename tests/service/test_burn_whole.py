"""A burn to its end: loads, times, spheres, and the fire at the times of a slider."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks.burn_check import faults
from benchmarks.ignition_plans import trial
from firemodel.ellipses.ellipse import EllipseFire
from mission_service.guidance.burn.burn_report import (
    burn_json,
    burn_totals,
    burned_areas,
    draw_burn,
    slider_times_s,
)
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.whole_burn import BurnLine, WholeBurn, whole_burn
from tests.service.burns import (
    AREA,
    NO_FIRE,
    SETTINGS,
    SPREADS,
    backing_line,
    lights,
    situation,
    unit,
)

SMALL = shapely.box(0.0, 0.0, 120.0, 90.0)


@pytest.fixture(scope="module")
def burn() -> WholeBurn:
    """Return the burn with loads of 16 spheres."""
    settings = SETTINGS.model_copy(update={"spheres": 16})
    now = situation(unit=_small(), fire=EllipseFire(SPREADS, backing_line()), spheres=16)
    return whole_burn(now, settings)


def _small() -> BurnUnit:
    return unit(area=SMALL)


def test_all_lines_to_the_end(burn: WholeBurn) -> None:
    assert burn.ended.why == "complete"
    along = [-line.plan.line.along_m for line in burn.lines]
    assert sorted(set(np.round(along, 6))) == [20.0, 40.0, 60.0, 80.0]
    figures = burn_totals(burn, SMALL)
    assert figures["spheres"] == 4 * 7
    assert figures["skipped"] == 0
    assert (figures["lines"], figures["flights"]) == (4, 4)


def test_loads_are_filled_at_home_between_lines(burn: WholeBurn) -> None:
    """16 spheres are two lines of 7: one reload, and no line is interrupted."""
    assert [line.load for line in burn.lines] == [1, 1, 2, 2]
    assert burn.loads == 2
    second, third = burn.lines[1], burn.lines[2]
    x, y, height, _ = second.plan.path[-1]
    home_s = np.hypot(x - 20.0, y - 60.0) / SETTINGS.speed_m_s + height / SETTINGS.sink_m_s
    assert third.plan.begin_s == pytest.approx(second.end_s + home_s + SETTINGS.reload_s)
    assert third.plan.path[0, :3].tolist() == [20.0, 60.0, 0.0]
    assert burn.lines[1].plan.begin_s == pytest.approx(burn.lines[0].end_s)
    used = dict.fromkeys((1, 2), 0)
    for line in burn.lines:
        used[line.load] += len(line.plan.drops)
    assert max(used.values()) <= 16


def test_each_line_is_planned_on_the_fire_of_those_before() -> None:
    """The plan of the last line is valid for a fire that is computed here from all drops."""
    now = situation(unit=_small(), fire=NO_FIRE)
    found = whole_burn(now, SETTINGS)
    *before, last = found.lines
    lit = np.concatenate(
        [
            line.plan.drops + np.array([0.0, 0.0, line.plan.begin_s + SETTINGS.ignition_delay_s])
            for line in before
        ]
    )
    x, y, height, _ = last.plan.path[0].tolist()
    then = situation(
        unit=_small(), fire=lights(lit), x_m=x, y_m=y, height_m=height, at_s=last.plan.begin_s
    )
    assert faults(last.plan, then, SETTINGS, lit) == []
    places = last.plan.drops[:, :2] - np.array([0.0, 15.0])
    assert found.fire.ignition_time_s(places) == pytest.approx(
        np.minimum(lights(lit).ignition_time_s(places), _of(last).ignition_time_s(places))
    )


def _of(line: BurnLine) -> EllipseFire:
    delay_s = line.plan.begin_s + SETTINGS.ignition_delay_s
    return lights(line.plan.drops + np.array([0.0, 0.0, delay_s]))


def test_fronts_on_the_slider_grow(burn: WholeBurn) -> None:
    times = slider_times_s(burn, 7)
    found = burned_areas(burn, SMALL, times)
    areas = [front.area for front in found]
    assert areas == sorted(areas)
    assert all(front.is_valid for front in found)
    at = np.array([[60.0, 30.0], [30.0, 5.0], [110.0, 85.0]])
    burns = burn.fire.ignition_time_s(at)
    for time_s, front in zip(times, found, strict=True):
        inside = shapely.covers(front, shapely.points(at))
        sure = np.abs(burns - time_s) > 300.0
        assert (inside == (burns <= time_s))[sure].all()


def test_json_and_picture(burn: WholeBurn, tmp_path: Path) -> None:
    report = json.loads(json.dumps(burn_json(burn, SMALL, slider_times_s(burn, 3))))
    assert len(report["lines"]) == 4
    assert report["assumptions"]["ignition_delay_s"] == 30.0
    assert len(report["fronts"]) == 3
    totals = report["totals"]
    assert totals["unit_acres"] == pytest.approx(totals["unit_ha"] * 2.47105, abs=0.01)
    assert totals["flown_ft"] == pytest.approx(totals["flown_m"] / 0.3048, abs=1.0)
    assert totals["lines_chains"] == pytest.approx(4 * 90 / 20.1168, abs=0.1)
    draw_burn(tmp_path / "burn.png", burn, SMALL, "a burn")
    assert (tmp_path / "burn.png").stat().st_size > 20_000


def test_a_battery_that_suffices_for_nothing_ends_it() -> None:
    settings = SETTINGS.model_copy(update={"battery_s": 280.0})
    found = whole_burn(situation(battery_s=280.0), settings)
    assert not found.lines
    assert found.ended.why == "battery"
    assert found.area_left.equals(AREA)


def test_random_burns_by_brute_force() -> None:
    """As benchmarks.ignition_plans does for thousands of burns."""
    plans = 0
    for seed in range(12):
        found, counts, _ = trial(seed)
        assert found == [], seed
        plans += counts["plans"]
    assert plans > 10
