"""The timeline of sorties on the map, of flights in virtual time.

If the environment variable MAP_PICTURES is set, a test writes pictures to that folder.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from mission_service.events import LinkLost, ModeChanged, OrderGiven
from mission_service.relief.task_relief import TaskRole
from tests.api.worlds import scenario_of, world_in
from tests.service.relief_flights import relief_scenario
from tests.web.browser import page_of
from tests.web.readability import assert_readable, weak_texts
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
SIZES = ((1440, 900), (768, 1024), (1024, 768), (390, 844), (844, 390))
SMALL = ("landscape.rows=150", "landscape.cols=150", "planner.rule=circling")


@pytest.fixture(scope="module")
def relieved(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Fly until kite has taken off to relieve hawk; swift and wren are on the ground."""
    scenario = relief_scenario(4, standing_signoff=True)
    world = world_in(tmp_path_factory.mktemp("relief"), scenario)
    reliefs: Any = world.simulation.core._reliefs
    world.fly(scenario.deploy_at_s + 2.0)
    while reliefs.task.members["kite"].role is not TaskRole.RELIEVES:
        assert world.now_s < scenario.deploy_at_s + 1200.0
        world.fly(world.now_s + 5.0)
    world.fly(world.now_s + 40.0)
    with site_of(world) as found:
        yield found


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[Site]:
    """Fly two vehicles, of which only hawk has an estimate of its energy."""
    changes = (*SMALL, "vehicles.0.endurance_s=1500", "vehicles.1.autostart=true")
    scenario = scenario_of("demo", changes)
    world = world_in(tmp_path, scenario)
    world.fly(scenario.deploy_at_s + 120.0)
    with site_of(world) as found:
        yield found


def texts_of(page: Page) -> list[str]:
    """Return the text of each row, in their order."""
    return [" ".join(text.split()) for text in page.locator("#sorties li").all_inner_texts()]


def bars(page: Page) -> list[dict[str, tuple[float, float]]]:
    """Return the begin and end of each part of each bar, as fractions of the axis."""
    script = """rows => rows.map((row) => Object.fromEntries(
        [...row.querySelectorAll(".bar i")].map((part) => {
            const [left, width] = [parseFloat(part.style.left), parseFloat(part.style.width)];
            return [part.className, [left / 100, (left + width) / 100]];
        })))"""
    found: list[dict[str, tuple[float, float]]] = page.locator("#sorties li").evaluate_all(script)
    return found


def minutes_and_time(site: Site, name: str) -> str:
    """Return the text about the landing of a vehicle, from the state that is published."""
    must_us = site.world.simulation.service.state_view.vehicles[name].must_land_at_us
    assert must_us is not None
    left_min = int(must_us / 1e6 - site.world.now_s) // 60
    at_min = must_us // 60_000_000
    return f"in {left_min} min (time {at_min // 60}:{at_min % 60:02d})"


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_the_next_landing_is_stated_and_each_vehicle_has_a_row(
    chromium: Browser, relieved: Site, size: tuple[int, int]
) -> None:
    site = relieved
    with page_of(chromium, site.address, site.service.tokens["all"], size) as (page, _):
        page.evaluate("missionMap.setLayoutProperty('hillshade', 'visibility', 'none')")
        title = page.locator("#next-landing")
        expect(title).to_be_in_viewport()
        expect(title).to_have_text(f"hawk must land {minutes_and_time(site, 'hawk')}")
        height = "document.getElementById('map').clientHeight"
        wait_for(lambda: page.evaluate(height) >= 100, 30, "the map has room beside the alarms")
        if IMAGES:
            page.screenshot(path=f"{IMAGES}/sorties-{size[0]}.png")
        if not page.locator("#sorties li").first.is_visible():
            title.click()
        rows = texts_of(page)
        assert [row.split()[0] for row in rows] == ["hawk", "kite", "swift", "wren"]
        assert minutes_and_time(site, "kite") in rows[1]
        assert "relieved by kite in" in rows[0]
        assert "relieves hawk in" in rows[1]
        assert ["ready" in row for row in rows] == [False, False, True, True]
        assert "relieves" not in rows[2], "kite relieves hawk, not swift"
        assert_readable(page, "sorties", size)


