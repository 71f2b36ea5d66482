"""Images of a sensor on the map, of a flight in virtual time whose camera writes image files.

If the environment variable MAP_PICTURES is set, the tests write the picture of docs/map.md to that
folder; with IMAGE_PICTURES one picture of each size of screen.
"""

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from scipy.ndimage import binary_erosion

from mission_service.fire.sensors import MAX_IMAGES, SensorImage
from tests.api.worlds import scenario_of, world_in
from tests.web import browser as screen
from tests.web.browser import page_of, pixels, place_of
from tests.web.readability import assert_readable
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES, SIZED = os.environ.get("MAP_PICTURES", ""), os.environ.get("IMAGE_PICTURES", "")
DESKTOP, SIZES = (1440, 900), ((390, 844), (820, 1180), (960, 640), (320, 568))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    frames = tmp_path_factory.mktemp("frames")
    scenario = scenario_of(
        "demo",
        (
            *("landscape.rows=150", "landscape.cols=150", "planner.rule=circling"),
            *('estimate.sensors=["thermal_frames"]', f'estimate.thermal_frames.folder="{frames}"'),
            *("vehicles.0.camera_trigger_m=40", "vehicles.0.gimbal_pitch_deg=-70"),
            *("vehicles.1.camera_trigger_m=1000", "vehicles.1.autostart=false"),
            "estimate.thermal_frames.max_position_sd_m=12",
        ),
    )
    world = world_in(tmp_path_factory.mktemp("run"), scenario)
    world.fly(scenario.deploy_at_s + 30.0)
    with site_of(world) as found:
        yield found


@pytest.fixture(scope="module")
def page(site: Site) -> Iterator[Page]:
    with (
        screen.chromium() as browser,
        page_of(browser, site.address, site.service.tokens["all"], DESKTOP) as (page, _),
    ):
        if not (IMAGES or SIZED):  # shading takes most of the time
            page.evaluate("missionMap.setLayoutProperty('hillshade', 'visibility', 'none')")
        yield page


def images_of(site: Site) -> tuple[SensorImage, ...]:
    return site.world.context.service.sensors.images().get("thermal_frames", ())


def layers(page: Page) -> list[str]:
    """Return the visible layers of images, from bottom to top."""
    found: list[str] = page.evaluate(
        """() => missionMap.getLayersOrder().filter((name) => name.startsWith("image thermal"))
            .filter((name) => missionMap.getLayoutProperty(name, "visibility") !== "none")"""
    )
    return found


def numbers(page: Page) -> list[int]:
    return [int(name.split()[1].split("/")[1]) for name in layers(page)]


def sd_m(image: SensorImage) -> float:
    return math.hypot(image.major_m, image.minor_m) / math.sqrt(2.0)


def place_shown(page: Page) -> list[dict[str, Any]]:
    """Return the features of the ellipse and the label."""
    found: list[dict[str, Any]] = page.evaluate(
        """() => missionMap.getSource("image-place").serialize().data.features"""
    )
    return found


def test_nothing_is_offered_before_the_first_image(page: Page, site: Site) -> None:
    assert not images_of(site)
    page.click("#tab-sensors")
    expect(page.locator("#show-observed")).to_be_visible()
    expect(page.locator("#panel-sensors .images")).to_be_hidden()


def test_images_are_drawn_over_the_terrain_while_their_box_is_checked(
    page: Page, site: Site
) -> None:
    site.fly(240.0)
    expected = [each.number for each in images_of(site)]
    assert len(expected) == MAX_IMAGES
    expect(page.locator("#panel-sensors .images")).to_be_visible()
    assert not layers(page)
    page.check("#show-images-here")
    wait_for(lambda: numbers(page) == expected, 30, "the newest image is on top")
    opacities = page.evaluate(
        "names => names.map((name) => missionMap.getPaintProperty(name, 'raster-opacity'))",
        layers(page),
    )
    assert opacities == sorted(opacities)
    assert opacities[0] < 0.5 < 0.9 < opacities[-1]
    page.click("#tab-fire")
    expect(page.locator("#show-images")).to_be_checked()
    page.click("#tab-sensors")


def test_the_newest_image_has_its_ellipse_its_time_and_its_source(page: Page, site: Site) -> None:
    newest = images_of(site)[-1]
    ellipse, label = place_shown(page)
    land = site.world.context.landscape
    lat, lon = land.lat_lon_of(*land.xy_of(*newest.centre))
    assert label["geometry"]["coordinates"] == pytest.approx([lon, lat], abs=1e-6)
    first, second = label["properties"]["label"].splitlines()
    assert first.endswith(" thermal_frames")
    assert float(second.strip("± m")) == pytest.approx(sd_m(newest), abs=0.06)
    ring = np.array(ellipse["geometry"]["coordinates"])
    x_m, y_m = land.xy_of_lat_lon(ring[:, 1], ring[:, 0])
    cx_m, cy_m = land.xy_of(*newest.centre)
    far_m = np.hypot(x_m - cx_m, y_m - cy_m)
    assert far_m.max() == pytest.approx(2.146 * newest.major_m, rel=0.02, abs=0.05)
    assert far_m.min() == pytest.approx(2.146 * newest.minor_m, rel=0.02, abs=0.05)
    text = page.locator("#panel-sensors .images").inner_text()
    assert f"{MAX_IMAGES} of {MAX_IMAGES}, {newest.name}" in text
    assert "°C" in text


