"""Rasters for other programs: cloud-optimised GeoTIFFs and their QGIS styles."""

from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from rio_cogeo.cogeo import cog_validate

from firemodel.errors import FireModelError
from firemodel.outputs.geotiff import write_raster
from firemodel.outputs.layer_legends import (
    FLAME_LENGTH_LAYER,
    INTENSITY_LAYER,
    PROBABILITY_LAYER,
    SPREAD_RATE_LAYER,
    SPREAD_TOWARD_LAYER,
    STATE_LAYER,
    Layer,
    arrival_layer,
    fuel_layer,
)
from firemodel.outputs.whole_file import whole_file
from firemodel.physics.fuels import FUEL_MODELS, NON_BURNABLE
from tests.firemodel.grids import CRS, landscape

LAND = landscape(shape=(6, 7))
LARGE = landscape(shape=(1030, 600))
ORDERED = (FLAME_LENGTH_LAYER, INTENSITY_LAYER, SPREAD_RATE_LAYER, PROBABILITY_LAYER)
FUEL_LAYER = fuel_layer(np.array([1, 101]))
CODES = (STATE_LAYER, FUEL_LAYER)


def test_a_raster_lies_on_the_grid_with_unit_and_description(tmp_path: Path) -> None:
    values = np.arange(42.0).reshape(6, 7)
    values[2, 3], values[4, 5] = np.nan, np.inf
    write_raster(tmp_path / "flame.tif", values, LAND, FLAME_LENGTH_LAYER)
    with rasterio.open(tmp_path / "flame.tif") as file:
        assert (file.crs.to_string(), file.nodata, file.dtypes) == (CRS, -1.0, ("float32",))
        assert file.transform == LAND.transform()
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert file.units == ("m",)
        assert file.descriptions == (FLAME_LENGTH_LAYER.description,)
        assert np.array_equal(file.read(1), np.where(np.isfinite(values), values, -1.0))


def test_overviews_are_means_of_values_without_cells_that_have_none(tmp_path: Path) -> None:
    values = np.full(LARGE.shape, np.nan)
    values[::2] = 3.0
    write_raster(tmp_path / "flame.tif", values, LARGE, FLAME_LENGTH_LAYER)
    with rasterio.open(tmp_path / "flame.tif", overview_level=0) as file:
        assert file.shape == (515, 300)
        assert np.allclose(file.read(1), 3.0)


def test_overviews_of_directions_hold_only_directions_of_cells(tmp_path: Path) -> None:
    values = np.where(np.indices(LARGE.shape)[1] % 2, 359.0, 1.0)
    write_raster(tmp_path / "toward.tif", values, LARGE, SPREAD_TOWARD_LAYER)
    with rasterio.open(tmp_path / "toward.tif", overview_level=0) as file:
        assert set(np.unique(file.read(1))) <= {1.0, 359.0}


def test_codes_have_a_colour_table_and_overviews_of_the_most_frequent(tmp_path: Path) -> None:
    codes = np.full(LARGE.shape, 101)
    row, col = np.indices((515, 300))
    other = np.random.default_rng(1).integers(4, size=row.shape)  # one of four cells
    codes[2 * row + other // 2, 2 * col + other % 2] = 1
    write_raster(tmp_path / "fuel.tif", codes, LARGE, FUEL_LAYER)
    with rasterio.open(tmp_path / "fuel.tif") as file:
        assert (file.dtypes, file.nodata) == (("uint8",), 255)
        found = file.colormap(1)
        assert np.array_equal(file.read(1), codes)
    for each in FUEL_LAYER.classes:
        assert "#{:02x}{:02x}{:02x}".format(*found[int(each.upto)]) == each.colour
    with rasterio.open(tmp_path / "fuel.tif", overview_level=0) as file:
        assert (file.read(1) == 101).mean() > 0.99


def test_equal_arrays_give_equal_bytes(tmp_path: Path) -> None:
    values = np.random.default_rng(1).random((6, 7))
    for name in ("a", "b"):
        write_raster(tmp_path / f"{name}.tif", values, LAND, PROBABILITY_LAYER)
    for suffix in ("tif", "qml"):
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()


def test_an_array_of_another_shape_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        FireModelError, match=r"x.tif: the values have the shape \(3, 3\), .* \(6, 7\)"
    ):
        write_raster(tmp_path / "x.tif", np.zeros((3, 3)), LAND, PROBABILITY_LAYER)
    assert not list(tmp_path.iterdir())


def test_a_file_is_replaced_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "x.tif"
    path.write_bytes(b"old")

    def write_half() -> None:
        with whole_file(path) as part:
            part.write_bytes(b"half")
            raise OSError("full")

    with pytest.raises(FireModelError, match=r"x.tif: cannot be written: full; use another"):
        write_half()
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"old"]
    with whole_file(path) as part:
        part.write_bytes(b"new")
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"new"]


