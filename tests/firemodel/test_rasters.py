"""Landscapes and arrival times are read as written, or refused with a clear error."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.info import describe_rasters
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.layers import layer_of
from firemodel.landscape.readers.rasters import read_arrival, read_landscape
from firemodel.physics.fuels import FUEL_MODELS
from tests.firemodel.grids import CRS, NORTH_M, WEST_M, landscape, write_raster

DATA = Path("/work/shared/data")
FUEL = np.array([[1, 2, 99], [4, 5, 98]], dtype=np.int16)
HEIGHTS = np.array([[10.0, 11.5, 12.0], [13.0, 14.0, 15.0]], dtype=np.float32)
SLOPE_DEG = np.array([[2, 10, 20], [30, 45, 5]], dtype=np.int16)
ASPECT_DEG = np.array([[-1, 0, 90], [180, 270, 225]], dtype=np.int16)
COVER_PCT = np.array([[0, 15, 95], [25, 35, 0]], dtype=np.int16)


def read_two(fuel: Path, elevation: Path) -> Landscape:
    return read_landscape({"fuel": fuel, "elevation": elevation})


def elevation(land: Landscape) -> NDArray[np.float32]:
    assert land.elevation_m is not None
    return land.elevation_m


def test_geotiffs_come_back_as_written(tmp_path: Path) -> None:
    land = landscape(FUEL, HEIGHTS)
    write_raster(tmp_path / "fuel.tif", land.fuel_model)
    write_raster(tmp_path / "dem.tif", HEIGHTS, nodata=-9999.0)
    again = read_two(tmp_path / "fuel.tif", tmp_path / "dem.tif")
    assert again.digest() == land.digest()
    assert [str(a.dtype) for a in (again.fuel_model, elevation(again))] == ["int16", "float32"]


def test_integer_elevation_and_byte_fuel_are_read_too(tmp_path: Path) -> None:
    fuel = write_raster(tmp_path / "fuel.tif", FUEL.astype(np.uint8), nodata=255)
    dem = write_raster(tmp_path / "dem.tif", HEIGHTS.astype(np.int16), nodata=-32768)
    assert elevation(read_two(fuel, dem))[0, 1] == 11.0


@pytest.mark.parametrize("dtype", [np.uint8, np.int8, np.int16])
def test_codes_of_any_type_are_replaced_by_larger_ones(tmp_path: Path, dtype: type) -> None:
    fuel = write_raster(tmp_path / "fuel.tif", np.full((2, 3), 1, dtype=dtype))
    dem = write_raster(tmp_path / "dem.tif", HEIGHTS)
    files = {"fuel": fuel, "elevation": dem}
    custom = {300: FUEL_MODELS[1]}
    land = read_landscape(files, fuel_codes={1: 300}, custom_fuels=custom)
    assert (land.fuel_model == 300).all()
    with pytest.raises(FireModelError, match="-5"):
        read_landscape(files, fuel_codes={1: -5})


def no_file(path: Path) -> Path:
    return path


def text_file(path: Path) -> Path:
    path.write_text("not a raster", encoding="utf-8")
    return path


def changed(band: NDArray[Any] = FUEL, **changes: Any) -> Callable[[Path], Path]:
    return lambda path: write_raster(path, band, **changes)


def with_value(value: float, dtype: Any) -> NDArray[Any]:
    band = FUEL.astype(dtype)
    band[1, 0] = value
    return band


def test_a_file_cut_short_is_refused(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(1, 13, (300, 300)).astype(np.int16)
    path = write_raster(tmp_path / "bad.tif", noise)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(FireModelError, match=r"bad.tif: cannot be read as a raster") as caught:
        read_two(path, path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (no_file, "bad.tif: no such file"),
        (text_file, "bad.tif: cannot be read as a raster"),
        (changed(np.stack([FUEL, FUEL])), "bad.tif: has 2 bands; use a file with one"),
        (changed(crs=None), "bad.tif: has no CRS; assign"),
        (changed(crs="EPSG:4326"), "bad.tif: CRS EPSG:4326 is not a projection in metres"),
        (
            changed(transform=rasterio.Affine(30, 0, WEST_M, 0, 30, NORTH_M)),
            "bad.tif: is not north-up",
        ),
        (
            changed(transform=rasterio.Affine(30, 5, WEST_M, 0, -30, NORTH_M)),
            "bad.tif: is not north-up",
        ),
        (
            changed(transform=rasterio.Affine(30, 0, WEST_M, 0, -25, NORTH_M)),
            "bad.tif: cells are 30.0 x 25.0 m; resample",
        ),
        (
            changed(FUEL.astype(np.float32) + np.float32(0.5)),
            "bad.tif: fuel code .* is not a whole number",
        ),
        (
            changed(with_value(-9999, np.int16), nodata=-9999),
            r"bad.tif: cells without data: value -9999 at row 1, column 0 \(1 such cells\)",
        ),
        (changed(with_value(14, np.int16)), "bad.tif: unknown fuel code 14 at row 1, column 0"),
    ],
)
def test_unusable_fuel_files_are_refused(
    tmp_path: Path, make: Callable[[Path], Path], message: str
) -> None:
    dem = write_raster(tmp_path / "dem.tif", HEIGHTS)
    with pytest.raises(FireModelError, match=message) as caught:
        read_two(make(tmp_path / "bad.tif"), dem)
    assert "\n" not in str(caught.value)
    assert re.match(re.escape(str(tmp_path)), str(caught.value))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            changed(with_value(np.nan, np.float32)),
            r"bad.tif: cells without data: value nan at row 1, column 0",
        ),
        (
            changed(HEIGHTS, crs="EPSG:32617"),
            "bad.tif: CRS EPSG:32617 differs from the CRS EPSG:32616 of",
        ),
        (changed(HEIGHTS[:, :2]), r"bad.tif: shape \(2, 2\) differs from the shape \(2, 3\) of"),
        (
            changed(HEIGHTS, transform=rasterio.Affine(10, 0, WEST_M, 0, -10, NORTH_M)),
            "bad.tif: cell size 10.0 m differs from the 30.0 m of",
        ),
        (
            changed(HEIGHTS, transform=rasterio.Affine(30, 0, WEST_M + 30, 0, -30, NORTH_M)),
            r"bad.tif: corner \(500030.0, 4000000.0\) differs from the corner "
            r"\(500000.0, 4000000.0\) of",
        ),
    ],
)
def test_elevation_that_does_not_fit_is_refused(
    tmp_path: Path, make: Callable[[Path], Path], message: str
) -> None:
    fuel = write_raster(tmp_path / "fuel.tif", FUEL)
    with pytest.raises(FireModelError, match=message):
        read_two(fuel, make(tmp_path / "bad.tif"))


STACK = np.stack([FUEL, HEIGHTS, SLOPE_DEG, ASPECT_DEG, COVER_PCT, FUEL * 0 + 55]).astype(np.int16)
NAMES = ("LC22_F40_230", "LC20_Elev_220", "LC20_SlpD_220", "LC20_Asp_220", "LC22_CC_230", "X_CH_1")


def test_slope_and_aspect_make_the_gradient(tmp_path: Path) -> None:
    """The ground falls towards its aspect: on a slope facing south it rises to the north."""
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", FUEL),
        "elevation": write_raster(tmp_path / "dem.tif", HEIGHTS),
        "slope": write_raster(tmp_path / "slope.tif", SLOPE_DEG),
        "aspect": write_raster(tmp_path / "aspect.tif", ASPECT_DEG),
    }
    for unit, tans in (("degrees", np.tan(np.deg2rad(SLOPE_DEG))), ("percent", SLOPE_DEG / 100)):
        land = read_landscape(files, units={"slope": unit})
        tans = np.where(ASPECT_DEG < 0, 0.0, tans)
        np.testing.assert_allclose(land.slope_tan, tans, rtol=1e-5)
        sloping = tans > 0
        np.testing.assert_allclose(land.aspect_deg[sloping], ASPECT_DEG[sloping], atol=1e-3)
        assert land.gradient[0, 1, 0] > 0.0  # faces south
        np.testing.assert_array_equal(elevation(land), HEIGHTS)
    flat = read_landscape(
        {key: files[key] for key in ("fuel", "slope", "aspect")}, units={"slope": "degrees"}
    )
    assert flat.elevation_m is None


def test_a_stack_is_read_by_its_band_descriptions_or_by_numbers(tmp_path: Path) -> None:
    """LANDFIRE's layer names imply units; with band numbers the units must be given."""
    named = read_landscape(write_raster(tmp_path / "named.tif", STACK, NAMES))
    assert named.canopy_cover is not None
    assert named.canopy_height_m is not None
    np.testing.assert_allclose(named.canopy_cover, COVER_PCT / 100, rtol=1e-6)
    np.testing.assert_allclose(named.canopy_height_m, 5.5, rtol=1e-6)
    bare = write_raster(tmp_path / "bare.tif", STACK)
    order = ("fuel", "elevation", "slope", "aspect", "canopy_cover", "canopy_height")
    files = {layer: (bare, number) for number, layer in enumerate(order, start=1)}
    units = {"slope": "degrees", "canopy_cover": "percent", "canopy_height": "m*10"}
    assert read_landscape(files, units=units).digest() == named.digest()
    for layer, choices in (("slope", "degrees, percent"), ("canopy_height", r"m, m\*10, ft")):
        others = {key: unit for key, unit in units.items() if key != layer}
        message = (
            rf"bare.tif band \d: the unit of {layer} is unknown; specify it .* as one of {choices}"
        )
        with pytest.raises(FireModelError, match=message):
            read_landscape(files, units=others)
    with pytest.raises(FireModelError, match=r"bare.tif: no band's description names a layer"):
        read_landscape(bare)
    twice = write_raster(tmp_path / "twice.tif", STACK[:2], ("LC22_F40_230", "LC22_F13_230"))
    with pytest.raises(FireModelError, match=r"bands 1 and 2 are both fuel; select one"):
        read_landscape(twice)


