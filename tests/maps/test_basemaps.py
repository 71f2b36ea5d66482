"""Basemaps: tiles from PMTiles, MBTiles and GeoTIFF files, cut files, and lines of the relief."""

import contextlib
import gzip
import io
import json
import math
import sqlite3
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from affine import Affine
from click.testing import CliRunner
from numpy.typing import NDArray
from PIL import Image
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

from mission_service.cli.main import main
from mission_service.config.scenario import load_scenario
from mission_service.errors import MissionServiceError
from mission_service.fire.scenario_fire import landscape_of
from mission_service.interfaces.maps.basemaps.pack import pack, tiles_in
from mission_service.interfaces.maps.basemaps.relief_lines import (
    drains_to,
    interval_m,
    relief_lines,
)
from mission_service.interfaces.maps.basemaps.tile_files import (
    WORLD_DEG,
    MbtilesFile,
    column_of,
    row_of,
    tile_file,
    tile_files,
)
from mission_service.interfaces.maps.mercator import mercator_of
from mission_service.interfaces.maps.terrain import tile_box

WEST, SOUTH, EAST, NORTH = -84.2, 36.3, -84.1, 36.4
BOX = (WEST, SOUTH, EAST, NORTH)


def vector_pmtiles(path: Path, max_zoom: int = 12) -> Path:
    """Write an archive of tiles that contain their own address instead of a map."""
    header = {
        "tile_type": TileType.MVT,
        "tile_compression": Compression.GZIP,
        "min_lon_e7": round(WEST * 1e7),
        "min_lat_e7": round(SOUTH * 1e7),
        "max_lon_e7": round(EAST * 1e7),
        "max_lat_e7": round(NORTH * 1e7),
        "center_zoom": 10,
        "center_lon_e7": round(WEST * 1e7),
        "center_lat_e7": round(SOUTH * 1e7),
    }
    places = sorted(tiles_in(BOX, 8, max_zoom), key=lambda place: zxy_to_tileid(*place))
    with write(path) as writer:
        for place in places:
            writer.write_tile(zxy_to_tileid(*place), gzip.compress(repr(place).encode(), mtime=0))
        layers = [{"id": "roads", "fields": {}}, {"id": "water", "fields": {}}]
        writer.finalize(header, {"attribution": "© people", "vector_layers": layers})
    return path


def raster_mbtiles(path: Path) -> Path:
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
    database.execute(
        "CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)"
    )
    about = {"format": "png", "bounds": f"{WEST},{SOUTH},{EAST},{NORTH}", "attribution": "© us"}
    database.executemany("INSERT INTO metadata VALUES (?, ?)", about.items())
    rows = [(z, x, 2**z - 1 - y, f"{z}/{x}/{y}".encode()) for z, x, y in tiles_in(BOX, 9, 11)]
    database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    database.commit()
    database.close()
    return path


def geotiff(path: Path, values: NDArray[np.generic], crs: str = "EPSG:32616") -> Path:
    """Write a raster of 30 m from 750 km E, 4 032 km N of zone 16, near Jacksboro."""
    bands, height, width = values.shape
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        count=bands,
        height=height,
        width=width,
        dtype=values.dtype,
        crs=crs,
        transform=Affine(30.0, 0.0, 750_000.0, 0.0, -30.0, 4_032_000.0),
    ) as file:
        file.write(values)
    return path