@pytest.mark.parametrize("layer", [FLAME_LENGTH_LAYER, FUEL_LAYER, SPREAD_TOWARD_LAYER])
def test_large_rasters_are_cloud_optimised_by_an_independent_check(
    tmp_path: Path, layer: Layer
) -> None:
    write_raster(tmp_path / "x.tif", np.ones(LARGE.shape, np.int16), LARGE, layer)
    assert cog_validate(tmp_path / "x.tif", strict=True) == (True, [], [])


@pytest.mark.parametrize("layer", [*ORDERED, SPREAD_TOWARD_LAYER, arrival_layer(0, 7200, None)])
def test_the_style_of_a_range_has_each_class(tmp_path: Path, layer: Layer) -> None:
    write_raster(tmp_path / "x.tif", np.zeros((6, 7)), LAND, layer)
    root = ElementTree.parse(tmp_path / "x.qml").getroot()
    (renderer,) = root.iter("rasterrenderer")
    assert renderer.get("type") == "singlebandpseudocolor"
    (shader,) = root.iter("colorrampshader")
    assert shader.get("colorRampType") == "DISCRETE"
    items = [(float(i.get("value", "")), i.get("color"), i.get("label")) for i in shader]
    assert items == [tuple(each) for each in layer.classes]
    assert all(one[0] < other[0] for one, other in pairwise(items))


@pytest.mark.parametrize("layer", CODES)
def test_the_style_of_codes_has_each_code(tmp_path: Path, layer: Layer) -> None:
    write_raster(tmp_path / "x.tif", np.ones((6, 7), np.int16), LAND, layer)
    root = ElementTree.parse(tmp_path / "x.qml").getroot()
    entries = {int(e.get("value", "")): e.get("color") for e in root.iter("paletteEntry")}
    assert entries == {int(each.upto): each.colour for each in layer.classes}


def test_each_fuel_code_has_its_own_colour() -> None:
    assert [each.upto for each in FUEL_LAYER.classes] == sorted([*FUEL_MODELS, *NON_BURNABLE])
    burnable = [each.colour for each in FUEL_LAYER.classes if each.upto in FUEL_MODELS]
    assert len(set(burnable)) == len(burnable)


@pytest.mark.parametrize(("code", "dtype"), [(21, "uint8"), (300, "uint16")])
def test_custom_fuels_have_colours_too(tmp_path: Path, code: int, dtype: str) -> None:
    codes = np.full(LAND.shape, code)
    layer = fuel_layer(codes)
    assert (code, "custom fuel") in [(each.upto, each.label) for each in layer.classes]
    write_raster(tmp_path / "x.tif", codes, LAND, layer)
    with rasterio.open(tmp_path / "x.tif") as file:
        assert file.dtypes == (dtype,)
        assert np.array_equal(file.read(1), codes)
        assert "#{:02x}{:02x}{:02x}".format(*file.colormap(1)[code]) == "#e8b3cf"


@pytest.mark.parametrize("layer", [*ORDERED, arrival_layer(0, 36000, None)])
def test_classes_darken_so_that_their_order_shows_without_hue(layer: Layer) -> None:
    def luminance(colour: str) -> float:
        red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    shown = [luminance(each.colour) for each in layer.classes]
    assert all(before - after > 2.0 for before, after in pairwise(shown))


@pytest.mark.parametrize(
    ("first_s", "last_s", "labels"),
    [
        (0.0, 0.0, ["0–1 min"]),
        (0.0, 1200.0, ["0–2 min", "2–4 min"]),
        (0.0, 6 * 3600.0, ["0–1 h", "1–2 h"]),
        (3600.0, 3 * 3600.0 + 3600.0, ["1–2 h", "2–3 h"]),
        (0.0, 20 * 3600.0, ["0–2 h", "2–4 h"]),
        (0.0, 30 * 86400.0, ["0–72 h", "72–144 h"]),
    ],
)
def test_arrival_classes_have_round_steps(first_s: float, last_s: float, labels: list[str]) -> None:
    classes = arrival_layer(first_s, last_s, None).classes
    assert [each.label for each in classes[:2]] == labels
    assert len(classes) <= 12
    assert classes[-1].upto >= last_s


def test_a_date_appears_in_description_and_labels() -> None:
    layer = arrival_layer(0.0, 10_800.0, datetime(2026, 8, 1, 23, 0, tzinfo=UTC))
    assert layer.description.endswith("mission time 0, 2026-08-01T23:00:00+00:00")
    assert layer.classes[1].label == "1–2 h, to 2026-08-02 01:00"
    assert "no calendar date" in arrival_layer(0.0, 10_800.0, None).description
