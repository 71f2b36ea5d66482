"""Combinations of processes and runs of ``benchmarks.fire_processes``, on small made-up fires."""

import numpy as np
import pytest
import shapely

from benchmarks.fire_processes import SURFACE, Case, Timed, combinations, outlines
from benchmarks.real_fires import Row

SCENARIO = """name = "flat"
duration_s = 1800
[landscape]
source = "flat"
lat_deg = 36.0
lon_deg = -84.0
rows = 60
cols = 60
cell_size_m = 20
fuel_model = 1
[[weather]]
at_s = 0
wind_speed_m_s = 3
wind_from_deg = 270
dead_1h_pct = 6
dead_10h_pct = 7
dead_100h_pct = 8
live_herb_pct = 60
live_woody_pct = 90
[[ignition]]
lat_deg = 36.0
lon_deg = -84.0
"""


def test_spotting_is_never_without_crown_fire() -> None:
    found = combinations(("scott_reinhardt", "cruz", "spotting", "acceleration", "terrain_wind"))
    assert len(set(found)) == len(found)
    assert all({"scott_reinhardt", "cruz"} & set(each) for each in found if "spotting" in each)
    full = ("scott_reinhardt", "spotting", "acceleration", "terrain_wind")
    for out in full[1:]:
        assert tuple(each for each in full if each != out) in found
    assert ("acceleration", "terrain_wind") in found  # all but crown fire


def test_of_two_winds_only_the_last_is_among_all() -> None:
    found = combinations(("cruz", "terrain_wind", "wind_grids"))
    assert ("terrain_wind",) in found
    assert ("cruz", "wind_grids") in found
    assert not any({"terrain_wind", "wind_grids"} <= set(each) for each in found)


def test_a_run_has_a_front_at_each_time_and_counts_what_burned() -> None:
    plain, later = Timed((), None), Timed(("fire.acceleration=true",), None)
    fronts = plain(SCENARIO, 600.0, "")
    assert [at_s for at_s, _ in fronts] == [600.0, 1200.0, 1800.0]
    areas = [front.area for _, front in fronts]
    assert areas == sorted(areas)
    assert plain.cells * 20.0**2 == pytest.approx(areas[-1], rel=0.05)
    assert later(SCENARIO, 600.0, "")[-1][1].area < areas[-1]


def test_the_median_of_members_without_errors_is_the_fire() -> None:
    names = ("wind_log_sd", "spread_log_sd", "fuel_log_sd", "wind_turn_sd_deg", "moisture_log_sd")
    still = [f"ensemble.{name}=0" for name in (*names, "ignition_sd_m")]
    (_, alone), (_, median) = (
        Timed(still, members)(SCENARIO, 900.0, "")[0] for members in (None, 3)
    )
    assert median.symmetric_difference(alone).area < 1e-3 * alone.area


def test_outlines_are_those_of_the_largest_growth() -> None:
    case = Case(lambda *_: iter(()), ("acceleration",), {})
    squares = [shapely.box(0, 0, side, side) for side in np.arange(1.0, 4.0)]
    plain = [Row(f"{n}", each, squares[0], each) for n, each in enumerate(squares)]
    title, shapes = outlines(case, {SURFACE: plain, "acceleration": plain[::-1]})
    assert title == "2"
    assert shapes["all processes"] is squares[0]