def test_a_bar_ends_at_the_landing_and_shows_the_flight_home(
    chromium: Browser, relieved: Site
) -> None:
    site = relieved
    states = site.world.simulation.service.state_view.vehicles
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        expect(page.locator("#sorties li")).to_have_count(4)
        hawk, kite, swift, wren = bars(page)
        assert swift == wren == {}
        must_us = [states[name].must_land_at_us or 0 for name in ("hawk", "kite")]
        ends_s = [must / 1e6 - site.world.now_s for must in must_us]
        axis_s = max(600.0, *ends_s)
        for found, end_s, name in ((hawk, ends_s[0], "hawk"), (kite, ends_s[1], "kite")):
            landing_s, home_s = states[name].time_landing_s, states[name].time_home_s
            assert landing_s is not None
            assert home_s is not None
            assert found["on-task"][0] == 0.0
            assert found["on-task"][1] == pytest.approx(found["flies-home"][0], abs=1e-5)
            assert found["flies-home"][1] == pytest.approx(found["lands"][0], abs=1e-5)
            expected_s = (end_s - landing_s - home_s, end_s - landing_s, end_s)
            parts = ("on-task", "flies-home", "lands")
            for part, each_s in zip(parts, expected_s, strict=True):
                assert found[part][1] * axis_s == pytest.approx(each_s, abs=15.0), (name, part)


def test_a_vehicle_without_an_estimate_is_unknown_and_a_return_lands_earlier(
    chromium: Browser, pair: Site
) -> None:
    site, service = pair, pair.world.simulation.service
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        title = page.locator("#next-landing")
        must = minutes_and_time(site, "hawk")
        expect(title).to_have_text(f"hawk must land {must}; unknown: kite")
        assert "unknown: no estimate of its energy" in texts_of(page)[1]
        assert bars(page)[1] == {}

        def lose_and_return() -> None:
            at_us = site.world.simulation.clock.now_us
            service.handle_events([LinkLost(at_us, "kite", 3.0)], at_us)
            service.submit(OrderGiven(at_us, "ann", "", "hawk", "return"), at_us)

        site.loop.call_soon_threadsafe(lose_and_return)
        expect(title).to_contain_text("hawk lands in")
        expect(page.locator("#sorties li").nth(1)).to_contain_text("LINK LOST")
        hawk = service.state_view.vehicles["hawk"]
        assert hawk.must_land_at_us is not None
        assert hawk.time_on_task_s is not None
        early_min = (hawk.must_land_at_us / 1e6 - hawk.time_on_task_s) // 60
        expect(title).to_contain_text(f"(time {early_min // 60:.0f}:{early_min % 60:02.0f})")


def test_a_relief_of_a_vehicle_with_a_longer_name_is_not_attributed(
    chromium: Browser, pair: Site
) -> None:
    site, view = pair, pair.world.simulation.service.state_view
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):

        def relieve(name: str) -> None:
            view.vehicles["kite"].relief = f"relieves {name} in 4 min"
            view._touch("vehicle/kite")
            site.world.context.ring()

        for name, text in (("hawk2", "relieves hawk2 in 4 min"), ("hawk", "relieved by kite in 4")):
            site.loop.call_soon_threadsafe(relieve, name)
            expect(page.locator("#sorties")).to_contain_text(text)
            assert ("relieved by kite" in texts_of(page)[0]) == (name == "hawk")


def test_without_estimates_the_next_landing_is_unknown_and_the_ground_is_stated(
    chromium: Browser, pair: Site
) -> None:
    site, service = pair, pair.world.simulation.service
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        title = page.locator("#next-landing")
        expect(title).to_contain_text("unknown: kite")

        def disarm(name: str) -> None:
            at_us = site.world.simulation.clock.now_us
            service.handle_events([ModeChanged(at_us, name, 0, False, "hold")], at_us)

        site.loop.call_soon_threadsafe(disarm, "hawk")
        expect(title).to_have_text("Unknown when kite must land")
        site.loop.call_soon_threadsafe(disarm, "kite")
        expect(title).to_have_text("All vehicles are on the ground")
        assert weak_texts(page) == []


def test_a_time_of_the_day_is_shown_while_mission_time_passes_as_real_time(
    chromium: Browser, pair: Site
) -> None:
    site = pair
    with page_of(chromium, site.address, site.service.tokens["all"], SIZES[0]) as (page, _):
        title = page.locator("#next-landing")
        expect(title).to_contain_text("(time ")
        page.evaluate("() => { window.at = performance.now(); performance.now = () => window.at; }")
        for passes_s, pattern in ((60.0, r"\(\d\d:\d\d\)"), (180.0, r"\(time \d:\d\d\)")):
            for _each in range(2):  # the first interval began before the clock was replaced
                page.evaluate("() => { window.at += 60_000; }")
                site.fly(passes_s)
                now_min = int(site.world.now_s) // 60
                clock = f"{now_min // 60}:{now_min % 60:02d}"
                expect(page.locator("#moment")).to_contain_text(clock)
            expect(title).to_contain_text(re.compile(pattern))
