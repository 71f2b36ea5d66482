"""Basemaps on the map: relief lines, vector and raster files from a folder, and their styles."""

from functools import partial
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from affine import Affine
from playwright.sync_api import Page, expect

from tests.web import browser as screen
from tests.web.browser import page_of, pixels
from tests.web.service import FIRE, running, wait_for
from tests.web.test_map import DESKTOP, state_view

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

DRAWN = "layer => missionMap.queryRenderedFeatures({ layers: [layer] }).length"


def road_in(folder: Path) -> None:
    """Write a road from 36.34 N 84.18 W to 36.36 N 84.14 W as vector tiles, by GDAL."""
    road = shapely.LineString([(-84.18, 36.34), (-84.14, 36.36)])
    pyogrio.raw.write(
        folder / "county.pmtiles",
        shapely.to_wkb(np.array([road])),
        [np.array(["US 25"], dtype=object)],
        ["name"],
        geometry_type="LineString",
        crs="EPSG:4326",
        driver="PMTiles",
        layer="roads",
        MINZOOM=8,
        MAXZOOM=14,
    )


def photo_in(folder: Path) -> None:
    """Write a green image of 4 km x 4 km around the fire."""
    with rasterio.open(
        folder / "photo.tif",
        "w",
        driver="GTiff",
        count=3,
        height=400,
        width=400,
        dtype="uint8",
        crs="EPSG:32616",
        transform=Affine(10.0, 0.0, 753_000.0, 0.0, -10.0, 4_029_000.0),
    ) as file:
        file.write(
            np.full((3, 400, 400), 40, np.uint8) + np.array([[[0]], [[160]], [[0]]], np.uint8)
        )


def share_green(page: Page) -> float:
    red, green, blue = np.moveaxis(pixels(page), 2, 0)
    return float(((green - red > 90) & (green - blue > 90)).mean())


def choose(page: Page, style: str) -> None:
    page.click("button.settings")
    page.get_by_role("button", name=style, exact=True).click()
    page.keyboard.press("Escape")


def test_styles_show_relief_lines_vector_tiles_and_imagery(tmp_path: Path) -> None:
    maps = tmp_path / "maps"
    maps.mkdir()
    road_in(maps)
    photo_in(maps)
    with (
        running(tmp_path, FIRE + f'basemaps = "{maps}"\n', 5) as service,
        screen.chromium() as chromium,
        page_of(chromium, service.address, service.boss, DESKTOP) as (page, _),
    ):
        page.evaluate("missionMap.jumpTo({ center: [-84.16, 36.35], zoom: 13.5 })")
        for layer in ("relief-contours", "relief-drainage", "basemap-county/roads-line"):
            wait_for(partial(page.evaluate, DRAWN, layer), 30, f"{layer} is drawn")
        state_view(page, "topo")
        assert share_green(page) < 0.01
        page.click("button.settings")
        expect(page.locator("#display fieldset").last).to_contain_text("TopoImageryHillshade")
        page.keyboard.press("Escape")
        choose(page, "Imagery")
        wait_for(lambda: share_green(page) > 0.3, 30, "the image is drawn")
        page.reload()
        page.wait_for_selector("#map[data-ready]")
        page.evaluate("missionMap.jumpTo({ center: [-84.16, 36.35], zoom: 13.5 })")
        wait_for(lambda: share_green(page) > 0.3, 30, "the style is remembered")
        assert page.evaluate(DRAWN, "relief-contours") == 0
        choose(page, "Hillshade")
        wait_for(lambda: share_green(page) < 0.01, 30, "the image is hidden")
        choose(page, "Night")
        choose(page, "Topo")
        wait_for(lambda: page.evaluate(DRAWN, "basemap-county/roads-line") > 0, 30, "by night")
