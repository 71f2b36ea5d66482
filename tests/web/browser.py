"""Headless Chromium, and actions of a user on the map."""

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from tests.patience import PATIENCE_S

CHROMIUM = shutil.which("chromium")
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
READY_MS = PATIENCE_S * 1e3 / 2  # test machines may be busy
expect.set_options(timeout=READY_MS)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser; skip the test if there is none."""
    if CHROMIUM is None:
        pytest.skip("no chromium; install it by: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


class Seen:
    """The requests and errors of a page."""

    def __init__(self, context: BrowserContext) -> None:
        self.hosts: set[str] = set()
        self.complaints: list[str] = []
        context.on("request", lambda request: self.hosts.add(_host(request.url)))
        context.on(
            "console",
            lambda message: (
                self.complaints.append(message.text)
                if message.type in ("error", "warning")
                else None
            ),
        )
        context.on("weberror", lambda error: self.complaints.append(str(error.error)))


def _host(url: str) -> str:
    parts = urlsplit(url)
    return parts.hostname or parts.scheme


@contextmanager
def page_of(
    browser: Browser, address: str, token: str, size: tuple[int, int], touch: bool = False
) -> Iterator[tuple[Page, Seen]]:
    """Open the map in a separate window and wait until it is drawn; check requests and errors."""
    viewport: Any = {"width": size[0], "height": size[1]}
    context = browser.new_context(viewport=viewport, has_touch=touch)
    seen = Seen(context)
    page = context.new_page()
    page.goto(f"{address}/#token={token}")
    page.wait_for_selector("#map[data-ready]", timeout=READY_MS)
    assert "token" not in page.url
    yield page, seen
    context.close()
    assert seen.hosts <= {"127.0.0.1", "blob", "data"}, seen.hosts
    assert not seen.complaints, seen.complaints


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
