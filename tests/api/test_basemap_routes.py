"""The routes of basemaps: the list, ranges of archives, tiles, and lines of the relief."""

from pathlib import Path

import httpx
import numpy as np
import pytest

from mission_service.config.scenario import load_run
from mission_service.config.service_section import HttpSection, ServiceSection
from mission_service.errors import ScenarioError
from tests.api.test_routes import asked
from tests.api.worlds import scenario_of, world_in
from tests.maps.test_basemaps import geotiff, raster_mbtiles, vector_pmtiles

V1 = "/api/v1"


def test_basemaps_are_listed_and_read(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    archive = vector_pmtiles(folder / "roads.pmtiles").read_bytes()
    raster_mbtiles(folder / "scan.mbtiles")
    geotiff(folder / "photo.tif", np.full((3, 100, 100), 90, np.uint8))
    (folder / "broken.tif").write_bytes(b"nothing")
    world = world_in(tmp_path, scenario_of())
    world.context.settings = ServiceSection(http=HttpSection(basemaps=str(folder)))

    async def ask(http: httpx.AsyncClient) -> None:
        found = {each["name"]: each for each in (await http.get(f"{V1}/basemaps")).json()}
        assert set(found) == {"photo", "roads", "scan"}
        assert found["roads"]["layers"] == ["roads", "water"]
        part = await http.get(f"{V1}/basemaps/roads/archive", headers={"range": "bytes=0-126"})
        assert (part.status_code, part.content) == (206, archive[:127])
        assert part.headers["content-range"] == f"bytes 0-126/{len(archive)}"
        assert part.headers["cache-control"] == "no-store"
        whole = await http.get(f"{V1}/basemaps/roads/archive")
        assert whole.content == archive
        tile = await http.get(f"{V1}/basemaps/scan/10/272/401")
        assert (tile.status_code, tile.headers["content-type"]) == (200, "image/png")
        assert (await http.get(f"{V1}/basemaps/photo/10/0/0")).status_code == 204
        assert (await http.get(f"{V1}/basemaps/photo/40/0/0")).status_code == 204
        for path, words in (
            ("nothing/10/0/0", "no basemap 'nothing'; the basemaps are photo, roads, scan"),
            ("scan/archive", "scan.mbtiles is not a PMTiles file"),
        ):
            answer = await http.get(f"{V1}/basemaps/{path}")
            assert answer.status_code == 404
            assert words in answer.json()["error"]
        assert (await http.get(f"{V1}/basemaps/..%2Ftoken/archive")).status_code == 404

    asked(world, ask)
    lines = [line.text for line in world.context.state_view.announcements]
    assert [line for line in lines if "broken.tif: not a readable raster" in line]


def test_a_compressed_tile_is_sent_as_such(tmp_path: Path) -> None:
    vector_pmtiles(tmp_path / "roads.pmtiles")
    world = world_in(tmp_path, scenario_of())
    world.context.settings = ServiceSection(http=HttpSection(basemaps=str(tmp_path)))

    async def ask(http: httpx.AsyncClient) -> None:
        answer = await http.get(f"{V1}/basemaps/roads/12/1090/1603")
        assert answer.headers["content-encoding"] == "gzip"
        assert answer.content == repr((12, 1090, 1603)).encode()

    asked(world, ask)


def test_without_a_folder_there_are_only_the_lines_of_the_relief(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())

    async def ask(http: httpx.AsyncClient) -> None:
        assert (await http.get(f"{V1}/basemaps")).json() == []
        first = await http.get(f"{V1}/relief.geojson")
        kinds = {each["properties"]["kind"] for each in first.json()["features"]}
        assert "contour" in kinds
        assert (await http.get(f"{V1}/relief.geojson")).content == first.content

    asked(world, ask)


def test_the_folder_must_exist(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"service\.http\.basemaps: no such folder"):
        load_run("default", ('service.http.basemaps="nowhere"',))
    http = load_run("default", (f'service.http.basemaps="{tmp_path}"',))[1].http
    assert http is not None
    assert http.basemaps == str(tmp_path)
