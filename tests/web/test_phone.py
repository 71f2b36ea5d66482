"""ABORT on phones: fully visible, on top and without scrolling, with any panel or message."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from tests.web import browser as screen
from tests.web.browser import NO_RESPONSE, Seen, page_of
from tests.web.service import BURN, Service, running

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

SIZES = ((320, 568), (360, 640), (375, 667), (390, 844), (412, 915), (430, 932), (640, 360))
WIDER = ((568, 320), (844, 390), (932, 430), (900, 600), (1180, 820))
LONG_NAME = BURN.replace('name = "burn"', 'name = "north-western-slope-of-the-upper-valley"', 1)
PANELS = ("Vehicles", "Burn", "Fire", "Sensors", "Planner", "Log")
WHERE = """() => {
    const abort = document.getElementById("abort");
    const { left, top, right, bottom } = abort.getBoundingClientRect();
    const above = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    return {
        left, top, right, bottom, width: innerWidth, height: innerHeight,
        isTopmost: above === abort, above: above?.outerHTML.slice(0, 100),
        scrolls: document.documentElement.scrollWidth > innerWidth,
    };
}"""


@pytest.fixture(scope="module")
def burn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running(tmp_path_factory.mktemp("phone"), LONG_NAME, 1) as service:
        yield service


@pytest.fixture(scope="module")
def phone(burn: Service) -> Iterator[tuple[Page, Seen]]:
    with (
        screen.chromium() as browser,
        page_of(browser, burn.address, burn.boss, SIZES[0], touch=True) as opened,
    ):
        yield opened


def assert_abort_in_reach(page: Page, what: str) -> None:
    for width, height in (*SIZES, *WIDER):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(f"innerWidth === {width} && innerHeight === {height}")
        # The map gets its new size with the next frame, which a busy machine draws later.
        page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")
        found = page.evaluate(WHERE)
        where = f"{what}, {width} x {height}: {found}"
        assert 0 <= found["left"] <= found["right"] - 100 <= width - 100, where
        assert 0 <= found["top"] <= found["bottom"] - 44 <= height - 44, where
        assert found["isTopmost"], where
        assert not found["scrolls"], where


@pytest.mark.parametrize("panel", PANELS)
def test_abort_is_in_reach_on_every_panel(phone: tuple[Page, Seen], panel: str) -> None:
    page, _ = phone
    page.get_by_role("tab", name=panel).evaluate("tab => tab.click()")
    expect(page.locator(f"#panel-{panel.lower()}")).to_be_attached()
    assert_abort_in_reach(page, panel)


def test_abort_is_in_reach_while_help_is_open_and_while_it_is_armed(
    phone: tuple[Page, Seen],
) -> None:
    page, _ = phone
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    assert_abort_in_reach(page, "help")
    page.keyboard.press("Escape")
    page.set_viewport_size({"width": 320, "height": 568})
    page.tap("#abort")
    expect(page.locator("#abort")).to_have_text("PRESS AGAIN")
    assert page.evaluate(WHERE)["left"] >= 0


def test_an_order_that_is_to_be_confirmed_is_asked_about_and_sent_again(
    phone: tuple[Page, Seen],
) -> None:
    """The reply of the service to an order that would end a mode selected by the autopilot."""
    page, _ = phone
    asked: list[Any] = []

    def answered(route: Route) -> None:
        asked.append(json.loads(route.request.post_data or ""))
        done = bool(asked[-1].get("confirmed"))
        words = "resume: sent" if done else "confirm: kestrel is in RTL by its failsafe. Resume?"
        route.fulfill(json={"ok": True, "messages": [words], "confirm": not done})

    page.route("**/vehicles/kestrel/resume", answered)
    page.set_viewport_size({"width": 360, "height": 640})
    page.get_by_role("tab", name="Vehicles").evaluate("tab => tab.click()")
    resume = page.locator("#panel-vehicles").get_by_role("button", name="Resume").nth(1)
    question = page.locator("#question")

    resume.evaluate("button => button.click()")
    expect(question).to_contain_text("kestrel is in RTL by its failsafe. Resume?")
    assert_abort_in_reach(page, "question")
    question.get_by_role("button", name="No").tap()
    expect(page.locator("#message")).to_contain_text("not confirmed, no order sent")
    expect(question).to_be_hidden()
    assert asked == [{}]

    resume.evaluate("button => button.click()")
    question.get_by_role("button", name="Yes").tap()
    expect(page.locator("#message")).to_contain_text("resume: sent")
    assert asked == [{}, {}, {"confirmed": True}]
    page.unroute("**/vehicles/kestrel/resume")


def test_abort_is_in_reach_when_the_service_is_lost(
    phone: tuple[Page, Seen], burn: Service
) -> None:
    page, seen = phone
    burn.process.kill()
    expect(page.locator("#top .link.lost")).to_be_visible()
    expect(page.locator("#alarms .alarm").first).to_be_visible()
    assert_abort_in_reach(page, "lost")
    seen.ignore(NO_RESPONSE)