def test_tiles_are_read_from_every_kind_of_file(tmp_path: Path) -> None:
    vector_pmtiles(tmp_path / "roads.pmtiles")
    raster_mbtiles(tmp_path / "scan.mbtiles")
    geotiff(tmp_path / "photo.tif", np.full((3, 100, 100), 90, np.uint8))
    (tmp_path / "notes.txt").write_text("no basemap")
    found, problems = tile_files(tmp_path)
    assert problems == []
    assert list(found) == ["photo", "roads", "scan"]
    kinds = {name: (each.basemap.kind, each.basemap.storage) for name, each in found.items()}
    assert kinds == {
        "photo": ("raster", "tiles"),
        "roads": ("vector", "pmtiles"),
        "scan": ("raster", "tiles"),
    }
    place = (10, column_of(-84.15, 10), row_of(36.35, 10))
    roads = found["roads"]
    assert roads.is_gzipped
    assert gzip.decompress(roads.tile(*place) or b"") == repr(place).encode()
    assert roads.tile(10, 0, 0) is None
    assert roads.basemap.layers == ("roads", "water")
    assert roads.basemap.bounds == pytest.approx(BOX)
    assert (roads.basemap.min_zoom, roads.basemap.max_zoom) == (8, 12)
    assert found["scan"].tile(*place) == f"{place[0]}/{place[1]}/{place[2]}".encode()
    assert found["scan"].tile(10, 0, 0) is None
    assert found["scan"].basemap.attribution == "© us"


@pytest.mark.parametrize(
    ("described", "layers"),
    [('{"vector_layers": [{"id": "roads"}]}', ("roads",)), ("[]", ()), ("null", ()), ("{", ())],
)
def test_an_mbtiles_file_without_bounds_keeps_its_layers(
    tmp_path: Path, described: str, layers: tuple[str, ...]
) -> None:
    path = raster_mbtiles(tmp_path / "roads.mbtiles")
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE metadata SET value = 'pbf' WHERE name = 'format'")
        database.execute("DELETE FROM metadata WHERE name = 'bounds'")
        database.execute("INSERT INTO metadata VALUES ('json', ?)", (described,))
        database.commit()
    found = tile_file(path)
    assert found.basemap.bounds == WORLD_DEG
    assert found.basemap.layers == layers


def test_the_place_of_a_tile() -> None:
    for lon_deg, lat_deg, zoom in ((-84.15, 36.35, 14), (151.2, -33.86, 9), (0.1, 60.0, 20)):
        west, south, east, north = tile_box(zoom, column_of(lon_deg, zoom), row_of(lat_deg, zoom))
        x_m, y_m = mercator_of(lon_deg, lat_deg)
        assert west <= x_m < east
        assert south < y_m <= north
    assert (column_of(180.0, 3), row_of(-90.0, 3)) == (7, 7)
    assert (column_of(-180.0, 3), row_of(90.0, 3)) == (0, 0)


def pixels_of(data: bytes | None) -> NDArray[np.uint8]:
    assert data is not None
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))


def test_a_raster_is_drawn_where_it_lies(tmp_path: Path) -> None:
    """The western half is black and the eastern half white; both halves meet at 751 500 m E."""
    values = np.zeros((1, 100, 100), np.uint8)
    values[:, :, 50:] = 255
    path = geotiff(tmp_path / "half.tif", values)
    source = tile_file(path)
    degrees = pyproj.Transformer.from_crs("EPSG:32616", "EPSG:4326", always_xy=True)
    west, south, east, north = source.basemap.bounds
    corners = [degrees.transform(e, n) for e in (750_000, 753_000) for n in (4_029_000, 4_032_000)]
    assert (west, east) == pytest.approx((min(corners)[0], max(corners)[0]), abs=1e-6)
    assert south < north
    z = source.basemap.max_zoom
    middle_lon, middle_lat = degrees.transform(751_500, 4_030_500)
    place = (z, column_of(middle_lon, z), row_of(middle_lat, z))
    rgba = pixels_of(source.tile(*place))
    side_deg = 360.0 / 2**z
    meets_px = round(((middle_lon + 180.0) / side_deg - place[1]) * 256)
    row = round(
        ((1 - math.asinh(math.tan(math.radians(middle_lat))) / math.pi) / 2 * 2**z % 1) * 256
    )
    steps = np.abs(np.diff(rgba[min(row, 255), :, 0].astype(int)))
    assert steps[max(meets_px - 3, 0) : meets_px + 3].max() > 150, "both halves meet here"
    whole = pixels_of(source.tile(11, column_of(middle_lon, 11), row_of(middle_lat, 11)))
    opaque = whole[..., 3] > 0
    assert 0.01 < opaque.mean() < 0.5, "the raster fills a part of this tile"
    meets_px = ((middle_lon + 180.0) / 360.0 * 2**11 % 1) * 256
    columns = np.arange(256)[None, :] + 0.5
    assert (whole[..., 0][opaque & (columns < meets_px - 3)] < 60).all()
    assert (whole[..., 0][opaque & (columns > meets_px + 3)] > 195).all()
    assert source.tile(z, 0, 0) is None