@pytest.mark.parametrize(
    ("description", "found"),
    [
        ("US_220SLPD", ("slope", "degrees")),
        ("LC20_SlpP_220", ("slope", "percent")),
        ("Fuel models", ("fuel", "")),
        ("Canopy base height", ("canopy_base", "")),
        ("US_200CBH", ("canopy_base", "m*10")),
        ("LC22_CBD_230", ("canopy_bulk_density", "kg/m3*100")),
        ("Slope", ("slope", "")),
        ("percent cover of ash", ("", "")),
    ],
)
def test_band_descriptions_name_layers(description: str, found: tuple[str, str]) -> None:
    assert layer_of(description) == found


def lcp(tmp_path: Path, fuel: NDArray[np.int16] = FUEL, **options: str) -> Path:
    """Return a small .lcp as GDAL writes it: elevation, slope, aspect, fuel and canopy."""
    base = write_raster(
        tmp_path / "stack.tif",
        np.stack([HEIGHTS, SLOPE_DEG, ASPECT_DEG, fuel, COVER_PCT, *(FUEL * 0 + 30,) * 3]).astype(
            np.int16
        ),
    )
    from rasterio.shutil import copy

    units = {"ELEVATION_UNIT": "METERS", "SLOPE_UNIT": "PERCENT", "ASPECT_UNIT": "AZIMUTH_DEGREES"}
    units |= {"FUEL_MODEL_OPTION": "NO_CUSTOM_AND_NO_FILE", "CANOPY_COV_UNIT": "PERCENT"}
    units |= {"CANOPY_HT_UNIT": "METERS_X_10", "CBH_UNIT": "METERS_X_10", "LATITUDE": "36"}
    copy(base, tmp_path / "land.lcp", driver="LCP", **{**units, **options})
    return tmp_path / "land.lcp"


