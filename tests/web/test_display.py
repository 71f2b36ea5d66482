"""The display of the map: units, colours, sizes, and what the card of a vehicle states."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.web.browser import Seen, draw, page_of, place_of
from tests.web.readability import axe_problems, small_targets, weak_borders, weak_texts
from tests.web.service import BURN, FIRE, Service, running, wait_for
from tests.web.test_map import state_view
from tests.web.test_phone import assert_abort_in_reach

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

SIZES = (
    *((360, 640), (390, 844), (768, 1024), (1024, 768), (1440, 900)),
    *((640, 360), (844, 390), (1024, 1366), (900, 1440)),
)
THEMES = ("day", "night", "contrast")
PANELS = ("vehicles", "fire", "sensors", "planner", "log")
APPROVED = (
    FIRE
    + """
[mission]
approval = "each"
"""
)
TOO_WIDE = """["top", "time", "sorties"].filter((id) => {
    const { scrollWidth, clientWidth } = document.getElementById(id);
    return scrollWidth > clientWidth + 1;
})"""
MACHINE = 3.0  # test machines are busy and draw without a graphics card
RINGS = """[...new Set(missionMap.querySourceFeatures('rings')
  .map((each) => each.properties.label).filter(Boolean))]"""


@pytest.fixture(scope="module")
def fire(chromium: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running(tmp_path_factory.mktemp("display"), FIRE, 10) as service:
        wait_for(
            lambda: service.get("vehicles/hawk")["decisions"] > 0, 120, "hawk has a front estimate"
        )
        yield service


@pytest.fixture(scope="module")
def desktop(chromium: Browser, fire: Service) -> Iterator[tuple[Page, Seen]]:
    with page_of(chromium, fire.address, fire.boss, (1440, 900)) as opened:
        yield opened


def set_theme(page: Page, theme: str) -> None:
    page.evaluate("theme => localStorage.setItem('mission-service-theme', theme)", theme)
    page.reload()
    page.wait_for_selector("#map[data-ready]")
    expect(page.locator(f"html[data-theme={theme}]")).to_be_attached()


def resize(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.wait_for_function(f"innerWidth === {size[0]} && innerHeight === {size[1]}")


def assert_accessible(page: Page, what: str) -> None:
    assert not axe_problems(page), what
    assert not weak_texts(page, 4.5), what
    assert not weak_borders(page), what


def test_units_are_chosen_and_remembered(desktop: tuple[Page, Seen]) -> None:
    page, _ = desktop
    rows, size = page.locator("ul.vehicles"), page.locator("#top .size")
    expect(rows).to_contain_text(re.compile(r"\d m · [\d.]+ m/s"))
    page.click("button.settings")
    page.get_by_role("button", name="Aviation", exact=True).click()
    expect(rows).to_contain_text(re.compile(r"\d ft · [\d.]+ kt"))
    expect(size).to_contain_text("acres")
    expect(page.locator("#panel-vehicles")).to_contain_text(re.compile(r"\d ft AGL, \d+ ft MSL"))
    expect(page.locator(".maplibregl-ctrl-scale")).to_contain_text("nm")
    page.keyboard.press("Escape")
    expect(page.locator("#display")).to_be_hidden()
    page.reload()
    page.wait_for_selector("#map[data-ready]")
    expect(rows).to_contain_text(re.compile(r"\d ft · [\d.]+ kt"))
    page.click("#tab-fire")
    expect(page.locator("label[for=wind-speed]")).to_have_text("Speed (kt)")
    page.click("button.settings")
    page.get_by_role("button", name="US", exact=True).click()
    expect(page.locator("label[for=wind-speed]")).to_have_text("Speed (mph)")
    page.get_by_role("button", name="Metric", exact=True).click()
    page.keyboard.press("Escape")
    page.click("#tab-vehicles")


def test_the_clock_shows_mission_time_local_time_and_utc(desktop: tuple[Page, Seen]) -> None:
    page, _ = desktop
    expect(page.locator("#top")).to_contain_text(
        re.compile(r"Time \d+:\d\d.*\d\d:\d\d local · \d\d:\d\dZ")
    )


def test_the_wind_is_entered_in_the_chosen_unit(desktop: tuple[Page, Seen], fire: Service) -> None:
    page, _ = desktop
    page.click("button.settings")
    page.get_by_role("button", name="Aviation", exact=True).click()
    page.keyboard.press("Escape")
    page.click("#tab-fire")
    page.fill("#wind-from", "90")
    page.fill("#wind-speed", "10")
    page.get_by_role("button", name="Set: from 90°, 10 kt").click()
    wind = wait_for(lambda: fire.get("weather")["wind_set"], 30, "the wind is set")
    assert wind["speed_m_s"] == pytest.approx(10 * 1852 / 3600)
    page.evaluate("localStorage.removeItem('mission-service-units')")
    page.reload()
    page.wait_for_selector("#map[data-ready]")


def test_the_card_states_what_a_vehicle_does_and_never_that_a_held_one_flies_on(
    desktop: tuple[Page, Seen], fire: Service
) -> None:
    page, _ = desktop
    card = page.locator(".card")
    expect(card.locator(".does")).to_contain_text(
        re.compile(r"Follows the front (anti|counter)?clockwise|Turned back")
    )
    expect(card.locator(".tiles")).to_contain_text(
        re.compile(r"Next(item \d+ of \d+ in \d|a new mission|circles)")
    )
    fire.post("vehicles/hawk/hold")
    expect(card.locator(".does")).to_have_text("Holds, by order")
    expect(card).to_contain_text("The planner does not steer it: the order hold is in force.")
    expect(page.locator("#panel-vehicles")).not_to_contain_text("continues.")
    assert page.get_attribute(".strip", "aria-label") == "No decision now"
    fire.post("vehicles/hawk/resume")
    expect(card.locator(".does")).not_to_have_text("Holds, by order")


def test_the_chosen_vehicle_is_followed_until_the_map_is_moved(
    desktop: tuple[Page, Seen], fire: Service
) -> None:
    page, _ = desktop
    page.click("button.follow")
    off_m = """() => {
        const [feature] = missionMap.querySourceFeatures("vehicles")
            .filter((each) => each.properties.chosen);
        const [lng, lat] = feature.geometry.coordinates;
        return missionMap.getCenter().distanceTo({ lng, lat });
    }"""

    def follows() -> bool:
        before = page.evaluate("missionMap.getCenter().toArray()")
        page.wait_for_timeout(400)
        moved = before != page.evaluate("missionMap.getCenter().toArray()")
        return bool(moved and page.evaluate(off_m) < 60)

    wait_for(follows, 30, "the map follows hawk")
    x, y = place_of(page, *page.evaluate("(({ lat, lng }) => [lat, lng])(missionMap.getCenter())"))
    draw(page, [(x - 60, y + 60), (x + 60, y + 120)])
    expect(page.locator("button.follow")).to_have_attribute("aria-pressed", "false")


def test_range_rings_have_round_radii(desktop: tuple[Page, Seen]) -> None:
    page, _ = desktop
    page.keyboard.press("c")
    page.evaluate("missionMap.zoomTo(14, { duration: 0 })")
    page.click("#tab-fire")
    page.check("#show-rings")
    wait_for(
        lambda: page.evaluate(RINGS)[:2] in (["250 m", "500 m"], ["500 m", "1.0 km"]), 30, "rings"
    )
    page.uncheck("#show-rings")
    wait_for(lambda: page.evaluate(RINGS) == [], 30, "the rings are removed")


def test_a_note_is_on_the_map_and_in_the_log(desktop: tuple[Page, Seen], fire: Service) -> None:
    page, _ = desktop
    centre = page.evaluate("(({ lat, lng }) => [lat, lng])(missionMap.getCenter())")
    page.click("#tools .note")
    draw(page, [place_of(page, *centre)])
    page.fill("#entered", "gate locked")
    page.keyboard.press("Enter")
    expect(page.locator("#message")).to_contain_text("Note: done")
    page.click("#tab-log")
    expect(page.locator("#panel-log ol")).to_contain_text("boss notes at 36.")
    expect(page.locator("#panel-log ol")).to_contain_text(": gate locked")
    layers = "missionMap.queryRenderedFeatures({ layers: ['notes'] }).length"
    wait_for(lambda: page.evaluate(layers) > 0, 30, "the note is drawn")
    page.click("#tools .note")
    draw(page, [place_of(page, *centre)])
    page.keyboard.press("Escape")
    expect(page.locator("#question")).to_be_hidden()
    notes = [each for each in fire.get("records") if each["kind"] == "note"]
    assert len(notes) == 1, "a closed question adds no note"
    page.click("#tools .move")


def test_colours_follow_the_system_until_they_are_chosen(chromium: Browser, fire: Service) -> None:
    context = chromium.new_context(color_scheme="dark")
    page = context.new_page()
    page.goto(f"{fire.address}/#token={fire.boss}")
    expect(page.locator("html")).to_have_attribute("data-theme", "night")
    page.wait_for_selector("#map[data-ready]")
    page.click("button.settings")
    page.get_by_role("button", name="High contrast").click()
    expect(page.locator("html")).to_have_attribute("data-theme", "contrast")
    page.reload()
    expect(page.locator("html")).to_have_attribute("data-theme", "contrast")
    context.close()


@pytest.mark.parametrize("theme", THEMES)
def test_every_panel_and_dialog_is_accessible_in_every_theme_and_size(
    desktop: tuple[Page, Seen], theme: str
) -> None:
    page, _ = desktop
    set_theme(page, theme)
    for size in SIZES:
        resize(page, size)
        for panel in PANELS:
            page.locator(f"#tab-{panel}").evaluate("tab => tab.click()")
            assert not small_targets(page), (theme, size, panel)
            assert page.evaluate(TOO_WIDE) == [], (theme, size, panel)
            if panel == "vehicles" and size in ((390, 844), (1440, 900)):
                state_view(page, f"{theme}-{size[0]}")
            if size in ((360, 640), (1440, 900)):
                assert_accessible(page, f"{theme}, {size}, {panel}")
    for keys, dialog in (("?", "#help"), ("", "#display")):
        page.keyboard.press(keys) if keys else page.click("button.settings")
        expect(page.locator(dialog)).to_be_visible()
        state_view(page, f"{theme}{dialog.replace('#', '-')}")
        assert_accessible(page, f"{theme}, {dialog}")
        page.keyboard.press("Escape")
    page.click("#clear")
    expect(page.locator("#question")).to_be_visible()
    assert_accessible(page, f"{theme}, question")
    page.get_by_role("button", name="No", exact=True).click()


def test_waiting_plans_have_a_badge_and_a_sound_at_every_size(
    chromium: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with (
        running(tmp_path_factory.mktemp("waiting"), APPROVED, 5) as service,
        page_of(chromium, service.address, service.boss, (1440, 900)) as (page, seen),
    ):
        badge = page.locator("#waiting")
        expect(badge).to_have_text(re.compile(r"^[12] plans? waits?$"))
        page.evaluate(
            """() => {
            const start = OscillatorNode.prototype.start;
            window.sounded = [];
            OscillatorNode.prototype.start = function (at) {
                window.sounded.push(this.frequency.value);
                start.call(this, at);
            };
        }"""
        )
        page.click("#tab-log")  # permits sound
        for size in SIZES:
            resize(page, size)
            expect(badge).to_be_in_viewport(ratio=1)
        assert_abort_in_reach(page, "waiting")
        resize(page, (390, 844))
        badge.click()
        expect(page.locator("#panel-vehicles .question")).to_be_visible()
        state_view(page, "waiting")
        assert_accessible(page, "a plan that waits")
        resize(page, (1440, 900))
        page.locator("#panel-vehicles .question").get_by_role("button", name="Refuse").click()
        page.get_by_role("button", name="Plan and send now").click()
        wait_for(lambda: 660 in page.evaluate("window.sounded"), 60, "a new plan sounds")
        seen.complaints[:] = [each for each in seen.complaints if "409" not in each]


def test_a_burn_and_an_alarm_are_accessible(
    chromium: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with (
        running(tmp_path_factory.mktemp("burn"), BURN, 2) as service,
        page_of(chromium, service.address, service.boss, (1440, 900)) as (page, seen),
    ):
        service.post("abort")
        expect(page.locator(".alarm").first).to_be_visible()
        for theme in THEMES:
            set_theme(page, theme)
            expect(page.locator(".alarm").first).to_be_visible()
            assert_accessible(page, f"{theme}, burn with an alarm")
        service.process.kill()
        expect(page.locator("#top .link.lost")).to_be_visible()
        assert_accessible(page, "lost service")
        seen.complaints.clear()  # errors of requests without a response


def test_the_page_is_small_and_its_first_paint_is_early(chromium: Browser, fire: Service) -> None:
    context = chromium.new_context()
    page: Any = context.new_page()
    page.goto(f"{fire.address}/#token={fire.boss}")
    page.wait_for_selector("#map[data-ready]")
    measured = page.evaluate(
        """() => ({
        paint_ms: performance.getEntriesByName("first-contentful-paint")[0].startTime,
        bytes: performance.getEntriesByType("navigation")
            .concat(performance.getEntriesByType("resource"))
            .filter((each) => !each.name.includes("/api/"))
            .reduce((sum, each) => sum + each.transferSize, 0),
    })"""
    )
    assert 100_000 < measured["bytes"] < 1_500_000
    assert measured["paint_ms"] < 1000 * MACHINE
    context.close()


def test_the_token_is_asked_for_accessibly(chromium: Browser, fire: Service) -> None:
    context = chromium.new_context()
    page: Any = context.new_page()
    page.goto(fire.address)
    expect(page.locator("#login")).to_be_visible()
    assert_accessible(page, "login")
    context.close()
