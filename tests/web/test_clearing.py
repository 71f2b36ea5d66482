"""Clearing the airspace from the map: the button, its question, the progress, and the end.

The flights are in virtual time. If the environment variable MAP_PICTURES is set, a test writes
pictures to that folder.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from mission_service.events import LinkLost
from tests.api.worlds import scenario_of, world_in
from tests.web.browser import page_of
from tests.web.readability import assert_readable
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
SIZES = ((1440, 900), (768, 1024), (390, 844))
# Both vehicles have the home of the first one, where approaches clear the terrain.
ONE_FIELD = (
    *("planner.rule=circling", "vehicles.1.autostart=true"),
    *("vehicles.1.home_lat_deg=36.370784", "vehicles.1.home_lon_deg=-84.132309"),
)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """Two vehicles in flight."""
    scenario = scenario_of("demo", ONE_FIELD)
    world = world_in(tmp_path, scenario)
    world.fly(scenario.deploy_at_s + 90.0)
    with site_of(world) as found:
        yield found


def answer(page: Page, text: str, button: str) -> None:
    """Check the question and answer it."""
    question = page.locator("#question")
    expect(question).to_contain_text(text)
    question.get_by_role("button", name=button).click()
    expect(question).to_be_hidden()


def rows(page: Page) -> dict[str, str]:
    """Return the text about each vehicle, in the order of the landings."""
    found = page.locator("#clearing li").all_text_contents()
    return {name: text for name, _, text in (row.partition(" ") for row in found)}


def outcome(site: Site) -> str:
    clearing = site.world.simulation.service.state_view.clearing
    return "" if clearing is None else clearing.outcome


def test_clear_lands_all_vehicles_after_a_question_and_reports_one_that_is_not_reached(
    chromium: Browser, site: Site
) -> None:
    service = site.world.simulation.service
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        panel, counts = page.locator("#clearing"), page.locator("#clearing [role=status]")
        expect(panel).to_be_hidden()
        page.click("#clear")
        answer(page, "Clear the airspace? All vehicles land at home", "No")
        expect(panel).to_be_hidden()
        assert site.world.submitted == []
        assert outcome(site) == ""

        page.keyboard.press("Control+Shift+L")
        answer(page, "No vehicle takes off until all are on the ground.", "Yes")
        expect(page.locator("#message")).to_contain_text("Clear the airspace: ")
        expect(panel.locator("strong").first).to_have_text("All vehicles land")
        expect(counts).to_contain_text("0 of 2 on the ground")
        assert [type(each).__name__ for each in site.world.submitted] == ["ClearingOrdered"]
        assert set(rows(page)) == {"hawk", "kite"}
        site.fly(20.0)
        expect(panel.locator("li").first).to_contain_text("expected in")
        expect(counts).to_contain_text("last expected at")
        assert service.state_view.clearing is not None
        first = service.state_view.clearing.vehicles[0].vehicle
        assert next(iter(rows(page))) == first
        for size in SIZES:
            assert_readable(page, "clearing", size)
            expect(page.locator("#abort")).to_be_in_viewport()
            if IMAGES:
                page.screenshot(path=f"{IMAGES}/clearing-{size[0]}.png")
        page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})

        def lose() -> None:
            at_us = site.world.simulation.clock.now_us
            service.handle_events([LinkLost(at_us, first, 3.0)], at_us)

        site.loop.call_soon_threadsafe(lose)
        missed = panel.locator("li.missed")
        expect(missed).to_contain_text("NOT REACHED")
        expect(missed).to_contain_text("Use the radio")
        expect(missed.locator("strong")).to_have_text(first)
        expect(counts).to_contain_text("1 NOT REACHED")


def test_the_count_reaches_all_and_the_panel_disappears_a_minute_later(
    chromium: Browser, site: Site
) -> None:
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        page.click("#clear")
        answer(page, "Clear the airspace?", "Yes")
        panel = page.locator("#clearing")
        expect(panel).to_be_visible()
        end_s = site.world.now_s + 3000.0
        while outcome(site) != "complete":
            assert site.world.now_s < end_s
            site.fly(10.0)
        expect(panel).to_contain_text("All vehicles land: complete")
        expect(panel).to_contain_text("2 of 2 on the ground")
        assert set(rows(page).values()) == {"on the ground"}
        expect(panel.get_by_role("button", name="Cancel")).to_be_hidden()
        expect(page.locator("#next-landing")).to_have_text("All vehicles are on the ground")
        site.fly(70.0)
        expect(panel).to_be_hidden()


def test_cancel_stops_it_after_a_question_and_vehicles_on_their_way_hold(
    chromium: Browser, site: Site
) -> None:
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        page.click("#clear")
        answer(page, "Clear the airspace?", "Yes")
        cancel = page.locator("#clearing").get_by_role("button", name="Cancel")
        cancel.click()
        answer(page, "Stop clearing the airspace?", "No")
        site.fly(5.0)
        assert outcome(site) == "in force"
        cancel.click()
        answer(page, "Vehicles on their way hold until you resume them.", "Yes")
        expect(page.locator("#clearing")).to_contain_text("All vehicles land: cancelled")
        expect(cancel).to_be_hidden()
        assert outcome(site) == "cancelled"
        site.fly(5.0)
        states = site.world.simulation.service.state_view.vehicles
        assert [state.order for state in states.values()] == ["hold", "hold"]


def test_without_the_role_fly_the_button_states_the_reason(chromium: Browser, site: Site) -> None:
    with page_of(chromium, site.address, site.service.tokens["look"], SIZES[0]) as (page, _):
        expect(page.locator("#clear")).to_be_disabled()
        reason = (
            'Your token does not permit you to command vehicles: it does not have the role "fly"'
        )
        expect(page.locator("#clear")).to_have_attribute("title", reason)
        page.keyboard.press("Control+Shift+L")
        expect(page.locator("#message")).to_have_text(reason)
        expect(page.locator("#question")).to_be_hidden()
        assert site.world.submitted == []