def test_an_lcp_declares_its_own_units(tmp_path: Path) -> None:
    land = read_landscape(lcp(tmp_path))
    np.testing.assert_array_equal(land.fuel_model, FUEL)
    np.testing.assert_allclose(land.slope_tan[1], SLOPE_DEG[1] / 100, rtol=1e-5)
    assert land.canopy_height_m is not None
    np.testing.assert_allclose(land.canopy_height_m, 3.0, rtol=1e-6)
    with pytest.raises(
        FireModelError, match=r"land.lcp band 4: cells without data: value -9999 at row 1"
    ):
        read_landscape(lcp(tmp_path, fuel=with_gap(FUEL, 1, 1)))
    feet = read_landscape(lcp(tmp_path, ELEVATION_UNIT="FEET", SLOPE_UNIT="DEGREES"))
    np.testing.assert_allclose(elevation(feet), np.floor(HEIGHTS) * 0.3048, rtol=1e-6)
    np.testing.assert_allclose(feet.slope_tan[1, 1], 1.0, rtol=1e-6)


def test_cover_classes_become_the_middle_of_their_class(tmp_path: Path) -> None:
    classes = np.array([[0, 1, 2], [3, 4, 0]], dtype=np.uint8)
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", FUEL),
        "elevation": write_raster(tmp_path / "dem.tif", HEIGHTS),
        "canopy_cover": write_raster(tmp_path / "cover.tif", classes),
    }
    cover = read_landscape(files, units={"canopy_cover": "class"}).canopy_cover
    assert cover is not None
    np.testing.assert_allclose(cover, [[0, 0.105, 0.355], [0.655, 0.905, 0]], rtol=1e-6)
    with pytest.raises(FireModelError, match=r"units` \(canopy_cover = ...\) as one of percent"):
        read_landscape(files)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ASPECT_UNIT": "GRASS_DEGREES"}, r"land.lcp band 3: unit 'Grass degrees' of aspect is"),
        (
            {"FUEL_MODEL_OPTION": "CUSTOM_AND_FILE"},
            r"land.lcp band 4: .* conversion file",
        ),
        ({"LINEAR_UNIT": "FOOT"}, r"land.lcp: its cells are in Feet"),
    ],
)
def test_lcp_headers_that_cannot_be_used_are_refused(
    tmp_path: Path, options: dict[str, str], message: str
) -> None:
    with pytest.raises(FireModelError, match=message):
        read_landscape(lcp(tmp_path, FUEL, **options))


