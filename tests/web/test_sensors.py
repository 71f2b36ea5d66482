"""The panel of sensors and the observations on the map, of a flight in virtual time.

If the environment variable MAP_PICTURES is set, the tests write the picture of docs/map.md to that
folder.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from mission_service.events import FireObserved, Observed
from mission_service.runtime.observation_sources import SILENT_S
from tests.api.worlds import scenario_of, world_in
from tests.web import browser as screen
from tests.web.browser import page_of
from tests.web.readability import assert_readable
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
DESKTOP, SIZES = (1440, 900), ((320, 568), (390, 844), (820, 1180), (960, 640))
SCENARIO = scenario_of(
    "demo",
    ("landscape.rows=150", "landscape.cols=150", "estimate.sensors=[]", "planner.rule=circling"),
)
LIT = (36.364232, -84.140907)  # the ignition
PROBLEM = "sensor video failed and is not used until a restart: OSError: connection refused"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    world = world_in(tmp_path_factory.mktemp("run"), SCENARIO)
    world.fly(SCENARIO.deploy_at_s + 300.0)
    at_us = world.simulation.clock.now_us
    for age_s, source in ((90, "tower"), (60, "tower"), (30, "tower"), (20, "")):
        place = (LIT[0] - age_s * 2e-5, LIT[1] + age_s * 2e-5)
        seen_us = at_us - age_s * 1_000_000
        world.context.state_view.apply(
            FireObserved(
                *(at_us, "anna", "north", "hot", "points", (place,)),
                *(seen_us, 20.0, 0.0, source),
            ),
            [],
        )
    with site_of(world) as found:
        yield found


@pytest.fixture(scope="module")
def page(site: Site) -> Iterator[Page]:
    with (
        screen.chromium() as browser,
        page_of(browser, site.address, site.service.tokens["all"], DESKTOP) as (page, _),
    ):
        if not IMAGES:  # shading takes most of the time
            page.evaluate("missionMap.setLayoutProperty('hillshade', 'visibility', 'none')")
        yield page


def drawn(page: Page, layer: str) -> set[str]:
    """Return the sources whose observations a layer draws."""
    script = """layer => missionMap.queryRenderedFeatures({ layers: [layer] })
        .map((one) => one.properties.source)"""
    return set(page.evaluate(script, layer))


def row(page: Page, source: str) -> str:
    rows = page.locator(".sources li")
    return str(rows.filter(has=page.locator("strong", has_text=source)).inner_text())


def test_each_source_is_listed_with_its_contribution(page: Page, site: Site) -> None:
    page.click("#tab-sensors")
    panel = page.locator("#panel-sensors")
    expect(panel.locator(".big")).to_have_text("4 of 4 sources live")
    of = {each.source: each for each in site.world.context.state_view.sources()}
    assert of.keys() == {"hawk", "kite", "tower of anna", "anna at north"}
    text = row(page, "hawk")
    assert f"{of['hawk'].observations} observations" in text
    assert f"Cells: {of['hawk'].burned_cells:,} burned" in text
    assert "usually every 30 s" in row(page, "tower")
    assert "person" in row(page, "anna at north")


def test_observations_are_drawn_while_their_box_is_checked(page: Page, site: Site) -> None:
    assert not drawn(page, "observed-outline")
    page.check("#show-observed")
    wait_for(lambda: drawn(page, "observed-outline") == {"hawk", "kite"}, 30, "footprints")
    wait_for(
        lambda: drawn(page, "reported-point") == {"tower of anna", "anna at north"}, 30, "reports"
    )
    assert drawn(page, "observed-burned")
    if IMAGES:
        site.fly(1.0)  # otherwise the page shows an alarm, because time does not advance
        page.evaluate("document.activeElement.blur()")
        page.wait_for_timeout(3000)
        page.screenshot(path=Path(IMAGES) / "sensors.png")
    page.click("#tab-fire")
    expect(page.locator("#show-observations")).to_be_checked()
    page.uncheck("#show-observations")
    wait_for(lambda: not drawn(page, "observed-outline"), 30, "they are hidden")
    page.click("#tab-sensors")
    expect(page.locator("#show-observed")).not_to_be_checked()
    page.check("#show-observed")


def test_new_observations_are_drawn_and_a_silent_source_is_marked(page: Page, site: Site) -> None:
    first_us = min(each["at_us"] for each in shown(page))
    site.fly(SILENT_S + 60)
    expect(page.locator(".sources .state.silent")).to_have_count(1)
    assert "no observation for more than 300 s; usually one every 30 s" in row(page, "tower")
    expect(page.locator("#panel-sensors .big")).to_have_text("3 of 4 sources live")
    wait_for(lambda: min(each["at_us"] for each in shown(page)) > first_us, 30, "old ones go")
    newest = site.world.context.state_view.statistics.sources.footprints[-1].number
    wait_for(lambda: max(each["number"] for each in shown(page)) == newest, 30, "new ones come")


def shown(page: Page) -> list[dict[str, int]]:
    """Return the properties of the observations in the map's source."""
    found: list[dict[str, int]] = page.evaluate(
        """() => missionMap.getSource("observations").serialize().data.features
            .map((one) => one.properties)"""
    )
    return found


def test_problems_are_shown_and_all_is_readable_on_each_device(page: Page, site: Site) -> None:
    def fail() -> None:
        view = site.world.context.state_view
        view.statistics.sources.apply(video)
        view.show_sensors({"video": PROBLEM}, ["video"])
        view._touch("sources")
        site.world.context.ring()

    world_us = site.world.simulation.clock.now_us
    video = Observed(world_us, "hawk", 10, 10, ("b",), source="video", position_sd_m=5.0)
    site.loop.call_soon_threadsafe(fail)
    expect(page.locator(".sources .state.failed")).to_have_text("failed")
    assert PROBLEM in row(page, "video")
    page.keyboard.press("k")  # acknowledges the alarm
    page.locator("#tab-burn").evaluate("tab => tab.removeAttribute('hidden')")  # the widest row
    for size in SIZES:
        assert_readable(page, "panel-sensors", size)
        if folder := os.environ.get("SENSOR_PICTURES"):
            page.screenshot(path=Path(folder) / f"{size[0]}.png")
