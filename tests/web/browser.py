"""Headless Chromium, and actions of a user on the map."""

import io
import os
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from tests.patience import PATIENCE_S
from tests.web.service import Service, wait_for

CHROMIUM = shutil.which("chromium")
# As root, Chromium raises its own priority above that of the service, which then loses its links.
SAME_PRIORITY = ["setpriv", "--bounding-set=-sys_nice"]
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
]
NO_RESPONSE = "net::ERR_"  # in the error of each request to a service that was killed
LOADED = "missionMap.areTilesLoaded() && missionMap.querySourceFeatures('relief').length > 0"
READY_MS = PATIENCE_S * 1e3 / 2  # test machines may be busy
expect.set_options(timeout=READY_MS)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser; skip the test if there is none."""
    if CHROMIUM is None:
        pytest.skip("no chromium; install it by: apt-get install chromium")
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_started_by(Path(folder)), args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


def _started_by(folder: Path) -> str:
    """Return the program that starts Chromium at the priority of the test."""
    assert CHROMIUM is not None
    if os.geteuid() != 0 or shutil.which(SAME_PRIORITY[0]) is None:
        return CHROMIUM
    script = folder / "chromium"
    script.write_text(f'#!/bin/sh\nexec {shlex.join([*SAME_PRIORITY, CHROMIUM])} "$@"\n')
    script.chmod(0o755)
    return str(script)


class Seen:
    """The requests and errors of a page."""

    def __init__(self, context: BrowserContext) -> None:
        self.hosts: set[str] = set()
        self.complaints: list[str] = []
        self._ignored: list[str] = []
        context.on("request", lambda request: self.hosts.add(_host(request.url)))
        context.on(
            "console",
            lambda message: (
                self._add(f"{message.text} ({message.location.get('url', '')})")
                if message.type in ("error", "warning")
                else None
            ),
        )
        context.on("weberror", lambda error: self._add(str(error.error)))

    def ignore(self, part: str) -> None:
        """Drop the errors that contain this text, past ones and later ones."""
        self._ignored.append(part)
        self.complaints[:] = [each for each in self.complaints if not self._is_ignored(each)]

    def _add(self, complaint: str) -> None:
        if not self._is_ignored(complaint):
            self.complaints.append(complaint)

    def _is_ignored(self, complaint: str) -> bool:
        return any(part in complaint for part in self._ignored)


def _host(url: str) -> str:
    parts = urlsplit(url)
    return parts.hostname or parts.scheme


def context_of(browser: Browser, tour_seen: bool = True, **options: Any) -> BrowserContext:
    """Return a new context that waits as long as a busy machine needs; without the map's tour."""
    context = browser.new_context(**options)
    context.set_default_timeout(READY_MS)
    if tour_seen:
        seen = "localStorage.setItem('mission-service-tour', 'seen')"
        context.add_init_script(f"if (location.protocol !== 'about:') {seen}")
    return context


@contextmanager
def page_of(
    browser: Browser,
    address: str,
    token: str,
    size: tuple[int, int],
    touch: bool = False,
    locale: str = "en-US",
) -> Iterator[tuple[Page, Seen]]:
    """Open the map in a separate window and wait until it is drawn; check requests and errors."""
    viewport: Any = {"width": size[0], "height": size[1]}
    with context_of(browser, viewport=viewport, has_touch=touch, locale=locale) as context:
        seen = Seen(context)
        page = context.new_page()
        page.goto(f"{address}/#token={token}")
        page.wait_for_selector("#map[data-ready]")
        assert "token" not in page.url
        yield page, seen
    assert seen.hosts <= {"127.0.0.1", "blob", "data"}, seen.hosts
    assert not seen.complaints, seen.complaints


def kill_service(service: Service, page: Page, seen: Seen) -> None:
    """Kill a service when the page has loaded what it needs once; later requests may fail."""
    wait_for(lambda: page.evaluate(LOADED), 60, "terrain and relief are loaded")
    seen.ignore(NO_RESPONSE)
    service.process.kill()


def place_of(page: Page, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """Return the position of a place in the window, in pixels."""
    script = """([lon, lat]) => {
        const box = document.getElementById("map").getBoundingClientRect();
        const at = missionMap.project([lon, lat]);
        return [box.x + at.x, box.y + at.y];
    }"""
    x, y = page.evaluate(script, [lon_deg, lat_deg])
    return float(x), float(y)


def draw(page: Page, points: list[tuple[float, float]]) -> None:
    """Draw with the mouse through points of the window."""
    page.mouse.move(*points[0])
    page.mouse.down()
    for point in points[1:]:
        page.mouse.move(*point, steps=3)
    page.mouse.up()


def show_log(page: Page, *kinds: str) -> None:
    """Show the lines of these kinds: links that a busy machine loses fill the log with others."""
    page.click("#tab-log")
    boxes = page.locator("#panel-log .checks input")
    boxes.first.wait_for()
    for box in boxes.all():
        box.set_checked(box.get_attribute("id") in {f"log-{kind}" for kind in kinds})


def pixels(page: Page) -> NDArray[np.int16]:
    """Return the visible map (y, x, RGB)."""
    image = Image.open(io.BytesIO(page.locator("#map").screenshot()))
    return np.asarray(image.convert("RGB"), np.int16)


def share_burned(page: Page) -> float:
    """Return the share of the map in the colour of burned ground: mostly red."""
    red, green, blue = np.moveaxis(pixels(page), 2, 0)
    return float(((red - green > 40) & (abs(green - blue) < 30) & (red > 140)).mean())


def share_expected(page: Page) -> float:
    """Return the share of the map in the colours of the slider's fire: red and green."""
    red, green, blue = np.moveaxis(pixels(page), 2, 0)
    return float(((red - green > 20) & (green - blue > 20)).mean())


def record_sounds(page: Page) -> None:
    """Store the frequencies of the sounds that the page plays in ``window.sounded``."""
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