def ascii_grid(path: Path, values: NDArray[Any], nodata: float = -9999.0) -> Path:
    head = f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcorner {WEST_M}\n"
    head += f"yllcorner {NORTH_M - 30 * values.shape[0]}\ncellsize 30\nNODATA_value {nodata}\n"
    np.savetxt(path, values, fmt="%g", header=head.rstrip(), comments="")
    return path


def test_ascii_grids_are_read_with_a_crs_file_or_a_given_crs(tmp_path: Path) -> None:
    fuel = ascii_grid(tmp_path / "fuel.asc", FUEL)
    dem = ascii_grid(tmp_path / "dem.asc", HEIGHTS)
    with pytest.raises(FireModelError, match=r"fuel.asc: has no CRS; .* or specify it as `crs`"):
        read_two(fuel, dem)
    expected = landscape(FUEL, HEIGHTS).digest()
    files = {"fuel": fuel, "elevation": dem}
    assert read_landscape(files, crs=CRS).digest() == expected
    for name in ("fuel", "dem"):
        (tmp_path / f"{name}.prj").write_text(rasterio.CRS.from_string(CRS).to_wkt())
    assert read_landscape(files).digest() == expected
    with pytest.raises(
        FireModelError, match=r"CRS EPSG:32616 differs from EPSG:32633, specified as `crs`"
    ):
        read_landscape(files, crs="EPSG:32633")
    with pytest.raises(
        FireModelError, match=r"fuel.asc: specified as `crs`: CRS 'nowhere' is invalid"
    ):
        read_landscape(files, crs="nowhere")
    broken = ascii_grid(tmp_path / "fuel.asc", FUEL + 0.5)
    with pytest.raises(FireModelError, match=r"fuel code 1.5 at row 0, column 0 .* whole number"):
        read_two(broken, dem)
    fuel.write_text(fuel.read_text()[:-12])
    with pytest.raises(FireModelError, match=r"fuel.asc: cannot be read as a raster"):
        read_two(fuel, dem)


def with_gap(values: NDArray[Any], row: int, col: int) -> NDArray[Any]:
    changed = values.copy()
    changed[row, col] = -9999
    return changed


