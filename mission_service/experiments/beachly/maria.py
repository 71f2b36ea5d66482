"""Test corrections with the Maria fire (California, 2019) as ground truth.

In the model, ellipses grow from all points of the first mapped perimeter. The model has one fuel
and one constant wind, as recorded for that perimeter. Without corrections the model does not match
the later perimeters, because the terrain is steep and the fuel varies. Participants mark points on
each perimeter with random errors. The front error is measured at the following perimeter, before
participants mark points on that perimeter.
"""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses.ellipse import EllipseFire, spreads_of
from firemodel.ellipses.point_observations import BURNING
from firemodel.landscape.readers.shapes import into_crs
from firemodel.physics.rothermel import M_S_PER_MPH
from firemodel.physics.weather import Weather, WeatherStream
from mission_service.experiments.beachly.corrections import (
    MAX_CORRECTIONS,
    MIN_CORRECTIONS,
    PARTICIPANTS,
    Case,
    Method,
    cells_of,
    errors_m,
    grid_around,
)

Floats = NDArray[np.float64]

FOLDER = Path("shared") / "data" / "maria_2019"
CRS = "EPSG:32611"
FUEL = 102  # the most frequent fuel model
PERIMETERS = 7  # number of perimeters from the first afternoon and evening, while the fire grew
SOURCE_M, POINT_M, CELL_M, BEYOND_M, MAX_M = 100.0, 30.0, 60.0, 3000.0, 2000.0
PLACE_SD_M = 50.0  # larger than in the paper: the fire is 25 times as wide as the paper's unit
PAPER_LENGTH_M = 500.0
FIELDS = ("YYYYMMDD", "24_HHMMSS", "type", "windspeed", "winddirec", "1hr", "10hr", "100hr")
LIVE = ("herb", "woody")
METHODS: dict[str, Method] = {
    "paper": lambda fire, observations: PaperCorrected(fire, observations, PAPER_LENGTH_M),
    "gaussian": lambda fire, observations: GaussianCorrected(
        fire, observations, place_sd_m=PLACE_SD_M
    ),
}


class Perimeter(NamedTuple):
    """A burned area in ``CRS``, and the weather recorded at the time of the perimeter."""

    area: BaseGeometry
    weather: Weather


def folder() -> Path | None:
    """Return the data folder in or above the repository, or None."""
    found = [above / FOLDER for above in Path(__file__).parents if (above / FOLDER).is_dir()]
    return found[0] if found else None


def read_perimeters(path: Path) -> list[Perimeter]:
    """Return the mapped perimeters in time order, with times in seconds after the first."""
    import pyogrio

    meta, _, shapes, columns = pyogrio.raw.read(path, columns=[*FIELDS, *LIVE])
    names = list(meta["fields"])
    found: dict[datetime, tuple[BaseGeometry, dict[str, Any]]] = {}
    for number, wkb in enumerate(shapes):
        of = {name: column[number] for name, column in zip(names, columns, strict=True)}
        if of["type"] == "perim":
            noted = f"{of['YYYYMMDD']} {of['24_HHMMSS']}"
            at = datetime.strptime(noted, "%Y%m%d %H:%M:%S")  # noqa: DTZ007
            area = into_crs(shapely.make_valid(shapely.from_wkb(wkb)), meta["crs"], CRS)
            found[at] = area, of
    first = min(found)
    perimeters = []
    for at in sorted(found):
        area, of = found[at]
        wind = float(of["windspeed"]) * M_S_PER_MPH, float(of["winddirec"])
        moistures = (float(of[name]) for name in (*FIELDS[-3:], *LIVE))
        perimeters.append(Perimeter(area, Weather((at - first).total_seconds(), *wind, *moistures)))
    return perimeters


def case_of(perimeters: list[Perimeter]) -> Case:
    """Return the case with a model from the first perimeter; later perimeters are the truth."""
    bounds = shapely.total_bounds([one.area for one in perimeters])
    box = tuple(float(bound) for bound in bounds)
    grid = grid_around((box[0], box[1], box[2], box[3]), BEYOND_M, CELL_M, CRS)
    points = cells_of(grid)
    first = perimeters[0]
    outline = shapely.get_coordinates(shapely.segmentize(first.area.boundary, SOURCE_M))
    spreads = spreads_of(FUEL, WeatherStream([first.weather]), grid.grid_deg)
    model = EllipseFire(spreads, np.column_stack([outline, np.zeros(len(outline))]))
    inside = shapely.contains_xy(first.area, points[:, 0], points[:, 1]).reshape(grid.shape)
    return Case(
        "maria 2019",
        np.array([one.weather.at_s for one in perimeters[1:]]),
        [_points(one) for one in perimeters[1:]],
        model,
        grid,
        points,
        np.where(inside, 0.0, np.inf),
        POINT_M,
        MAX_M,
    )


def random_observations(rng: np.random.Generator, count: int, case: Case) -> Floats:
    """Return noisy observations (n, 4) on all perimeters except the last, in time order.

    An observation is 1 s later than its perimeter, so that the observation does not affect the
    error measured at that perimeter.
    """
    found = []
    for at_s, front, number in zip(
        case.at_s[:-1],
        case.fronts[:-1],
        rng.multinomial(count, np.full(len(case.at_s) - 1, 1.0 / (len(case.at_s) - 1))),
        strict=True,
    ):
        places = front[rng.integers(len(front), size=number)]
        places = places + PLACE_SD_M * rng.standard_normal(places.shape)
        found.append(
            np.column_stack([places, np.full(number, at_s + 1.0), np.full(number, BURNING)])
        )
    return np.concatenate(found)


def maria_rows(progress: Callable[[str], None], data: Path | None = None) -> list[dict[str, Any]]:
    """Return a row for each participant and method, or no rows if the data is missing."""
    data = data or folder()
    if data is None:
        progress(f"Maria is skipped: no folder {FOLDER} next to the repository")
        return []
    case = case_of(read_perimeters(data / "firis_perimeters.shp")[:PERIMETERS])
    uncorrected = float(errors_m(case, np.empty((0, 4)), None)[1:].mean())
    rows = []
    for participant in range(PARTICIPANTS):
        rng = np.random.default_rng((2019, participant))
        count = int(rng.integers(MIN_CORRECTIONS, MAX_CORRECTIONS + 1))
        observations = random_observations(rng, count, case)
        rows += [
            {
                "truth": case.name,
                "method": name,
                "corrections": len(observations),
                "mean_error_uncorrected_m": uncorrected,
                "mean_error_m": float(errors_m(case, observations, method)[1:].mean()),
            }
            for name, method in METHODS.items()
        ]
        progress(f"corrections of Maria, {participant + 1} of {PARTICIPANTS}")
    return rows


def _points(one: Perimeter) -> Floats:
    found: Floats = shapely.get_coordinates(shapely.segmentize(one.area.boundary, POINT_M))
    return found
