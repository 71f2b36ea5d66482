"""Burn units from settings; an invalid unit is reported in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from mission_service.config.sections import BurnSection, Circle, Station
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.burn_unit import BurnUnit, ExclusionCircle, burn_unit_of
from tests.service.burns import SETTINGS, unit
from tests.service.fires import LAND, drawn

CHIEF = (Station(name="chief", lat_deg=36.0, lon_deg=-87.0),)


def corners(*places: tuple[float, float]) -> Any:
    """Return places in metres east and south of (20, 20) of the grid as (lat, lon)."""
    x0, y0 = LAND.xy_of(20, 20)
    return tuple(LAND.lat_lon_of(x0 + east, y0 - south) for east, south in places)


SQUARE = corners((0, 0), (300, 0), (300, 200), (0, 200))


def burn(**given: Any) -> BurnSection:
    return BurnSection(stations=CHIEF, **({"unit": SQUARE} | given))


def test_a_unit_from_corners() -> None:
    circle = Circle(name="pump", lat_deg=SQUARE[0][0], lon_deg=SQUARE[0][1], radius_m=30.0)
    fence = corners((-50, -50), (350, -50), (350, 250), (-50, 250))
    found = burn_unit_of(burn(people=(circle,), fence=fence), LAND, home=SQUARE[1])
    assert found.area.area == pytest.approx(60_000.0, rel=1e-3)
    west, _, _, north = found.area.bounds
    inside = np.array([[west + 150.0, north - 100.0]])
    assert found.may_drop(inside).all()
    assert found.people[0].radius_m == 30.0
    assert not found.may_drop(np.array([[west + 20.0, north - 20.0]])).any()


def test_a_unit_from_a_file_with_no_drop_areas(tmp_path: Path) -> None:
    x0, y0 = LAND.xy_of(20, 20)
    area = shapely.box(x0, y0, x0 + 200.0, y0 + 100.0)
    pond = shapely.box(x0 + 80.0, y0 + 40.0, x0 + 120.0, y0 + 60.0)
    found = burn_unit_of(
        BurnSection(
            stations=CHIEF,
            unit_file=drawn(tmp_path / "unit.geojson", area),
            no_drop_file=drawn(tmp_path / "pond.geojson", pond),
        ),
        LAND,
    )
    assert found.area.area == pytest.approx(20_000.0, rel=1e-6)
    at = np.array([[x0 + 100.0, y0 + 50.0], [x0 + 100.0, y0 + 64.0], [x0 + 100.0, y0 + 66.0]])
    assert found.may_drop(at).tolist() == [False, False, True]
    line = drawn(tmp_path / "line.geojson", shapely.LineString([(x0, y0), (x0 + 9.0, y0)]))
    with pytest.raises(MissionServiceError, match=r"line\.geojson: feature 1 is a LineString"):
        burn_unit_of(BurnSection(stations=CHIEF, unit_file=line), LAND)


@pytest.mark.parametrize(
    ("given", "error_text"),
    [
        ({"unit": corners((0, 0), (300, 200), (300, 0), (0, 200))}, "unit: Self-intersection at"),
        ({"unit": corners((0, 0), (100, 100), (200, 200))}, "unit: has no area|Self-intersection"),
        ({"unit": ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0))}, r"corner 1 .* outside the landscape"),
        ({"edge_m": 120.0}, "no part of the unit .* is available for drops"),
        ({"fence": corners((400, 0), (500, 0), (500, 100))}, "home is .* outside the fence"),
        ({"fence": corners((-60, 0), (-5, 60), (-60, 60))}, "no part of the unit is inside"),
    ],
)
def test_invalid_input_is_reported_in_one_line(given: dict[str, Any], error_text: str) -> None:
    home = corners((-50, 50))[0]
    with pytest.raises(MissionServiceError, match=error_text) as error:
        burn_unit_of(burn(**given), LAND, home=home)
    assert "\n" not in str(error.value)


def test_corners_submitted_later_replace_those_configured() -> None:
    small = corners((0, 0), (100, 0), (100, 100), (0, 100))
    assert burn_unit_of(burn(), LAND, corners=small).area.area == pytest.approx(10_000.0, rel=1e-3)


def test_droppable_is_never_more_than_may_drop_allows() -> None:
    """The case has a concave unit, a hole, a no-drop area, a person, and a fence across it."""
    area = shapely.Polygon([(0, 0), (100, 0), (100, 80), (50, 30), (0, 80)])
    made = BurnUnit(
        area.difference(shapely.Point(20, 20).buffer(6.0)),
        shapely.box(70, 10, 80, 20),
        shapely.box(-10, -10, 85, 90),
        (ExclusionCircle("chief", 50.0, 12.0, 8.0),),
        5.0,
    )
    random = np.random.default_rng(1)
    places = random.uniform((-10, -10), (110, 90), (20_000, 2))
    shown = shapely.covers(made.droppable, shapely.points(places))
    allowed = made.may_drop(places)
    assert not (shown & ~allowed).any()
    assert (allowed & ~shown).mean() < 0.002
    assert 0.1 < allowed.mean() < 0.4


def test_the_digest_is_of_all_that_matters() -> None:
    one = unit()
    digests = {
        one.digest(SETTINGS),
        one.digest(SETTINGS.model_copy(update={"speed_m_s": 4.0})),
        one.with_people((ExclusionCircle("a", 1.0, 2.0, 3.0),)).digest(SETTINGS),
        one.with_people((ExclusionCircle("a", 1.0, 2.5, 3.0),)).digest(SETTINGS),
        unit(fence=one.area).digest(SETTINGS),
        unit(no_drop=one.area).digest(SETTINGS),
        unit(edge_m=6.0).digest(SETTINGS),
    }
    assert len(digests) == 7
    assert unit().digest(SETTINGS) == one.digest(SETTINGS)