def test_cells_without_a_value_can_be_taken_as_bare_ground(tmp_path: Path) -> None:
    aspect_deg = ASPECT_DEG.astype(np.float32)
    aspect_deg[0, 0] = np.nan
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", with_gap(FUEL, 0, 0), nodata=-9999),
        "elevation": write_raster(tmp_path / "dem.tif", with_gap(HEIGHTS, 0, 1), nodata=-9999),
        "slope": write_raster(tmp_path / "slope.tif", with_gap(SLOPE_DEG, 1, 0), nodata=-9999),
        "aspect": write_raster(tmp_path / "aspect.tif", aspect_deg),
        "canopy_cover": write_raster(tmp_path / "cc.tif", with_gap(COVER_PCT, 1, 1)),
    }
    units = {"slope": "degrees", "canopy_cover": "percent"}
    with pytest.raises(
        FireModelError, match=r'fuel.tif: cells without data: .* \(missing = "unburnable"\)'
    ):
        read_landscape(files, units=units)
    with pytest.raises(FireModelError, match=r"cc.tif: canopy_cover is -9999 at row 1, column 1"):
        read_landscape(files, units=units, missing="unburnable")
    land = read_landscape(files, units=units, missing="unburnable", nodata=-9999)
    np.testing.assert_array_equal(land.fuel_model, [[99, 99, 99], [99, 99, 98]])
    assert elevation(land)[0, 1] in (10.0, 12.0, 14.0)
    assert land.slope_tan[1, 0] == land.slope_tan[0, 0] == 0.0
    assert land.canopy_cover is not None
    assert land.canopy_cover[1, 1] == 0.0
    assert land.canopy_cover[0, 2] == pytest.approx(0.95)
    empty = write_raster(tmp_path / "empty.tif", FUEL * 0 - 1, nodata=-1)
    with pytest.raises(FireModelError, match=r"no cell has a value"):
        read_landscape({**files, "fuel": empty}, units=units, missing="unburnable", nodata=-9999)


def test_gentle_ground_without_an_aspect_stays_fuel(tmp_path: Path) -> None:
    """Level ground has no aspect; above 5 degrees a cell without one has a missing value."""
    slope = np.array([[0, 5, 20], [5, 0, 6]], dtype=np.int16)
    aspect = np.array([[-9999, -9999, 90], [-1, 45, 180]], dtype=np.int16)
    codes = np.array([[1, 2, 99], [4, 5, 8]], dtype=np.int16)
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", codes),
        "slope": write_raster(tmp_path / "slope.tif", slope),
        "aspect": write_raster(tmp_path / "aspect.tif", aspect, nodata=-9999),
    }
    land = read_landscape(files, units={"slope": "degrees"})
    np.testing.assert_array_equal(land.fuel_model, codes)
    assert land.slope_tan[0].tolist() == [0.0, 0.0, pytest.approx(np.tan(np.deg2rad(20)))]
    assert land.slope_tan[1, 0] == 0.0
    (note,) = describe_rasters(files, units={"slope": "degrees"})["notes"]
    assert "3 cells without an aspect are level ground" in note
    write_raster(files["slope"], np.where(slope == 5, 6, slope).astype(np.int16))
    with pytest.raises(
        FireModelError, match=r"aspect.tif: cells without data: value -9999 at row 0, col.* 1"
    ):
        read_landscape(files, units={"slope": "degrees"})
    bare = read_landscape(files, units={"slope": "degrees"}, missing="unburnable")
    assert bare.fuel_model.tolist() == [[1, 99, 99], [4, 5, 8]]


def test_a_slope_beyond_90_degrees_can_be_bare_ground(tmp_path: Path) -> None:
    slope = np.array([[0, 108, 20], [5, 0, 6]], dtype=np.int16)
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", np.full_like(slope, 4)),
        "slope": write_raster(tmp_path / "slope.tif", slope),
        "aspect": write_raster(tmp_path / "aspect.tif", slope * 0),
    }
    with pytest.raises(FireModelError, match=r'slope is 108 .* bare ground \(missing = "unburn'):
        read_landscape(files, units={"slope": "degrees"})
    bare = read_landscape(files, units={"slope": "degrees"}, missing="unburnable")
    assert bare.fuel_model.tolist() == [[4, 99, 4], [4, 4, 4]]
    assert bare.slope_tan[0, 1] == 0.0


def test_nodata_values_beyond_the_types_of_a_landscape(tmp_path: Path) -> None:
    codes, heights = FUEL.astype(np.uint16), HEIGHTS.astype(np.float64)
    codes[0, 0], heights[0, 1] = 65535, -1.7e308
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", codes, nodata=65535),
        "elevation": write_raster(tmp_path / "dem.tif", heights, nodata=-1.7e308),
    }
    land = read_landscape(files, missing="unburnable")
    np.testing.assert_array_equal(land.fuel_model, [[99, 99, 99], [4, 5, 98]])
    assert elevation(land)[0, 1] in (10.0, 12.0, 14.0)


