"""Checks of the page as it is drawn: sizes of controls, contrast, and the rules of axe-core."""

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

AXE = (
    Path(__file__)
    .parents[2]
    .joinpath("mission_service/interfaces/web/node_modules/axe-core/axe.min.js")
)

# JavaScript: the colour behind an element, and the contrast of two colours (WCAG 2.2).
COLOURS = """
    const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
    const light = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
        .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const behind = (one) => {
        for (let at = one; at; at = at.parentElement) {
            const rgb = numbers(getComputedStyle(at).backgroundColor);
            if (rgb.length === 3 || rgb[3] > 0.8) return rgb;
        }
        return [255, 255, 255];
    };
    const contrast = (a, b) => {
        const [x, y] = [light(a), light(b)];
        return (Math.max(x, y) + 0.05) / (Math.min(x, y) + 0.05);
    };
"""


def axe_problems(page: Page) -> list[str]:
    """Return the serious and critical problems that axe-core finds; skip the test without axe."""
    if not AXE.exists():
        pytest.skip("no axe-core; run make web")
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    found: Any = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")
    return [
        f"{each['impact']}: {each['id']}: {node['html'][:160]}: {node['failureSummary'][-200:]}"
        for each in found["violations"]
        if each["impact"] in ("serious", "critical")
        for node in each["nodes"]
    ]


def weak_borders(page: Page) -> list[str]:
    """Return enabled controls of which no edge has a contrast of 3:1 to what is around them."""
    found: list[str] = page.evaluate(
        "() => {"
        + COLOURS
        + """
        const controls = "button, select, input:not([type=checkbox], [type=range])";
        return [...document.querySelectorAll(controls)]
            .filter((one) => one.checkVisibility() && !one.disabled)
            .filter((one) => !one.closest(".maplibregl-ctrl-group")) // lines between icons
            .filter((one) => parseFloat(getComputedStyle(one).borderTopWidth) > 0)
            .filter((one) => {
                const around = behind(one.parentElement);
                const edges = [numbers(getComputedStyle(one).borderTopColor), behind(one)];
                return edges.every((edge) => contrast(edge, around) < 3);
            })
            .map((one) => one.outerHTML.slice(0, 120));
    }"""
    )
    return found


def small_targets(page: Page) -> list[str]:
    """Return the controls that are too small for a thumb."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll("button, select, input:not([type=checkbox])")]
            .filter((one) => one.checkVisibility())
            .filter((one) => {
                const { width, height } = one.getBoundingClientRect();
                return width < 43.5 || height < 43.5;
            })
            .map((one) => one.outerHTML.slice(0, 120))"""
    )
    return found


def cut_texts(page: Page) -> list[str]:
    """Return controls and texts that are wider than their box."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll(
                "button, select, label, legend, summary, output, strong, p, h2, h3, dt, dd, .tabs")]
            .filter((one) => one.checkVisibility() && getComputedStyle(one).display !== "inline")
            .filter((one) => one.scrollWidth > one.clientWidth + 1)
            .map((one) => one.outerHTML.slice(0, 120))"""
    )
    return found


def assert_readable(page: Page, panel: str, size: tuple[int, int]) -> None:
    """Set the size of the window, and check texts, controls and the width of a panel."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.wait_for_function(f"innerWidth === {size[0]} && innerHeight === {size[1]}")
    too_wide = page.evaluate(
        """panel => [...document.querySelectorAll(`#${panel}, #${panel} *, .tabs`)]
            .filter((one) => one.checkVisibility() && one.scrollWidth > one.clientWidth + 1)
            .filter((one) => getComputedStyle(one).display !== "inline")
            .map((one) => one.outerHTML.slice(0, 120))""",
        panel,
    )
    assert not too_wide, size
    assert not small_targets(page)
    assert not weak_texts(page)


def weak_texts(page: Page, min_contrast: float = 7.0) -> list[str]:
    """Return texts with a lower contrast to their background (WCAG 2.2)."""
    found: list[str] = page.evaluate(
        "(least) => {"
        + COLOURS
        + """
        const weak = [];
        const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
        while (texts.nextNode()) {
            const one = texts.currentNode.parentElement;
            if (!texts.currentNode.data.trim() || !one.checkVisibility()) continue;
            const ratio = contrast(numbers(getComputedStyle(one).color), behind(one));
            if (ratio < least) weak.push(`${ratio.toFixed(1)} ${texts.currentNode.data}`);
        }
        return weak;
    }""",
        min_contrast,
    )
    return found
