"""The display of the map: units, colours, sizes, and what the card of a vehicle states."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, expect

from tests.web.browser import (
    Seen,
    context_of,
    draw,
    kill_service,
    page_of,
    place_of,
    record_sounds,
    show_log,
)
from tests.web.readability import (
    axe_problems,
    cut_texts,
    small_targets,
    weak_borders,
    weak_texts,
)
from tests.web.service import BURN, FIRE, Service, running, wait_for
from tests.web.test_map import state_view
from tests.web.test_phone import WHERE, assert_abort_in_reach

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

SIZES = (
    *((360, 640), (390, 844), (768, 1024), (1024, 768), (1440, 900)),
    *((640, 360), (844, 390), (1024, 1366), (900, 1440)),
)
THEMES = ("day", "night", "contrast")
PANELS = ("vehicles", "fire", "sensors", "planner", "log")
LANGUAGES = {  # the browser's locale: name, ABORT, the fire's area
    "es-ES": ("Español", "ABORTAR", r"Fuego [\d.,]+ ha"),
    "pt-BR": ("Português", "ABORTAR", r"Fogo [\d.,]+ ha"),
}
IMPORTANCE = {
    "at_us": 0,
    "vehicle": "hawk",
    "rule": "islam_hu_damped",
    "importance_back": 12.34,
    "importance_front": 0.5,
    "cells": [[36.4, -84.1, 12.34], [36.4, -84.1, 0.5]],
}
NARROWEST = ((360, 640), (640, 360), (1024, 768))
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
BELOW_ABORT = """[...document.querySelectorAll("#top :not(#abort)")].filter((one) => {
    const [abort, box] = [document.getElementById("abort"), one].map((each) =>
        each.getBoundingClientRect());
    const isBelow = box.right > abort.left && box.top < abort.bottom;
    return one.checkVisibility() && box.width > 1 && isBelow;
}).map((one) => one.outerHTML.slice(0, 80))"""
RINGS = """[...new Set(missionMap.querySourceFeatures('rings')
  .map((each) => each.properties.label).filter(Boolean))]"""


@pytest.fixture(scope="module")
def fire(chromium: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running(tmp_path_factory.mktemp("display"), FIRE, 5) as service:
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
    show_log(page, "note")
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


def test_a_note_with_a_photo_shows_it_on_the_map_and_from_the_log(
    desktop: tuple[Page, Seen], fire: Service, tmp_path: Path
) -> None:
    page, seen = desktop
    photo, text = tmp_path / "bridge.jpg", tmp_path / "text.jpg"
    Image.linear_gradient("L").resize((640, 480)).convert("RGB").save(photo)
    text.write_text("not a photo", encoding="utf-8")
    centre = page.evaluate("(({ lat, lng }) => [lat, lng])(missionMap.getCenter())")
    for file, message in ((text, "is not a photo; send JPEG, PNG or WebP"), (photo, "Note: done")):
        page.click("#tools .note")
        draw(page, [place_of(page, *centre)])
        page.fill("#entered", "bridge closed")
        page.set_input_files("#note-photo", file)
        assert not small_targets(page)
        assert_accessible(page, "question for a note")
        page.get_by_role("button", name="Add").click()
        expect(page.locator("#message")).to_contain_text(message)
    seen.complaints[:] = [each for each in seen.complaints if "422" not in each]
    page.click("#tools .move")
    layers = "missionMap.queryRenderedFeatures({ layers: ['notes-photo'] }).length"
    wait_for(lambda: page.evaluate(layers) > 0, 30, "the note with its photo is drawn")
    shown = page.locator("#photo img")

    def opens() -> bool:
        page.mouse.click(*place_of(page, *centre))  # a banner may move the map before the click
        page.wait_for_timeout(1000)
        return shown.is_visible()

    wait_for(opens, 30, "the photo is shown")
    expect(shown).to_have_attribute("alt", "Photo of the note: bridge closed")
    assert shown.evaluate("image => image.decode().then(() => image.naturalWidth)") == 640
    state_view(page, "photo")
    assert_accessible(page, "photo")
    page.keyboard.press("Escape")
    expect(page.locator("#photo")).to_be_hidden()
    show_log(page, "note")
    line = page.locator("#panel-log li").filter(has_text="bridge closed")
    expect(line).not_to_contain_text(".jpg")
    line.get_by_role("button", name="Photo").click()
    expect(shown).to_be_visible()
    resize(page, (360, 640))
    assert_abort_in_reach(page, "photo")
    expect(page.locator("#photo").get_by_role("button", name="Close")).to_be_in_viewport(ratio=1)
    resize(page, (1440, 900))
    page.keyboard.press("Escape")


def test_colours_follow_the_system_until_they_are_chosen(chromium: Browser, fire: Service) -> None:
    with context_of(chromium, color_scheme="dark") as context:
        page = context.new_page()
        page.goto(f"{fire.address}/#token={fire.boss}")
        expect(page.locator("html")).to_have_attribute("data-theme", "night")
        page.wait_for_selector("#map[data-ready]")
        page.click("button.settings")
        page.get_by_role("button", name="High contrast").click()
        expect(page.locator("html")).to_have_attribute("data-theme", "contrast")
        page.reload()
        expect(page.locator("html")).to_have_attribute("data-theme", "contrast")


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


def opens_settings(page: Page, shown: Locator) -> bool:
    """Open the display settings; on a busy machine the button may move before the click."""
    if not shown.is_visible():
        page.click("button.settings")
    return shown.is_visible()


@pytest.mark.parametrize("locale", LANGUAGES)
def test_the_page_is_in_the_language_of_the_browser_and_fits(
    chromium: Browser, fire: Service, locale: str
) -> None:
    with page_of(chromium, fire.address, fire.boss, (1440, 900), locale=locale) as (page, _):
        name, abort, area = LANGUAGES[locale]
        expect(page.locator("html")).to_have_attribute("lang", locale[:2])
        expect(page.locator("#abort")).to_have_text(abort)
        expect(page.locator("#top .size")).to_have_text(re.compile(area))
        page.route("**/importance", lambda route: route.fulfill(json=IMPORTANCE))
        expect(page.locator(".strip")).to_have_attribute(
            "aria-label", re.compile(r"\b12,3\b.*\b0,500\b")
        )
        page.unroute("**/importance")
        chosen = page.get_by_role("button", name=name)
        for size in NARROWEST:
            resize(page, size)
            for panel in PANELS:
                page.locator(f"#tab-{panel}").evaluate("tab => tab.click()")
                assert not small_targets(page), (size, panel)
                assert not cut_texts(page), (size, panel)
                assert page.evaluate(TOO_WIDE) == [], (size, panel)
            assert page.evaluate(BELOW_ABORT) == [], size
            wait_for(lambda: opens_settings(page, chosen), 30, "the display settings are shown")
            expect(chosen).to_have_attribute("aria-pressed", "true")
            assert not cut_texts(page), (size, "settings")
            page.keyboard.press("Escape")
            expect(chosen).to_be_hidden()
        assert_accessible(page, locale)
        assert_abort_in_reach(page, locale)


def test_the_language_is_chosen_and_remembered(chromium: Browser, fire: Service) -> None:
    with page_of(chromium, fire.address, fire.boss, (1024, 768)) as (page, _):
        expect(page.locator("#tab-vehicles")).to_have_text("Vehicles")
        page.click("button.settings")
        page.get_by_role("button", name="Español").click()
        expect(page.locator("#tab-vehicles")).to_have_text("Aeronaves")
        page.wait_for_selector("#map[data-ready]")
        page.reload()
        expect(page.locator("#tab-vehicles")).to_have_text("Aeronaves")
        page.wait_for_selector("#map[data-ready]")
        page.click("button.settings")
        page.get_by_role("button", name="English").click()
        expect(page.locator("#tab-vehicles")).to_have_text("Vehicles")
        page.wait_for_selector("#map[data-ready]")


@pytest.mark.parametrize("size", [(360, 640), (640, 360), (1024, 768), (1440, 900)])
def test_the_tour_opens_at_the_first_visit_and_can_be_skipped(
    chromium: Browser, fire: Service, size: tuple[int, int]
) -> None:
    viewport = {"width": size[0], "height": size[1]}
    with context_of(chromium, tour_seen=False, viewport=viewport, locale="es-ES") as context:
        page: Any = context.new_page()
        page.goto(f"{fire.address}/#token={fire.boss}")
        tour, marked = page.locator("#tour"), page.locator(".toured")
        expect(tour).to_be_visible()
        seen = []
        for step in range(1, 8):
            expect(tour.locator(".place")).to_have_text(f"{step} / 7")
            expect(tour).to_be_in_viewport(ratio=1)
            seen.append(marked.evaluate("one => one.id || one.className"))
            assert not cut_texts(page), seen
            assert not small_targets(page), seen
            assert page.evaluate(WHERE)["isTopmost"], seen  # ABORT
            if step in (1, 5):
                assert_accessible(page, f"tour, {seen}")
                state_view(page, f"tour-{size[0]}-{step}")
            page.keyboard.press("ArrowRight" if step == 2 else "Enter")
        assert seen[:6] == ["top", "abort", "map", "time", "tools", "side"]
        expect(tour).to_be_hidden()
        expect(marked).to_have_count(0)
        page.reload()
        page.wait_for_selector("#map[data-ready]")
        expect(tour).to_be_hidden()
        page.goto(f"{fire.address}/?again#token={fire.boss}&tour")
        expect(tour).to_be_visible()
        assert "tour" not in page.url
        page.keyboard.press("Escape")
        expect(tour).to_be_hidden()
        page.click("button.settings")
        page.get_by_role("button", name="Recorrido del mapa").click()
        expect(tour.locator(".place")).to_have_text("1 / 7")
        tour.get_by_role("button", name="Omitir").click()
        expect(tour).to_be_hidden()


def test_waiting_plans_have_a_badge_and_a_sound_at_every_size(
    chromium: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with (
        running(tmp_path_factory.mktemp("waiting"), APPROVED, 5) as service,
        page_of(chromium, service.address, service.boss, (1440, 900)) as (page, seen),
    ):
        badge = page.locator("#waiting")
        expect(badge).to_have_text(re.compile(r"^[12] plans? waits?$"))
        record_sounds(page)
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
        seen.ignore("status of 409")


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
        kill_service(service, page, seen)
        expect(page.locator("#top .link.lost")).to_be_visible()
        assert_accessible(page, "lost service")


def test_the_page_is_small_and_is_painted(chromium: Browser, fire: Service) -> None:
    with context_of(chromium) as context:
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
        assert measured["paint_ms"] > 0.0


def test_the_token_is_asked_for_accessibly(chromium: Browser, fire: Service) -> None:
    with context_of(chromium) as context:
        page: Any = context.new_page()
        page.goto(fire.address)
        expect(page.locator("#login")).to_be_visible()
        assert_accessible(page, "login")