def test_a_mask_inside_the_file_counts_as_no_data(tmp_path: Path) -> None:
    fuel = write_raster(tmp_path / "fuel.tif", FUEL)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(fuel, "r+") as file:
        file.write_mask(np.array([[1, 1, 1], [1, 0, 1]], dtype=np.bool_))
    with pytest.raises(
        FireModelError, match=r"fuel.tif: cells without data: value 5 at row 1, column 1"
    ):
        read_two(fuel, write_raster(tmp_path / "dem.tif", HEIGHTS))


@pytest.mark.parametrize(
    ("layer", "row_1_col_2", "unit", "message"),
    [
        ("elevation", 9500, "", "elevation is 9500 at row 1, column 2 .* from -9000 to 9000"),
        ("slope", 90, "degrees", r"slope is 90 at row 1, column 2 .* in degrees .* 0 to 89.9"),
        ("aspect", 361, "", "aspect is 361 at row 1, column 2"),
        ("aspect", -2, "", "aspect is -2 at row 1, column 2"),
        ("canopy_cover", 101, "percent", "canopy_cover is 101 at row 1, column 2 .* 0 to 100"),
        ("canopy_cover", 5, "class", "canopy_cover is 5 at row 1, column 2 .* from 0 to 4"),
        ("canopy_height", 150, "m", "canopy_height is 150 .* from 0 to 120: .* another unit"),
        ("canopy_base", 400, "ft", "canopy_base is 400 at row 1, column 2 .* 0 to 393.7"),
        ("slope", 3, "gradians", "unit 'gradians' of slope is unknown; .* degrees, percent"),
    ],
)
def test_values_that_cannot_be_are_refused(
    tmp_path: Path, layer: str, row_1_col_2: int, unit: str, message: str
) -> None:
    values = np.zeros((2, 3), dtype=np.int16)
    files = {"fuel": write_raster(tmp_path / "fuel.tif", FUEL)}
    for name in ("elevation", "slope", "aspect", layer):
        files[name] = write_raster(tmp_path / f"{name}.tif", values)
    values[1, 2] = row_1_col_2
    write_raster(files[layer], values)
    units = {"slope": "degrees", **({layer: unit} if unit else {})}
    with pytest.raises(FireModelError, match=message) as caught:
        read_landscape(files, units=units)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(files[layer]))


def test_what_is_asked_for_wrongly_is_refused(tmp_path: Path) -> None:
    fuel = write_raster(tmp_path / "fuel.tif", FUEL)
    dem = write_raster(tmp_path / "dem.tif", HEIGHTS)
    scaled = write_raster(tmp_path / "scaled.tif", HEIGHTS)
    with rasterio.open(scaled, "r+") as file:
        file.scales = (0.1,)
    cases: list[tuple[Mapping[str, Any], str]] = [
        ({"fuel": fuel, "dem": dem}, "layer 'dem' is unknown; the layers are fuel, elevation"),
        ({"elevation": dem}, "the fuel layer is missing"),
        ({"fuel": fuel}, "elevation, slope and aspect are missing"),
        ({"fuel": fuel, "slope": dem}, "only one of slope and aspect"),
        ({"fuel": (fuel, 2), "elevation": dem}, "fuel.tif: has no band 2; its bands are 1 to 1"),
        ({"fuel": fuel, "elevation": scaled}, "scaled.tif: values have scale 0.1 and offset 0.0"),
    ]
    for files, message in cases:
        with pytest.raises(FireModelError, match=message):
            read_landscape(files)


def test_a_landscape_of_the_southern_hemisphere(tmp_path: Path) -> None:
    """The landscape is in UTM zone 55 south, in the east of Australia."""
    grid = rasterio.Affine(30, 0, 600_000.0, 0, -30, 6_100_000.0)
    files = {
        "fuel": write_raster(tmp_path / "f.tif", FUEL, crs="EPSG:32755", transform=grid),
        "elevation": write_raster(tmp_path / "d.tif", HEIGHTS, crs="EPSG:32755", transform=grid),
    }
    land = read_landscape(files)
    lat_deg, lon_deg = land.lat_lon_of(600_000.0, 6_100_000.0)
    assert (lat_deg, lon_deg) == (pytest.approx(-35.23, abs=0.01), pytest.approx(148.10, abs=0.01))


