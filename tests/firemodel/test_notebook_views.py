"""Landscapes, fires and fronts at the end of a notebook's cell: a picture and a table of facts."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import firemodel
from firemodel.outputs.notebook_views import fire_facts, landscape_facts
from firemodel.spread.fire_scheme import Fire
from tests.firemodel.grids import landscape, steady


@pytest.fixture(scope="module")
def fire() -> Fire:
    return firemodel.burn(landscape(), steady(), duration_s=1800.0)


@pytest.mark.parametrize("lit", [True, False])
def test_a_picture_is_a_png_with_colours(fire: Fire, lit: bool) -> None:
    thing = fire if lit else landscape()
    picture = Image.open(io.BytesIO(thing._repr_png_()))
    assert picture.format == "PNG"
    assert 600 < picture.width < 1000
    assert len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 50


def test_equal_fires_have_equal_pictures(fire: Fire) -> None:
    assert fire._repr_png_() == fire.copy()._repr_png_()


def test_a_picture_of_a_fire_that_has_not_begun() -> None:
    assert firemodel.burn(landscape(), duration_s=0.0)._repr_png_().startswith(b"\x89PNG")


def test_the_facts_of_a_landscape() -> None:
    land = landscape()
    rows, cols = land.shape
    facts = landscape_facts(land)
    assert facts["grid"].startswith(f"{rows} x {cols} cells of {land.cell_size_m:g} m")
    assert re.fullmatch(r"-?\d+\.\d{5}, -?\d+\.\d{5} \(WGS 84\)", facts["centre"])
    assert "100 %" in facts["fuel models"]
    gradient = landscape_facts(replace(land, elevation_m=None, gradient=land.gradient))
    assert gradient["elevation"] == "none"


def test_only_the_most_frequent_fuels_are_listed() -> None:
    land = landscape()
    fuel = land.fuel_model.copy()
    fuel[0, :7] = [1, 2, 3, 5, 6, 8, 9]
    assert landscape_facts(replace(land, fuel_model=fuel))["fuel models"].endswith("others")


def test_the_facts_of_a_fire_agree_with_its_front(fire: Fire) -> None:
    front = fire.front(fire.time_s)
    facts = fire_facts(fire)
    assert facts["time"] == "1800 s (0.50 h)"
    assert facts["burned area"].startswith(f"{front.area / 1e4:,.1f} ha")
    assert facts["perimeter"] == f"{front.length / 1e3:.2f} km in 1 part"


def test_html_has_the_facts_and_the_picture_and_no_foreign_markup(fire: Fire) -> None:
    text = fire._repr_html_()
    assert "data:image/png;base64," in text
    assert "AnyAngleFire" in text
    named = replace(landscape(), crs='+proj=utm +zone=16 +datum=WGS84 +units=m +title="<b>"')
    assert "<b>" not in named._repr_html_()


def test_a_front_draws_itself(fire: Fire) -> None:
    assert fire.front(900.0)._repr_svg_().startswith("<svg")
