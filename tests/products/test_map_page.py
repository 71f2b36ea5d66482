"""Pages of maps in several projections, and of fires of several sizes."""

import io

import numpy as np
import pytest
from pypdf import PdfReader

from firemodel.landscape.landscape import transformers
from mission_service.products.incident import Incident
from mission_service.products.map_page import A4, LETTER, SCALES, Page, draw_page, frame_of
from tests.products.incidents import COLS, ROWS, growing, incident, land


def text_of(found: Incident, page: Page = LETTER) -> str:
    """Return the text of a page."""
    data = io.BytesIO()
    draw_page(found, page).figure.savefig(data, format="pdf")
    data.seek(0)
    return str(PdfReader(data).pages[0].extract_text())


def test_a_page_without_fire_states_it_and_has_no_entries_for_it() -> None:
    nothing = np.full((ROWS, COLS), np.inf)
    text = text_of(incident(arrival_s=nothing, probability=np.zeros((ROWS, COLS))))
    assert "No fire in the estimate at 2026-08-01 16:30 EDT" in text
    assert "Perimeter now" not in text
    assert "probability of fire" not in text
    assert "0.0 acres" in text


def test_the_legend_contains_what_is_drawn() -> None:
    text = text_of(incident())
    for words in ("Perimeter now", "Perimeter at earlier hours", "Hourly forecast", "grass"):
        assert words in text
    without = text_of(incident(forecast_s=0.0))
    assert "Forecast" not in without
    assert "forecast" not in without
    assert "Drop" not in text
    assert "heat" not in text


def test_a_long_name_is_shortened_and_signs_are_no_formula() -> None:
    text = text_of(incident(name="Creek $x^2$ <& " + "long " * 40))
    assert "Creek $x^2$ <&" in text
    assert "…" in text


def test_a_forecast_beyond_the_data_is_stated() -> None:
    assert "ends at the edge of the data" in text_of(incident())
    slow = growing(land(), 0.01)
    probability = (slow <= 16_000.0).astype(float)
    inside = text_of(incident(arrival_s=slow, probability=probability))
    assert "ends at the edge of the data" not in inside


@pytest.mark.parametrize("page", [LETTER, A4])
def test_the_frame_has_a_usual_scale_and_contains_the_fire(page: Page) -> None:
    found = incident()
    scale, (west, east, *_) = frame_of(found, 7.0, 6.0)
    assert scale in SCALES
    assert (east - west) * 1e3 / (7.0 * 0.0254) == pytest.approx(scale)
    assert west < 0.5 * COLS * 0.03 < east
    drawn = draw_page(found, page)
    box = drawn.axes.get_position()
    width_m = (drawn.frame[1] - drawn.frame[0]) * 1e3
    stated = width_m / (box.width * page.width_in * 0.0254)
    assert round(stated) in SCALES
    assert f"1:{round(stated):,}" in text_of(found, page)


@pytest.mark.parametrize(
    ("crs", "lat_deg", "lon_deg", "zone"),
    [
        ("EPSG:5070", 39.5, -121.5, "UTM zone 10N"),  # LANDFIRE, far from its central meridian
        ("EPSG:32756", -33.8, 151.2, "UTM zone 56S"),
        ("EPSG:3035", 39.0, 22.0, "UTM zone 34N"),
    ],
)
def test_maps_in_other_projections(crs: str, lat_deg: float, lon_deg: float, zone: str) -> None:
    x_m, y_m = transformers(crs)[1].transform(lon_deg, lat_deg)
    drawn = draw_page(incident(land(crs, x_m, y_m)), LETTER)
    texts = [text.get_text() for text in (*drawn.figure.texts, *drawn.axes.texts)]
    assert any(zone in text for text in texts)
    # Each edge has coordinates: at least two labels of eastings and of northings in km.
    labels = [text for text in drawn.axes.texts if text.get_color() == "#1565c0"]
    assert sum(text.get_rotation() == 0.0 for text in labels) >= 2
    assert sum(text.get_rotation() == 90.0 for text in labels) >= 2
    assert len(drawn.axes.get_xticklabels()) >= 1
