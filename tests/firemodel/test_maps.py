"""The map of a fire and its elements."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import (
    draw_map,
    frame_around,
    set_title,
    start_map,
    status_line,
)
from firemodel.outputs.graticule import draw_graticule, km_of
from firemodel.outputs.layer_legends import arrival_layer_of
from tests.firemodel.grids import landscape
from tests.firemodel.test_front_files import fire_round_a_rock

ZERO = datetime(2026, 8, 1, 12, 0, tzinfo=UTC)


def texts(axes: Any) -> list[str]:
    """Return all texts on a map after it is drawn."""
    from matplotlib.text import Text

    axes.figure.canvas.draw()
    return [each.get_text() for each in axes.figure.findobj(Text) if each.get_text()]


def legend_of(axes: Any) -> list[str]:
    from matplotlib.legend import Legend

    (legend,) = axes.figure.findobj(Legend)
    return [each.get_text() for each in legend.get_texts()]


def test_a_map_is_drawn_of_any_fire(tmp_path: Path) -> None:
    fire = fire_round_a_rock()
    land = fire.landscape
    draw_map(tmp_path / "map.png", fire, "costs $x_{$", ZERO)
    assert imread(tmp_path / "map.png").std() > 0.05
    none = np.full(land.shape, np.inf)
    one = none.copy()
    one[3, 4] = 0.0
    for arrival_s in (one, none):
        _, axes = start_map(land, arrival_s, frame_around(land, arrival_s))
        assert "Fuel" in legend_of(axes)
    nowhere = np.array([[np.inf, np.inf]])  # a place too far away for the projection
    assert frame_around(land, one, nowhere) == frame_around(land, one)
    west, east, south, north = frame_around(land, one)
    assert west < 0.135 < east  # the centre of the cell in km
    assert south < 0.495 < north


def test_equal_fires_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        draw_map(tmp_path / name, fire_round_a_rock(), "rock", ZERO)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_map_has_time_area_north_scale_and_a_note() -> None:
    fire = fire_round_a_rock()
    land = fire.landscape
    _, axes = start_map(land, fire.arrival_time_s, frame_around(land, fire.arrival_time_s))
    set_title(axes, "rock", status_line(fire, ZERO))
    area_m2 = fire.front(fire.time_s).area
    found = texts(axes)
    facts = next(each for each in found if "burned: " in each)
    assert facts.startswith("2026-08-01 14:46+00:00, 2.778 h after mission time 0")
    assert f"{area_m2 / 1e4:,.1f} ha ({area_m2 / 4046.8564224:,.0f} acres)" in facts
    assert "no calendar date" in status_line(fire)
    assert {"rock", "N", "200 m"} <= set(found)
    assert any("Not for navigation. EPSG:32616" in each for each in found)


def test_the_legend_has_the_classes_and_the_fuels_on_the_map_and_lies_on_the_page() -> None:
    fire = fire_round_a_rock()
    land = fire.landscape
    frame, layer = frame_around(land, fire.arrival_time_s), arrival_layer_of(fire, ZERO)
    figure, axes = start_map(land, fire.arrival_time_s, frame, layer=layer)
    labels = legend_of(axes)
    assert labels[:2] == ["Arrival of fire", "0–30 min, to 2026-08-01 12:30"]
    assert labels[-3:] == ["Fuel", "grass", "bare ground"]
    from matplotlib.legend import Legend

    figure.canvas.draw()
    (legend,) = figure.findobj(Legend)
    assert figure.bbox.x1 >= legend.get_window_extent().x1 > axes.get_window_extent().x1


@pytest.mark.parametrize(("km", "label"), [(0.3, "0°00.05′E"), (6.0, "0°01′E"), (900.0, "2°00′E")])
def test_the_graticule_has_round_coordinates_at_the_right_places(km: float, label: str) -> None:
    from matplotlib.figure import Figure

    # East of Greenwich and north of the equator, in a zone with a central meridian of 3 degrees
    # east.
    codes = np.full((2, 2), 1, np.int16)
    land = Landscape(
        "EPSG:32631", 166_021.4, km * 1e3, km * 500.0, codes, np.zeros((2, 2), np.float32)
    )
    axes = Figure().add_subplot()
    draw_graticule(axes, land, (0.0, km, 0.0, km))
    axes.figure.canvas.draw()
    labels = [each.get_text() for each in axes.get_xticklabels()]
    found = dict(zip(labels, axes.get_xticks(), strict=True))
    assert label in found
    degrees, minutes = label[:-2].split("°")
    x_km, _ = km_of(land, 0.0, int(degrees) + float(minutes) / 60.0)
    assert found[label] == pytest.approx(x_km, abs=0.002 * km)
    assert 2 <= len(found) <= 8


def test_the_graticule_continues_across_the_antimeridian() -> None:
    from matplotlib.figure import Figure

    land = flat_landscape(200, 200, 30.0, -16.8, 180.0)
    axes = Figure().add_subplot()
    draw_graticule(axes, land, (0.0, 6.0, 0.0, 6.0))
    axes.figure.canvas.draw()
    labels = [each.get_text() for each in axes.get_xticklabels()]
    assert labels == ["179°59′E", "180°00′E", "179°59′W"]
    assert axes.get_xticks()[1] == pytest.approx(3.0, abs=0.05)


def test_isochrones_and_colours_of_a_fire_taken_over_start_with_it() -> None:
    land = landscape(shape=(20, 20))
    row, col = np.indices(land.shape)
    away = np.hypot(row - 10, col - 10)
    arrival_s = np.where(away < 9, 1800.0 + 300.0 * np.maximum(away - 3, 0.0), np.inf)
    _, axes = start_map(land, arrival_s, frame_around(land, arrival_s), isochrones=True)
    (lines,) = (part for part in axes.collections if hasattr(part, "levels"))
    assert lines.levels[0] > 0.5 + 1e-6
    assert legend_of(axes)[1] == "30–35 min"
    at_once = np.where(away < 9, 0.0, np.inf)
    _, axes = start_map(land, at_once, frame_around(land, at_once))
    assert legend_of(axes)[:3] == ["Arrival of fire", "0–1 min", "Fuel"]
