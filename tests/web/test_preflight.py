"""The pre-flight checks and the sign-off of a takeoff on the map, of vehicles in virtual time.

If the environment variable MAP_PICTURES is set, the test writes pictures to that folder.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from mission_service.events import BatteryUpdated, RemoteIdChanged
from tests.api.worlds import scenario_of, world_in
from tests.web import browser as screen
from tests.web.browser import page_of
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
SIZES = ((390, 844), (1440, 900))
SMALL = ("landscape.rows=150", "landscape.cols=150", 'preflight.signoff="each"')


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """Two vehicles on the ground that wait for a sign-off."""
    scenario = scenario_of("demo", SMALL)
    world = world_in(tmp_path, scenario)
    world.fly(scenario.deploy_at_s + 60.0)
    with site_of(world) as found:
        yield found


@pytest.mark.parametrize("size", SIZES, ids=lambda size: str(size[0]))
def test_a_failing_check_is_first_and_its_takeoff_needs_a_reason(
    site: Site, size: tuple[int, int]
) -> None:
    service = site.world.simulation.service
    at_us = site.world.simulation.clock.now_us
    low = BatteryUpdated(at_us, "hawk", 12.0, 11.0)
    with (
        screen.chromium() as browser,
        page_of(browser, site.address, site.service.tokens["all"], size) as (page, _),
    ):
        page.click("#tab-vehicles")
        page.get_by_role("button", name="hawk").first.click()
        takeoff = page.locator("button.takeoff")
        expect(takeoff).to_have_text("Sign off and take off")
        expect(takeoff).to_be_enabled()
        module = RemoteIdChanged(at_us, "hawk", "fails", "no GPS lock")
        for event in (low, module):
            site.loop.call_soon_threadsafe(service.handle_events, [event], 0)
        facts = page.locator("#panel-vehicles dl.figures").first
        expect(facts).to_contain_text("Remote IDfails: no GPS lock")
        first = page.locator(".preflight li").first
        expect(first).to_contain_text("battery 12 %, the reserve is 20 %: replace the battery")
        expect(page.locator(".vehicles li").first).to_contain_text("NO-GO: battery")
        expect(takeoff).to_be_disabled()
        if IMAGES:
            page.locator(".preflight").first.scroll_into_view_if_needed()
            page.screenshot(path=f"{IMAGES}/preflight-{size[0]}.png")
        page.fill("#override", "the monitor is not calibrated")
        takeoff.click()
        expect(page.locator("#message")).to_contain_text("battery overridden by")
        site.fly(60.0)
        wait_for(lambda: service.state_view.vehicles["hawk"].armed, 30, "the vehicle has started")
        expect(page.locator(".preflight").first).to_be_hidden()
