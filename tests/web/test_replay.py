"""The page of a replay: it plays, pauses and seeks, and shows a badge."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, Route, expect

from tests.flights.replays import Replay, replayed
from tests.flights.worlds import journal_in
from tests.web import browser as screen
from tests.web.browser import page_of
from tests.web.readability import small_targets, weak_texts
from tests.web.service import wait_for

pytestmark = pytest.mark.long  # a browser that draws without a graphics card


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Replay]:
    log = journal_in(tmp_path_factory.mktemp("flown"))
    with replayed(tmp_path_factory.mktemp("out"), str(log)) as replay:
        yield replay


@pytest.fixture(scope="module")
def page(replay: Replay) -> Iterator[Page]:
    token = (replay.out / "token").read_text(encoding="utf-8").strip()
    address = str(replay.http.base_url).rstrip("/")
    with screen.chromium() as browser, page_of(browser, address, token, (960, 640)) as (page, _):
        page.evaluate("missionMap.setLayoutProperty('hillshade', 'visibility', 'none')")
        yield page


def shown_at(page: Page) -> tuple[float, float]:
    """Return the position at which hawk is drawn, as lon and lat."""
    script = """() => missionMap.getSource("vehicles").serialize().data.features
        .find((one) => one.properties.vehicle === "hawk").geometry.coordinates"""
    lon_deg, lat_deg = page.evaluate(script)
    return float(lon_deg), float(lat_deg)


def track_points(page: Page) -> int:
    """Return the points of all tracks that are drawn."""
    script = """() => missionMap.getSource("tracks").serialize().data.features
        .reduce((sum, one) => sum + one.geometry.coordinates.length, 0)"""
    return int(page.evaluate(script))


def log_s(replay: Replay) -> float:
    state = replay.get("/replay")
    return float(state["log_at_us"] - state["log_begin_us"]) / 1e6


def test_it_cannot_be_mistaken_for_a_live_flight(page: Page) -> None:
    expect(page.locator("#top .badge")).to_have_text(re.compile("REPLAY .*/journal.jsonl"))
    assert page.title().startswith("REPLAY")
    expect(page.locator("#top")).not_to_contain_text("live")
    for name in ("#abort", "#tools", ".orders >> nth=0"):
        expect(page.locator(name)).to_be_hidden()
    page.keyboard.press("Control+Shift+X")
    page.keyboard.press("h")
    expect(page.locator("#message")).not_to_be_visible()
    assert not small_targets(page)
    assert not weak_texts(page)


def test_it_plays_and_pauses(page: Page, replay: Replay) -> None:
    page.select_option("#replay select", "10")
    page.locator("#map canvas.maplibregl-canvas").focus()
    wait_for(lambda: log_s(replay) > 20, 30, "it plays ten times as fast")
    page.keyboard.press("Space")
    wait_for(lambda: replay.get("/replay")["paused"], 10, "it pauses")
    expect(page.locator("#replay .play")).to_have_text("▶ Play")
    there_s = log_s(replay)
    page.wait_for_timeout(500)
    assert log_s(replay) == there_s
    page.locator("#replay .play").click()
    wait_for(lambda: log_s(replay) > there_s + 5, 30, "it goes on")
    page.locator("#replay .play").press("Space")  # only the key of the button
    wait_for(lambda: replay.get("/replay")["paused"], 10, "it pauses again")


def test_a_seek_back_moves_the_vehicle_and_takes_the_future_away(
    page: Page, replay: Replay
) -> None:
    slider = page.locator("#replay input")
    slider.fill("150")
    wait_for(lambda: log_s(replay) == 150, 10, "it is there")
    wait_for(lambda: track_points(page) > 200, 10, "both have flown")
    later = shown_at(page)
    slider.fill("40")
    wait_for(lambda: shown_at(page) != later, 10, "hawk jumps back")
    wait_for(lambda: track_points(page) < 100, 10, "what it flies later is not drawn")
    expect(page.locator("#replay output")).to_have_text("0:40 / 2:40")
    earlier = shown_at(page)
    page.keyboard.press("ArrowRight")
    wait_for(lambda: log_s(replay) == 50, 10, "ten seconds on")
    page.get_by_role("button", name="Ten seconds back").click()
    wait_for(lambda: log_s(replay) == 40, 10, "and back")
    wait_for(lambda: shown_at(page) == earlier, 10, "the same is seen")


def test_an_answer_that_arrives_after_the_jump_changes_nothing(page: Page, replay: Replay) -> None:
    at_40 = shown_at(page)

    def late(route: Route) -> None:
        answer = route.fetch()
        assert answer.json()["seeking"]
        wait_for(lambda: shown_at(page) != at_40, 10, "hawk jumps")
        route.fulfill(response=answer)

    page.route("**/v1/replay", late, times=1)
    with page.expect_request_finished(lambda request: request.url.endswith("/v1/replay")):
        page.locator("#replay input").fill("100")
    expect(page.locator("#replay output")).to_have_text("1:40 / 2:40")


def test_at_the_end_it_stays_and_begins_again(page: Page, replay: Replay) -> None:
    page.select_option("#replay select", "max")
    page.locator("#replay .play").click()
    expect(page.locator("#replay .play")).to_have_text("Play again")
    expect(page.locator("#replay output")).to_have_text("2:40 / 2:40")
    page.select_option("#replay select", "0.5")
    page.locator("#replay .play").click()
    wait_for(lambda: log_s(replay) < 20, 10, "it begins again")
