"""The quality of a vehicle's links on the map, of vehicles in virtual time.

If the environment variable MAP_PICTURES is set, the test writes pictures to that folder.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from mission_service.events import LinkQuality, LinksReported
from tests.api.worlds import scenario_of, world_in
from tests.web import browser as screen
from tests.web.browser import page_of
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
RADIO, LTE = "serial:/dev/ttyUSB0:57600", "udpin:0.0.0.0:14560"


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    scenario = scenario_of("demo", ("landscape.rows=150", "landscape.cols=150"))
    world = world_in(tmp_path, scenario)
    world.fly(scenario.deploy_at_s + 60.0)
    with site_of(world) as found:
        yield found


def test_each_link_is_shown_and_one_that_is_left_alone_is_an_alarm(site: Site) -> None:
    service = site.world.simulation.service
    at_us = site.world.simulation.clock.now_us
    quality = (LinkQuality(RADIO, "silent", None, at_us - 42_000_000), LinkQuality(LTE, "up", 0.07))
    report = LinksReported(at_us, "hawk", quality, LTE, "silent")
    with (
        screen.chromium() as browser,
        page_of(browser, site.address, site.service.tokens["all"], (1440, 900)) as (page, _),
    ):
        page.click("#tab-vehicles")
        page.get_by_role("button", name="hawk").first.click()
        site.loop.call_soon_threadsafe(service.handle_events, [report], 0)
        shown = page.get_by_text(f"{RADIO}: SILENT for 42 s; {LTE}: in use, good, 7 % lost")
        expect(shown).to_be_visible()
        expect(page.locator(".vehicles li").first).to_contain_text("ONE LINK")
        expect(page.get_by_text(f"only one link is left: {RADIO} is silent").first).to_be_visible()
        if IMAGES:
            page.screenshot(path=f"{IMAGES}/links.png")