def test_the_picture_is_where_the_image_shows_the_ground(page: Page, site: Site) -> None:
    """Hot ground of the newest image has the colours of flames on the screen."""
    image, land = images_of(site)[-1], site.world.context.landscape
    top, left, bottom, right = image.bounds
    row, col = (
        each.ravel()
        for each in np.meshgrid(np.linspace(top, bottom, 60), np.linspace(left, right, 60))
    )
    colours = image.colours(np.column_stack([row, col]))
    seen = colours[:, 3] > 0
    hot, cool = (
        binary_erosion(each.reshape(60, 60)).ravel()  # without edges, which are blurred
        for each in (seen & (colours[:, 1] > 200), seen & (colours[:, 0] < 60))
    )
    assert hot.any()
    assert cool.any()
    lat, lon = land.lat_lon_of(*land.xy_of(row, col))
    page.evaluate("([lon, lat]) => missionMap.jumpTo({ center: [lon, lat], zoom: 17 })",
                  [float(lon.mean()), float(lat.mean())])  # fmt: skip
    page.evaluate(
        """() => missionMap.getLayersOrder().filter((name) => !name.startsWith("image thermal"))
            .forEach((name) => missionMap.setLayoutProperty(name, "visibility", "none"))"""
    )
    places = np.column_stack([lon, lat])

    def share(which: Any, is_so: Any) -> float:
        """Return the share of places on the screen; a banner may move the map at any time."""
        script = "places => places.map((one) => missionMap.project(one)).map(({x, y}) => [x, y])"
        x, y = np.rint(page.evaluate(script, places[which].tolist())).astype(int).T
        shown = pixels(page)
        inside = (x >= 0) & (x < shown.shape[1]) & (y >= 0) & (y < shown.shape[0])
        return float(is_so(shown[y[inside], x[inside]]).mean())

    def bright(rgb: Any) -> Any:
        return (rgb[:, 0] > 200) & (rgb[:, 1] > 120)

    def dark(rgb: Any) -> Any:
        return (rgb[:, 0] < 90) & (rgb[:, 1] < 60)

    wait_for(lambda: share(hot, bright) > 0.8, 30, "flames where the image shows them")
    wait_for(lambda: share(cool, dark) > 0.8, 30, "cool ground where the image shows it")
    page.reload()
    page.wait_for_selector("#map[data-ready]")


def test_another_image_is_selected_by_buttons_and_on_the_map(page: Page, site: Site) -> None:
    images = images_of(site)
    page.click("#tab-sensors")
    page.check("#show-images-here")
    wait_for(lambda: len(layers(page)) == MAX_IMAGES, 30, "the images are drawn")
    page.click("text=Older")
    page.click("text=Older")
    expect(page.locator("#panel-sensors .images")).to_contain_text(images[-3].name)
    wait_for(lambda: numbers(page)[-1] == images[-3].number, 10, "it is on top")
    site.fly(10.0)  # a new image does not change the selection
    newest = images_of(site)[-1].number
    wait_for(lambda: newest in numbers(page), 30, "the new image is drawn")
    assert numbers(page)[-1] == images[-3].number
    page.click("text=Newest")
    wait_for(lambda: numbers(page)[-1] == newest, 10, "the newest is on top")
    shown = images_of(site)[-1]
    land = site.world.context.landscape
    lat, lon = land.lat_lon_of(*land.xy_of(*shown.centre))
    page.mouse.click(*place_of(page, float(lat), float(lon)))  # the next one below it
    wait_for(lambda: numbers(page)[-1] != newest, 10, "another one is on top")
    page.click("text=Newest")


def test_all_is_readable_on_each_device(page: Page, site: Site) -> None:
    for size in (*SIZES, DESKTOP):
        assert_readable(page, "panel-sensors", size)
        if SIZED or (IMAGES and size == DESKTOP):
            image = images_of(site)[-1]
            land = site.world.context.landscape
            lat, lon = land.lat_lon_of(*land.xy_of(*image.centre))
            page.evaluate("([lon, lat]) => missionMap.jumpTo({ center: [lon, lat], zoom: 16 })",
                          [float(lon), float(lat)])  # fmt: skip
            site.fly(1.0)  # otherwise the page shows an alarm, because time does not advance
            page.wait_for_timeout(3000)
            if SIZED:
                page.screenshot(path=Path(SIZED) / f"{size[0]}.png")
            if IMAGES:
                page.screenshot(path=Path(IMAGES) / "images.png")
