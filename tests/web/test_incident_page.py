"""The form for a new incident in a browser: it makes a scenario, and is accessible."""

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from mission_service.cli.incident.incident_commands import created_by_form
from mission_service.config.scenario import load_scenario
from mission_service.interfaces.incident_form import FormServer, uploads_of
from tests.patience import PATIENCE_S
from tests.web.browser import context_of
from tests.web.readability import axe_problems, cut_texts, small_targets, weak_texts

pytestmark = pytest.mark.long


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FormServer]:
    file = tmp_path / "ridge.toml"
    with (
        uploads_of(file) as folder,
        FormServer(
            0, folder, "token-of-the-test", lambda given: created_by_form(file, given)
        ) as it,
    ):
        thread = threading.Thread(target=it.serve_forever)
        thread.start()
        yield it
        it.shutdown()
        thread.join(PATIENCE_S)


def fill(page: Page, **values: str) -> None:
    for label, value in values.items():
        page.get_by_label(label.replace("_", " "), exact=False).first.fill(value)


def complete(page: Page) -> None:
    """Complete all fields but the ground's."""
    fill(page, Wind_speed="5", Blows_from="225", Name="hawk")
    page.get_by_label("Latitude, °", exact=True).fill("36.35")
    page.get_by_label("Longitude, °", exact=True).fill("-84.15")
    fill(page, Latitude_of_the_home="36.36", Longitude_of_the_home="-84.14")


def test_a_user_describes_an_incident_corrects_it_and_saves_it(
    chromium: Browser, server: FormServer, tmp_path: Path
) -> None:
    context = context_of(chromium, viewport={"width": 1024, "height": 768})
    page = context.new_page()
    page.goto(server.address)
    fill(page, West="-84.2", South="36.32", East="-84.1", North="36.4")
    complete(page)
    assert page.locator("#sketch circle").count() == 1
    assert page.locator("#sketch text").text_content() == "hawk"
    page.get_by_label("Blows from").fill("")
    page.get_by_role("button", name="Check and save").click()
    expect(page.locator("#result.refused")).to_have_text("Complete the field: Blows from, °")
    page.get_by_label("Blows from").fill("225")
    page.get_by_label("Wind speed").fill("500")
    page.get_by_role("button", name="Check and save").click()
    expect(page.locator("#result.refused")).to_contain_text("wind_speed_m_s")
    page.get_by_label("Wind speed").fill("5")
    page.get_by_role("button", name="Add an aircraft").click()
    page.get_by_role("button", name="Remove").last.click()
    page.get_by_role("button", name="Check and save").click()
    expect(page.locator("#result.saved")).to_contain_text("mission-service sim")
    assert load_scenario(str(tmp_path / "ridge.toml")).weather[0].wind_from_deg == 225.0
    context.close()


def test_a_perimeter_file_is_sent(chromium: Browser, server: FormServer, tmp_path: Path) -> None:
    ring = [[-84.15, 36.35], [-84.14, 36.35], [-84.14, 36.36], [-84.15, 36.36], [-84.15, 36.35]]
    outline = tmp_path / "the outline.geojson"
    outline.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    context = context_of(chromium, viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.goto(server.address)
    fill(page, West="-84.2", South="36.32", East="-84.1", North="36.4")
    complete(page)
    page.get_by_role("button", name="Perimeter").click()
    page.get_by_label("Perimeter (GeoJSON").set_input_files(outline)
    page.get_by_role("button", name="Check and save").click()
    expect(page.locator("#result.saved")).to_be_visible()
    assert (tmp_path / "ridge-files" / "the_outline.geojson").is_file()
    assert load_scenario(str(tmp_path / "ridge.toml")).fire.perimeter is not None
    context.close()


@pytest.mark.parametrize("theme", ["day", "night", "contrast"])
@pytest.mark.parametrize("size", [(360, 740), (768, 1024), (1440, 900)])
def test_the_form_is_accessible(
    chromium: Browser, server: FormServer, size: tuple[int, int], theme: str
) -> None:
    context = context_of(chromium, viewport={"width": size[0], "height": size[1]}, locale="es-MX")
    context.add_init_script(f"localStorage.setItem('mission-service-theme', '{theme}')")
    page = context.new_page()
    page.goto(server.address)
    expect(page.get_by_role("heading", level=1)).to_have_text("Nuevo incidente")
    for group in ("Terreno llano", "Rásteres", "Archivo meteorológico", "Perímetro"):
        page.get_by_role("button", name=group, exact=True).click()
        assert axe_problems(page) == []
        assert small_targets(page) == []
        assert cut_texts(page) == []
        assert weak_texts(page, 4.5) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    context.close()
