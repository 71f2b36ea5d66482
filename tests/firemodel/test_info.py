"""Descriptions of files list their contents and all problems."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from shapely.geometry import Point, mapping

from firemodel.errors import FireModelError
from firemodel.landscape.info import describe, describe_rasters, describe_shapes, in_text
from firemodel.landscape.readers.rasters import read_landscape
from tests.firemodel.grids import CRS, NORTH_M, WEST_M, landscape, write_raster

FUEL = np.array([[1, 1, 99, 101], [98, 102, 2, 1]], dtype=np.int16)
HEIGHTS = np.linspace(10.0, 17.0, 8, dtype=np.float32).reshape(2, 4)


def test_the_centre_of_a_raster_across_the_antimeridian(tmp_path: Path) -> None:
    path = tmp_path / "fuel.tif"
    place = {
        "crs": "EPSG:32701",
        "transform": rasterio.Affine(30.0, 0.0, 177_000.0, 0.0, -30.0, 8e6),
    }
    size = {"height": 200, "width": 200, "count": 1, "dtype": "int16"}
    with rasterio.open(path, "w", driver="GTiff", **size, **place) as file:
        file.write(np.full((1, 200, 200), 1, np.int16))
    found = describe(path)
    _, west, _, east = found["extent"]
    assert west > 179.0
    assert east < -179.0
    (centre,) = re.findall(r"centre (\S+)", in_text(found))
    assert abs(float(centre.split(",")[1])) == pytest.approx(180.0, abs=0.05)


def test_what_is_in_a_single_raster(tmp_path: Path) -> None:
    """Two of eight cells do not burn; the extent is that of UTM 16 at 87 W."""
    path = write_raster(tmp_path / "fuel.tif", FUEL, nodata=-9999)
    found = describe(path)
    assert found["problems"] == []
    assert (found["kind"], found["crs"], found["rows"], found["cols"]) == ("raster", CRS, 2, 4)
    assert found["cell_size"] == 30.0
    south, west, north, east = found["extent"]
    land = landscape(FUEL)
    lat_deg, lon_deg = land.lat_lon_of(WEST_M, NORTH_M)
    assert (north, west) == (pytest.approx(lat_deg, abs=1e-6), pytest.approx(lon_deg, abs=1e-6))
    assert (north - south) * 111_000 == pytest.approx(60.0, abs=1.0)
    assert (east - west) * 111_320 * np.cos(np.deg2rad(north)) == pytest.approx(120.0, abs=1.0)
    (band,) = found["bands"]
    assert (band["layer"], band["dtype"], band["nodata"]) == ("", "int16", -9999)
    assert (band["least"], band["most"], band["no_data_cells"]) == (1, 102, 0)
    assert band["fuels"][0] == (1, "short grass", 37.5)
    assert [code for code, _, _ in band["fuels"]] == [1, 2, 98, 99, 101, 102]
    assert band["non_burnable_pct"] == 25.0
    text = in_text(found)
    assert "if these are fuel codes" in text
    assert "37.5 % short grass" in text
    centre_deg = re.search(r"centre (-?[\d.]+),(-?[\d.]+)", text)
    assert centre_deg is not None
    expected_deg = pytest.approx(((south + north) / 2, (west + east) / 2), abs=1e-5)
    assert tuple(map(float, centre_deg.groups())) == expected_deg
    assert text.endswith("no problems")
    assert "fuels" not in describe(write_raster(tmp_path / "dem.tif", HEIGHTS))["bands"][0]


def broken_files(tmp_path: Path) -> dict[str, Path]:
    codes, heights, slope = FUEL.copy(), HEIGHTS.copy(), np.zeros((3, 4), dtype=np.int16)
    codes[0, 1], heights[1, 2], slope[2, 0] = 14, -9999.0, -9999
    return {
        "fuel": write_raster(tmp_path / "fuel.tif", codes),
        "elevation": write_raster(tmp_path / "dem.tif", heights, crs="EPSG:32617", nodata=-9999),
        "slope": write_raster(tmp_path / "slope.tif", slope),
        "aspect": write_raster(tmp_path / "aspect.tif", FUEL * 4, crs=None),
        "canopy_cover": tmp_path / "none.tif",
    }


def test_all_problems_are_reported_and_not_only_the_first(tmp_path: Path) -> None:
    """Each problem is one line; after correcting all of them the landscape can be read."""
    files = broken_files(tmp_path)
    problems = describe_rasters(files)["problems"]
    expected = [
        "none.tif: no such file",
        "dem.tif: CRS EPSG:32617 differs from the CRS EPSG:32616 of",
        "slope.tif: shape (3, 4) differs from the shape (2, 4) of",
        "aspect.tif: has no CRS",
        "fuel.tif: unknown fuel code 14 at row 0, column 1",
        "dem.tif: cells without data: value -9999.0 at row 1, column 2",
        "slope.tif: the unit of slope is unknown",
        "aspect.tif: aspect is 396 at row 0, column 2",
    ]
    assert len(problems) == len(expected)
    for problem, start in zip(problems, expected, strict=True):
        assert problem.startswith(f"{tmp_path}/{start}")
        assert "\n" not in problem
    assert in_text(describe_rasters(files)).count("  problem: ") == len(expected)
    with pytest.raises(FireModelError) as caught:
        read_landscape(files)
    assert str(caught.value) in problems


def test_a_good_landscape_has_no_problems_and_is_read(tmp_path: Path) -> None:
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", FUEL),
        "elevation": write_raster(tmp_path / "dem.tif", HEIGHTS),
    }
    assert describe_rasters(files)["problems"] == []
    assert read_landscape(files).shape == (2, 4)
    only_fuel = describe_rasters({"fuel": files["fuel"]})["problems"]
    assert only_fuel == [
        "landscape: elevation, slope and aspect are missing; specify the elevation, or slope and "
        "aspect"
    ]


def stack(path: Path, names: tuple[str, ...]) -> Path:
    bands: NDArray[np.int16] = np.stack([FUEL, HEIGHTS.astype(np.int16), FUEL * 0 - 9999])
    return write_raster(path, bands, names)


def test_a_stack_is_described_by_its_band_names(tmp_path: Path) -> None:
    found = describe(stack(tmp_path / "a.tif", ("LC22_F40_230", "LC20_Elev_220", "LC20_SlpP_220")))
    layers = [(band["layer"], band["unit"]) for band in found["bands"]]
    assert layers == [("fuel", ""), ("elevation", "m"), ("slope", "percent")]
    assert any("only one of slope and aspect" in problem for problem in found["problems"])
    assert any("band 3: slope is -9999 at" in problem for problem in found["problems"])
    unnamed = describe(stack(tmp_path / "b.tif", ()))
    assert "no band's description names a layer" in unnamed["problems"][0]
    assert (
        "b.tif band 3: -9999 at row 0, column 0 (8 such cells) probably means no data"
        in unnamed["problems"][1]
    )
    assert len(describe(tmp_path / "b.tif", nodata=-9999)["problems"]) == 1


def test_what_is_in_shapes_and_all_their_problems(tmp_path: Path) -> None:
    land = landscape()
    lat_deg, lon_deg = land.lat_lon_of(*land.xy_of(20, 20))
    geometries = [
        mapping(Point(lon_deg, lat_deg)),
        None,
        mapping(Point(lon_deg + 1, lat_deg)),
        {"type": "LineString", "coordinates": [[lon_deg, lat_deg], [lon_deg, 95.0]]},
    ]
    features = [{"type": "Feature", "properties": {}, "geometry": one} for one in geometries]
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    found = describe(path)
    assert (found["kind"], found["features"]) == ("shapes", 4)
    assert found["types"] == {"Point": 2, "empty": 1, "LineString": 1}
    assert found["extent"][:2] == pytest.approx((lat_deg, lon_deg))
    assert [problem.split(": ")[1].split()[1] for problem in found["problems"]] == ["2", "4"]
    on_land = describe_shapes(path, landscape=land)["problems"]
    assert [problem.split(": ")[1].split()[1] for problem in on_land] == ["2", "3", "4"]
    assert "4 features: 2 Point, 1 empty, 1 LineString" in in_text(found)


def test_files_of_no_known_kind(tmp_path: Path) -> None:
    path = tmp_path / "notes.xyz"
    path.write_text("nothing of the kind")
    found = describe(path)
    assert found["kind"] == "unknown"
    assert [problem.split(" (")[0] for problem in found["problems"]] == [
        f"{path}: cannot be read as a raster",
        f"{path}: cannot be read as shapes",
    ]
    assert describe(tmp_path / "none.tif")["problems"] == [f"{tmp_path}/none.tif: no such file"]
    damaged = write_raster(tmp_path / "bad.tif", np.random.default_rng(0).normal(size=(99, 99)))
    damaged.write_bytes(damaged.read_bytes()[:3000])
    assert "bad.tif: cannot be read as a raster" in describe(damaged)["problems"][0]


def test_degrees_are_described_although_they_are_refused(tmp_path: Path) -> None:
    grid = rasterio.Affine(0.001, 0, 150.0, 0, -0.001, -33.0)
    found = describe(write_raster(tmp_path / "a.tif", FUEL, crs="EPSG:4326", transform=grid))
    assert found["extent"] == pytest.approx((-33.002, 150.0, -33.0, 150.004))
    assert "EPSG:4326 is not a projection in metres" in found["problems"][0]


def test_notes_on_the_ground_the_codes_and_ignored_bands(tmp_path: Path) -> None:
    """The plane rises to the east at 20 %; its slope is declared as degrees, its aspect as east."""
    heights = np.tile(np.arange(10.0) * 6.0, (8, 1))
    layers = {
        "fuel": np.where(heights > 30.0, 0, 1),
        "elevation": heights,
        "slope": np.full_like(heights, 20.0),
        "aspect": np.full_like(heights, 90.0),
    }
    bands = np.stack([*layers.values(), heights]).astype(np.int16)
    path = write_raster(tmp_path / "a.tif", bands, (*layers, "bulk density"))
    found = describe_rasters(path, units={"slope": "degrees"})
    assert found["problems"] == []
    ignored, code_0, steep, uphill = found["notes"]
    assert ignored.endswith("a.tif band 5: a run ignores this band (bulk density)")
    assert "fuel code 0 (no fuel, 40.0 %) is read as bare ground (99)" in code_0
    assert "slopes are 1.8 times those computed from the elevation" in steep
    assert "aspect points uphill" in uphill
    assert "  note: " in in_text(found)
    bands[3] = 270
    found = describe_rasters(write_raster(path, bands, (*layers, "x")), units={"slope": "percent"})
    assert len(found["notes"]) == 2


def test_tables_of_weather_and_fuels_are_described(tmp_path: Path) -> None:
    raws = "RAWS_UNITS: English\nRAWS: 1\n2016 7 15 2200 77 25 0 10 0 25\n"
    head = "FARSITE INPUTS FILE VERSION 1.0\nFARSITE_START_TIME: 7 15 2200\n"
    for name, text, expected in (
        ("a.raws", raws, ["1 records from 2016-07-15T22:00", "wind at 20 ft from 4.5 to 4.5 m/s"]),
        ("a.wnd", "7 15 0 5 270 0\n", ["note: read with its daily weather: path = a.wtr"]),
        ("a.fms", "0 3 4 6 70 100\n", ["moisture of all other fuels: 3/4/6/70/100 %"]),
        ("a.adj", "1 0.5\n20 2\n", ["fuel 1: factor 0.5", "[20] need landscape.custom_fuels"]),
        ("a.fmd", "20 1 1 1 1 1 2000 1800 1500 1 25 8000 8000\n", ["20 static custom 20, depth 1"]),
        ("a.fmd", "20 1\n", ["problem: ", "line 1: 2 fields"]),
        ("a.csv", "x,y\n1,2\n", ["problem: ", "column 'x' is unknown"]),
        (
            "a.input",
            head + "FARSITE_END_TIME: 7 16 0400\nCROWN: 1\n" + raws,
            ["duration_s = 21600 (6 h)", "a run ignores CROWN", "unless weather_file.conditioned"],
        ),
    ):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        found = describe(path)
        shown = in_text(found)
        json.dumps(found)
        for part in expected:
            assert part in shown
        assert bool(found["problems"]) == ("problem: " in expected)


def test_a_note_on_codes_of_another_system_in_an_unnamed_band(tmp_path: Path) -> None:
    path = write_raster(tmp_path / "fuels.tif", np.array([[1, 2], [3, 4]], dtype=np.int16))
    table = "grid_value,fuel_type\n1,PCH1\n2,PCH2\n"
    (tmp_path / "kitral_lookup_table.csv").write_text(table, encoding="utf-8")
    (note,) = describe(path)["notes"]
    assert note.startswith("if these are fuel codes: ")
    assert "system Kitral (Chile)" in note


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.wnd", "", "a.wnd: contains no wind; add at least one line"),
        ("a.wnd", "7 15 0 5 270 0\n7 15 12\n", "a.wnd line 2: 3 fields; required are month"),
        ("a.wnd", "7 15 0 x 270 0\n", "a.wnd line 1: wind speed is 'x'"),
        ("a.wnd", "7 15 0 5 270 0\n7 14 0 5 270 0\n", "a.wnd line 2: not later than the previous"),
        ("a.adj", "# nothing\n", "a.adj: contains no factor; add a line"),
        ("a.adj", "1 0.5\n1 0.7\n", "a.adj line 2: fuel code 1 occurs twice in the file"),
        (
            "a.raws",
            "RAWS_UNITS: English\nRAWS: 2\n2016 7 15 2200 77 25 0 10 0 25\n",
            "a.raws line 2: RAWS = 2, but the file has 1 of these records; it is",
        ),
    ],
)
def test_damaged_tables_are_problems(tmp_path: Path, name: str, text: str, problem: str) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    (found,) = describe(path)["problems"]
    assert problem in found


def test_a_huge_raster_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """The file declares 200,000 x 200,000 cells, but contains none."""
    path = tmp_path / "huge.tif"
    size = {"width": 200_000, "height": 200_000, "count": 1, "dtype": "uint8"}
    blocks = {"tiled": True, "blockxsize": 8192, "blockysize": 8192, "sparse_ok": True}
    place = rasterio.Affine(30.0, 0.0, WEST_M, 0.0, -30.0, NORTH_M)
    with rasterio.open(path, "w", driver="GTiff", crs=CRS, transform=place, **size, **blocks):
        pass
    (problem,) = describe(path)["problems"]
    assert "has 200000 x 200000 = 40,000,000,000 cells, more than 250,000,000; crop it" in problem
    with pytest.raises(FireModelError, match="40,000,000,000 cells"):
        read_landscape({"fuel": path, "elevation": path})


@pytest.mark.parametrize("size_m", [1e300, 1e-9])
def test_impossible_cell_sizes_are_problems(tmp_path: Path, size_m: float) -> None:
    place = rasterio.Affine(size_m, 0.0, WEST_M, 0.0, -size_m, NORTH_M)
    path = write_raster(tmp_path / "fuel.tif", FUEL, transform=place)
    (problem,) = describe(path)["problems"]
    assert f"fuel.tif: cells are {size_m:g} m, but must be 0.01 to 1000000 m" in problem