def test_high_values_are_stretched_and_palettes_are_used(tmp_path: Path) -> None:
    ramp = np.linspace(0, 4000, 100 * 100).reshape(1, 100, 100).astype(np.uint16)
    source = tile_file(geotiff(tmp_path / "sixteen.tif", ramp))
    rgba = pixels_of(source.tile(11, column_of(-84.2, 11), row_of(36.386, 11)))
    shown = rgba[rgba[..., 3] > 0][:, 0].astype(float)
    quarters = [float(part.mean()) for part in np.array_split(shown, 4)]
    assert quarters[0] < 60
    assert quarters[3] > 195
    assert quarters == sorted(quarters), "the values increase from north to south"
    path = geotiff(tmp_path / "fuel.tif", np.ones((1, 100, 100), np.uint8))
    with rasterio.open(path, "r+") as file:
        file.write_colormap(1, {1: (200, 30, 30)})
    rgba = pixels_of(tile_file(path).tile(11, column_of(-84.2, 11), row_of(36.386, 11)))
    assert np.abs(rgba[rgba[..., 3] > 0][:, :3].mean(axis=0) - (200, 30, 30)).max() < 12


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.pmtiles", b"PMTiles?" * 100, "not a PMTiles version 3 file"),
        ("a.pmtiles", b"", "not a PMTiles version 3 file"),
        ("a.mbtiles", b"no database" * 10, "not an MBTiles file"),
        ("a.tif", b"II*no", "not a readable raster"),
    ],
)
def test_a_file_that_is_no_basemap_is_named(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(content)
    found, problems = tile_files(tmp_path)
    assert found == {}
    assert len(problems) == 1
    assert words in problems[0]
    assert str(tmp_path / name) in problems[0]
    assert "\n" not in problems[0]


def test_a_raster_without_coordinates_is_refused(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(tmp_path / "plain.tif")
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        _, problems = tile_files(tmp_path)
    assert "has no coordinate reference system" in problems[0]


def test_an_area_is_cut_from_each_kind_of_file(tmp_path: Path) -> None:
    sources = [
        vector_pmtiles(tmp_path / "roads.pmtiles"),
        raster_mbtiles(tmp_path / "scan.mbtiles"),
        geotiff(tmp_path / "photo.tif", np.full((3, 100, 100), 90, np.uint8)),
    ]
    out = tmp_path / "packed"
    box = "-84.21,36.35,-84.15,36.395"
    words = ["map", "pack", box, *map(str, sources), "-o", str(out), "--max-zoom", "11", "--json"]
    found = CliRunner().invoke(main, words)
    assert found.exit_code == 0, found.output
    files = json.loads(found.stdout)["files"]
    assert set(files) == {"roads.pmtiles", "scan.pmtiles", "photo.pmtiles"}
    for source in sources:
        packed, whole = tile_file(out / f"{source.stem}.pmtiles"), tile_file(source)
        assert packed.basemap.max_zoom <= 11
        assert packed.basemap.attribution == whole.basemap.attribution
        west, south, east, north = packed.basemap.bounds
        assert west >= -84.2101
        assert east <= -84.1499
        place = (11, column_of((west + east) / 2, 11), row_of((south + north) / 2, 11))
        assert packed.tile(*place) == whole.tile(*place) != None  # noqa: E711
        assert packed.is_gzipped == whole.is_gzipped
    assert tile_file(out / "roads.pmtiles").basemap.layers == ("roads", "water")
    before = (out / "photo.pmtiles").read_bytes()
    assert CliRunner().invoke(main, words).exit_code == 0
    assert (out / "photo.pmtiles").read_bytes() == before, "the same tiles give the same bytes"


def test_an_area_that_cannot_be_cut_is_refused_in_one_line(tmp_path: Path) -> None:
    path = vector_pmtiles(tmp_path / "roads.pmtiles")
    out = tmp_path / "out.pmtiles"
    with pytest.raises(MissionServiceError, match="does not cover the area"):
        pack(tile_file(path), (10.0, 10.0, 11.0, 11.0), out, 12)
    with pytest.raises(MissionServiceError, match="begins at zoom 8"):
        pack(tile_file(path), BOX, out, 7)
    world = MbtilesFile(raster_mbtiles(tmp_path / "scan.mbtiles"))
    world.basemap.bounds, world.basemap.max_zoom = (-180.0, -80.0, 180.0, 80.0), 14
    with pytest.raises(MissionServiceError, match="more than 500000 tiles"):
        pack(world, (-180.0, -80.0, 180.0, 80.0), out, 14)
    assert not list(tmp_path.glob("out*"))
    for box, words in (("1,2,3", "specify WEST,SOUTH"), ("3,1,2,2", "west must be less")):
        found = CliRunner().invoke(main, ["map", "pack", box, str(path), "-o", str(tmp_path / "o")])
        assert found.exit_code == 2
        assert words in found.output


def test_water_drains_down_a_valley_and_out_of_a_pit() -> None:
    y, x = np.mgrid[0:7, 0:9].astype(float)
    heights = 10.0 * np.abs(y - 3.0) - x
    heights[3, 4] = -50.0  # a pit in the valley
    to, order = drains_to(heights)
    assert sorted(order) == list(range(63))
    assert [int(to[3 * 9 + col]) for col in (5, 6, 7)] == [33, 34, 35]
    cell, seen = 3 * 9 + 1, set()
    while to[cell] >= 0:
        assert cell not in seen, "no circles"
        seen.add(cell)
        cell = int(to[cell])
    assert cell == 3 * 9 + 8, "the valley ends at its lower end"


def test_contours_and_drainage_of_the_default_landscape() -> None:
    landscape = landscape_of(load_scenario("default"))
    assert landscape.elevation_m is not None
    found = relief_lines(landscape)["features"]
    contours = [each for each in found if each["properties"]["kind"] == "contour"]
    drainage = [each for each in found if each["properties"]["kind"] == "drainage"]
    assert drainage
    heights = {each["properties"]["height_m"] for each in contours}
    step = interval_m(float(np.ptp(landscape.elevation_m)))
    assert heights == set(np.arange(min(heights), max(heights) + 1, step))
    assert len(heights) <= 30

    def heights_along(feature: dict[str, object]) -> NDArray[np.float64]:
        lon, lat = np.array(feature["geometry"]["coordinates"]).T  # type: ignore[index]
        row, col = landscape.row_col_of(*landscape.xy_of_lat_lon(lat, lon))
        rows, cols = landscape.shape
        at = np.clip(np.rint(row), 0, rows - 1), np.clip(np.rint(col), 0, cols - 1)
        assert landscape.elevation_m is not None
        picked: NDArray[np.float64] = landscape.elevation_m[at[0].astype(int), at[1].astype(int)]
        return picked

    errors = [
        np.abs(heights_along(each) - each["properties"]["height_m"]).mean() for each in contours
    ]
    assert np.mean(errors) < step / 2
    falls = [float(found[0] - found[-1]) for found in map(heights_along, drainage)]
    assert np.mean(np.array(falls) >= -1.0) > 0.9, "lines run downhill"
    assert len(json.dumps(found)) < 300_000
