"""Alarms, keys, pens, units and orders on the map, also when requests fail or are not answered.

The flight is in virtual time and stands still; a test may depend on earlier tests in this file.
"""

import json
import re
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, expect

from mission_service.events import OrderGiven
from mission_service.runtime.state_view import StateView
from tests.api.worlds import scenario_of, world_in
from tests.patience import PATIENCE_S
from tests.web.browser import Seen, draw, page_of, record_sounds
from tests.web.readability import assert_readable
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

SIZE = (1440, 900)
LABELS = """missionMap.querySourceFeatures("airspace").map((each) => each.properties.label)"""
TRACKS = """missionMap.querySourceFeatures("tracks").length"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    scenario = scenario_of("demo")
    world = world_in(tmp_path_factory.mktemp("controls"), scenario)
    world.fly(scenario.deploy_at_s + 120.0)
    with site_of(world) as found:
        yield found


@pytest.fixture(scope="module")
def opened(chromium: Browser, site: Site) -> Iterator[tuple[Page, Seen]]:
    with page_of(chromium, site.address, site.service.tokens["all"], SIZE) as found:
        found[0].evaluate("missionMap.setLayoutProperty('hillshade', 'visibility', 'none')")
        yield found


@pytest.fixture
def page(opened: tuple[Page, Seen]) -> Iterator[Page]:
    found, _ = opened
    yield found
    found.unroute_all(behavior="ignoreErrors")


def view_of(site: Site) -> StateView:
    return site.world.simulation.service.state_view


def change(site: Site, work: Callable[[StateView], None]) -> None:
    """Change the published state, in the thread that serves it."""

    def changes() -> None:
        work(view_of(site))
        site.world.context.ring()

    site.loop.call_soon_threadsafe(changes)


def ask(site: Site, path: str, body: dict[str, Any] | None = None, method: str = "") -> Any:
    """Send a request to the service; return the JSON of the response."""
    headers = {**site.service.headers(), "Content-Type": "application/json"}
    data = None if body is None else json.dumps(body).encode()
    address, method = f"{site.address}/api/v1/{path}", method or ("POST" if data else "GET")
    request = urllib.request.Request(address, data, headers, method=method)
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        return json.load(answer)


def choose_units(page: Page, name: str) -> None:
    page.click("button.settings")
    page.get_by_role("button", name=name, exact=True).click()
    page.keyboard.press("Escape")
    expect(page.locator("#display")).to_be_hidden()


class Silent:
    """Requests to some addresses, the first of which are not answered."""

    def __init__(self, page: Page, address: str, unanswered: int = 1) -> None:
        self.routes: list[Route] = []
        self.unanswered = unanswered
        page.route(address, self._handle)

    def _handle(self, route: Route) -> None:
        self.routes.append(route)
        if len(self.routes) > self.unanswered:
            route.continue_()


def battery_alarms(page: Page, severity: str = "") -> Locator:
    """Return the shown battery alarms; on a slow machine, there may be others about old data."""
    return page.locator(f".alarm{severity}").filter(has_text="battery")


def test_an_alarm_that_becomes_severe_is_shown_and_sounds_again(page: Page, site: Site) -> None:
    record_sounds(page)
    page.click("#tab-vehicles")  # permits sound
    shown = battery_alarms(page)
    change(site, lambda view: view.alarm("battery/hawk", "hawk: battery low"))
    expect(battery_alarms(page, ".warning")).to_contain_text("battery low")
    shown.get_by_role("button", name="Acknowledge", exact=True).click()
    expect(shown).to_have_count(0)
    wait_for(lambda: view_of(site).alarms["battery/hawk"].acknowledged_by, 30, "it is acknowledged")
    page.evaluate("window.sounded = []")
    change(site, lambda view: view.alarm("battery/hawk", "hawk: battery empty", "severe"))
    expect(battery_alarms(page, ".severe")).to_contain_text("battery empty")
    wait_for(lambda: 960 in page.evaluate("window.sounded"), 30, "it sounds")
    page.keyboard.press("k")
    expect(shown).to_have_count(0)
    # An acknowledged alarm that becomes a warning stays acknowledged, until it is severe again.
    change(site, lambda view: view.alarm("battery/hawk", "hawk: battery low"))
    expect(page.locator("#alarms.quiet")).to_contain_text("battery low")
    expect(shown).to_have_count(0)
    change(site, lambda view: view.alarm("battery/hawk", "hawk: battery empty", "severe"))
    expect(battery_alarms(page, ".severe")).to_contain_text("battery empty")
    change(site, lambda view: view.clear_alarm("battery/hawk"))
    expect(shown).to_have_count(0)


def test_a_warning_that_was_not_acknowledged_becomes_a_severe_row(page: Page, site: Site) -> None:
    change(site, lambda view: view.alarm("battery/hawk", "hawk: battery low"))
    expect(battery_alarms(page, ".warning")).to_have_count(1)
    change(site, lambda view: view.alarm("battery/hawk", "hawk: battery empty", "severe"))
    expect(battery_alarms(page, ".severe")).to_have_text(re.compile("^ALARM.*battery empty"))
    change(site, lambda view: view.clear_alarm("battery/hawk"))
    expect(battery_alarms(page)).to_have_count(0)


def test_more_acknowledgements_than_the_limit_of_requests_are_all_sent(
    page: Page, site: Site
) -> None:
    alarms = [f"sensor/{number}" for number in range(25)]

    def raise_all(view: StateView) -> None:
        for key in alarms:
            view.alarm(key, f"{key}: no data")

    change(site, raise_all)
    expect(page.locator("#alarms")).to_contain_text(re.compile(r"and 2\d more in the log"))
    page.keyboard.press("k")
    wait_for(
        lambda: all(view_of(site).alarms[key].acknowledged_by for key in alarms),
        30,
        "all alarms are acknowledged",
    )
    expect(page.locator(".alarm").filter(has_text="sensor/")).to_have_count(0)
    change(site, lambda view: view.clear_all_but())


def test_abort_by_shortcut_leaves_the_button_usable_by_keyboard(page: Page) -> None:
    aborts: list[Route] = []

    def accept(route: Route) -> None:
        aborts.append(route)
        route.fulfill(json={})

    page.route("**/api/v1/abort", accept)
    page.keyboard.press("Control+Shift+X")
    wait_for(lambda: page.evaluate("1") and len(aborts) == 1, 30, "the abort is sent")
    page.focus("#abort")
    page.keyboard.press("Enter")
    expect(page.locator("#abort")).to_have_text("PRESS AGAIN")
    page.keyboard.press("Enter")
    wait_for(lambda: page.evaluate("1") and len(aborts) == 2, 30, "another abort is sent")


def test_an_abort_without_an_answer_is_sent_again(page: Page) -> None:
    silent = Silent(page, "**/api/v1/abort")
    page.click("#abort")
    page.click("#abort")
    expect(page.locator("#message")).to_contain_text(
        "ABORT NOT ACCEPTED (attempt 1): no response from the service."
    )
    expect(page.locator("#message")).to_contain_text("ABORT accepted")
    assert len(silent.routes) == 2


def test_a_state_and_a_stream_without_an_answer_are_requested_again(
    opened: tuple[Page, Seen], page: Page, site: Site
) -> None:
    silent = [Silent(page, "**/api/v1/state"), Silent(page, "**/api/v1/live*")]
    page.reload()
    expect(page.locator("#top .link")).to_have_text("● live")
    wait_for(lambda: page.evaluate("1") and len(silent[1].routes) > 1, 30, "the stream is read")
    assert len(silent[0].routes) > 1
    change(site, lambda view: view.alarm("sensor/1", "sensor: no data"))
    expect(page.locator(".alarm").filter(has_text="sensor: no data")).to_be_visible()
    change(site, lambda view: view.clear_alarm("sensor/1"))
    page.wait_for_selector("#map[data-ready]")


def test_a_track_that_cannot_be_read_is_requested_again_and_the_map_stays(
    opened: tuple[Page, Seen], page: Page
) -> None:
    _, seen = opened
    page.route("**/track?*", lambda route: route.fulfill(status=500, json={"error": "busy"}))
    page.reload()
    page.wait_for_selector("#map[data-ready]")
    wait_for(
        lambda: page.evaluate("1") and any("status of 500" in each for each in seen.complaints),
        30,
        "a track is requested",
    )
    expect(page.locator("#map canvas.maplibregl-canvas")).to_be_visible()
    page.unroute("**/track?*")
    wait_for(lambda: page.evaluate(TRACKS) > 0, 60, "the tracks are shown")
    expect(page.locator("#map")).not_to_contain_text("Cannot display the map")
    seen.ignore("status of 500")


def test_planner_settings_that_others_change_are_shown_and_can_be_set_back(
    page: Page, site: Site
) -> None:
    page.click("#tab-planner")
    field = page.locator("#planner-alpha")
    before = field.input_value()
    ask(site, "planner", {"alpha": 1.75}, "PATCH")
    expect(field).to_have_value("1.75")
    field.fill(before)
    page.get_by_role("button", name="Use from now on").click()
    wait_for(lambda: ask(site, "planner")["alpha"] == float(before), 30, "it is set back")
    page.click("#tab-vehicles")


def test_with_a_pen_the_buttons_of_the_map_keep_their_keys(page: Page) -> None:
    page.click("#tools .burned")
    page.click("#tools .polygon")
    follow = page.locator("button.follow")
    follow.focus()
    page.keyboard.press("Space")
    expect(follow).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Space")
    expect(follow).to_have_attribute("aria-pressed", "false")
    page.locator("canvas.maplibregl-canvas").focus()
    page.keyboard.press("Space")
    expect(page.locator("#announcer")).to_contain_text("Corner 1")
    page.keyboard.press("Escape")
    page.click("#tools .move")


def test_the_limits_of_airspace_and_the_wind_dial_have_the_chosen_units(
    page: Page, site: Site
) -> None:
    lat_deg, lon_deg = page.evaluate("(({ lat, lng }) => [lat, lng])(missionMap.getCenter())")
    corners = [
        (lat_deg + north, lon_deg + east)
        for north, east in ((0, 0), (0.003, 0), (0.003, 0.003), (0, 0.003))
    ]
    ask(site, "airspace/close", {"name": "area", "corners": corners, "ceiling_amsl_m": 1000.0})

    def is_labelled(text: str) -> bool:
        labels = page.evaluate(LABELS)
        return bool(labels) and all(f"ground to {text}\n" in label for label in labels)

    wait_for(lambda: is_labelled("1000 m MSL"), 30, "the limits are metric")
    choose_units(page, "Aviation")
    wait_for(lambda: is_labelled("3281 ft MSL"), 30, "the limits are in feet")
    page.click("#tab-fire")
    dial = page.locator(".dial")

    def drawn(name: str) -> bool:
        """From the west, a quarter of the dial; announcements above it may move it meanwhile."""
        dial.scroll_into_view_if_needed()
        box = dial.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        draw(page, [(x, y), (x - 20 * box["width"] / 180, y)])
        return page.get_by_role("button", name=name, exact=True).count() == 1

    wait_for(lambda: drawn("Set: from 270°, 10 kt"), 30, "a wind in round knots is drawn")
    choose_units(page, "US")
    wait_for(lambda: drawn("Set: from 270°, 11 mph"), 30, "a wind in round miles per hour")
    assert_readable(page, "panel-fire", SIZE)
    choose_units(page, "Metric")
    wait_for(lambda: drawn("Set: from 270°, 5.0 m/s"), 30, "a wind in metres per second")
    page.click("#tab-vehicles")
    ask(site, "airspace/open", {"name": "area"})


def test_longitudes_beyond_the_date_line_are_shown_and_sent_within_180_degrees(
    opened: tuple[Page, Seen], page: Page
) -> None:
    _, seen = opened
    center = page.evaluate("[missionMap.getCenter().toArray(), missionMap.getZoom()]")
    page.evaluate("missionMap.jumpTo({ center: [179.99, 0], zoom: 10 })")
    box = page.locator("#map").bounding_box()
    assert box is not None
    east = (box["x"] + box["width"] / 2 + 150, box["y"] + box["height"] / 2)

    def pointed() -> bool:
        page.mouse.move(*east)
        return bool(re.fullmatch(r".*, -17\d\.\d+", page.locator(".coordinates").inner_text()))

    wait_for(pointed, 30, "the longitude is west")
    sent: list[Any] = []

    def refuse(route: Route) -> None:
        sent.append(route.request.post_data_json)
        route.fulfill(status=422, json={"error": "outside the landscape"})

    page.route("**/fire/preview", refuse)
    page.click("#tools .burned")
    page.click("#tools .point")
    draw(page, [east])
    expect(page.locator("#message")).to_contain_text("outside the landscape")
    ((_, lon_deg),) = sent[0]["points"]
    assert -180.0 <= lon_deg < -179.0
    page.click("#tools .move")
    page.evaluate("([center, zoom]) => missionMap.jumpTo({ center, zoom })", center)
    seen.ignore("status of 422")


def test_caps_lock_does_not_turn_an_order_for_one_vehicle_into_one_for_all(
    page: Page, site: Site
) -> None:
    def press(key: str, shift: bool) -> str:
        """Press a key; return the vehicle of the order that results."""
        count = len(site.world.submitted)
        page.evaluate(
            "([key, shiftKey]) => document.body.dispatchEvent("
            "new KeyboardEvent('keydown', { key, shiftKey, bubbles: true }))",
            [key, shift],
        )
        wait_for(lambda: len(site.world.submitted) > count, 30, "an order")
        order = site.world.submitted[count]
        assert isinstance(order, OrderGiven)
        return order.vehicle

    chosen = page.locator(".vehicles [aria-current=true] strong").inner_text()
    assert press("h", False) == chosen
    assert press("H", False) == chosen  # with Caps Lock
    assert press("H", True) == ""
    assert press("h", True) == ""  # with Caps Lock


def test_a_button_has_no_effect_while_its_request_is_underway(page: Page) -> None:
    silent = Silent(page, "**/vehicles/*/hold", unanswered=3)
    hold = page.locator(".card").get_by_role("button", name="Hold", exact=True)
    hold.focus()
    page.keyboard.press("Enter")
    expect(hold).to_have_attribute("aria-disabled", "true")
    assert_readable(page, "panel-vehicles", SIZE)
    page.keyboard.press("Enter")
    page.wait_for_timeout(500)
    assert len(silent.routes) == 1
    silent.routes[0].fulfill(json={"messages": ["hold ordered"]})
    expect(page.locator("#message")).to_contain_text("hold ordered")
    expect(hold).not_to_have_attribute("aria-disabled", "true")
    expect(hold).to_be_focused()
    page.keyboard.press("Enter")
    expect(hold).to_have_attribute("aria-disabled", "true")
    # An order to another vehicle need not wait.
    page.keyboard.press("n")
    expect(hold).not_to_have_attribute("aria-disabled", "true")
    page.keyboard.press("Enter")
    wait_for(lambda: page.evaluate("1") and len(silent.routes) == 3, 30, "another order")
    names = [route.request.url.split("/")[-2] for route in silent.routes]
    assert len(set(names)) == 2, names
    # Without an answer, the order can be given again.
    expect(hold).not_to_have_attribute("aria-disabled", "true")
    page.keyboard.press("Enter")
    wait_for(lambda: page.evaluate("1") and len(silent.routes) == 4, 30, "a further order")