def test_arrival_times_come_in_seconds(tmp_path: Path) -> None:
    land = landscape(FUEL, HEIGHTS)
    minutes = np.array([[0.0, 1.5, -9999.0], [2.0, np.nan, 60.0]], dtype=np.float32)
    path = write_raster(tmp_path / "arrival.tif", minutes, nodata=-9999.0)
    expected = np.array([[0.0, 90.0, np.inf], [120.0, np.inf, 3600.0]])
    np.testing.assert_array_equal(read_arrival(path, land, unit="minutes"), expected)
    np.testing.assert_array_equal(read_arrival(path, land), expected / 60.0)
    plain = ascii_grid(tmp_path / "arrival.asc", minutes[:, :1])
    narrow = landscape(FUEL[:, :1], HEIGHTS[:, :1])
    with pytest.raises(FireModelError, match=r"arrival.asc: has no CRS"):
        read_arrival(plain, narrow)
    np.testing.assert_array_equal(read_arrival(plain, narrow, crs=CRS, unit="days")[1, 0], 172800.0)


def test_arrival_times_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    land = landscape(FUEL, HEIGHTS)
    values = np.array([[0.0, 1.5, -9999.0], [2.0, 3.0, 60.0]], dtype=np.float32)
    undeclared = write_raster(tmp_path / "undeclared.tif", values)
    message = r"undeclared.tif: arrival is -9999.0 at row 0, column 2 .* declare it as nodata"
    with pytest.raises(FireModelError, match=message):
        read_arrival(undeclared, land)
    assert read_arrival(undeclared, land, nodata=-9999.0)[0, 2] == np.inf
    nothing = write_raster(tmp_path / "nothing.tif", values * np.nan)
    with pytest.raises(FireModelError, match=r"nothing.tif: no cell has a value"):
        read_arrival(nothing, land)
    with pytest.raises(
        FireModelError, match=r"shape \(2, 3\) differs from the shape \(41, 41\) of the land"
    ):
        read_arrival(undeclared, landscape())
    with pytest.raises(FireModelError, match=r"unit 'weeks' must be one of seconds, minutes"):
        read_arrival(undeclared, land, unit="weeks")  # type: ignore[arg-type]


@pytest.mark.skipif(not DATA.is_dir(), reason="no real data")
def test_real_slope_and_aspect_agree_with_real_elevation() -> None:
    """LANDFIRE's slope and aspect of the Maria fire are compared with Horn's from the elevation."""
    names = ("fuel", "elevation", "slope", "aspect")
    files = {name: DATA / f"maria_2019/Maria2019-{name}.tif" for name in names}
    given = read_landscape(files, units={"slope": "degrees"})
    own = read_two(files["fuel"], files["elevation"])
    for axis in (0, 1):
        found = np.corrcoef(given.gradient[axis].ravel(), own.gradient[axis].ravel())[0, 1]
        assert found > 0.99


@pytest.mark.skipif(not DATA.is_dir(), reason="no real data")
def test_a_real_lcp_and_its_arrival_times() -> None:
    """The files are FARSITE's flat landscape; its last cell burns after 419.9 minutes."""
    flat = DATA / "farsite_flatland"
    land = read_landscape(flat / "Inputs/a_lcpFiles/flatland.lcp")
    assert land.shape == (100, 100)
    assert set(np.unique(land.fuel_model)) == {1}
    arrival = flat / "Outputs/flatland_centerIgnit_3mph0deg7hr_RAWS_ArrivalTime.asc"
    arrival_s = read_arrival(arrival, land, unit="minutes", crs=land.crs)
    assert arrival_s[np.isfinite(arrival_s)].max() == pytest.approx(419.856 * 60, abs=0.01)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.where(np.eye(41), 4e8, 60.0), "is 400000000.0 at row 0, column 0 .* 10 years"),
        (np.add.outer(np.arange(41) ** 2.0, np.arange(41.0)), "proportional to the elevation"),
        (np.add.outer(np.arange(41.0), np.arange(41.0)) / 10.0, "spreads at 300 m/s"),
    ],
)
def test_rasters_of_other_values_are_no_arrival_times(
    tmp_path: Path, values: NDArray[np.float64], message: str
) -> None:
    heights = 3.0 * np.add.outer(np.arange(41) ** 2.0, np.arange(41.0)) + 200.0
    land = landscape(np.ones((41, 41), np.int16), heights)
    path = write_raster(tmp_path / "other.tif", values.astype(np.float32))
    with pytest.raises(FireModelError, match=rf"other.tif: .*{message}"):
        read_arrival(path, land)
