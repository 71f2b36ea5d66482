"""The burn of the paper's section VI: 20 acres, a wind of 2 m/s to the south; fires by formula."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from firemodel.ellipses.ellipse import EllipseFire, Spread
from firemodel.ellipses.line_ignitions import line_sources
from mission_service.config.sections import BurnSection, Station
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.lines.line_planner import Situation

Floats = NDArray[np.float64]

SIDE_M = math.sqrt(20.0 * 4046.8564224)
SOUTH = -math.pi / 2
SPREADS = (Spread(0.0, 0.3, 0.012, 0.012, SOUTH),)
SETTINGS = BurnSection(
    unit=((0.0, 0.0), (0.0, 1.0), (1.0, 1.0)),
    stations=(Station(name="chief", lat_deg=0.0, lon_deg=0.0),),
)
AREA = shapely.box(0.0, 0.0, SIDE_M, SIDE_M)
NO_FIRE = EllipseFire(SPREADS, np.empty((0, 3)))


class Formula:
    """A fire whose ignition time is a function of x and y (n,)."""

    def __init__(self, time_s: Callable[[Floats, Floats], Floats]) -> None:
        self.time_s = time_s

    def ignition_time_s(self, points_m: Floats) -> Floats:
        return self.time_s(points_m[:, 0], points_m[:, 1])


def lights(sources: Floats) -> EllipseFire:
    return EllipseFire(SPREADS, sources)


def unit(**changes: Any) -> BurnUnit:
    return replace(BurnUnit(AREA, shapely.MultiPolygon(), None, (), SETTINGS.edge_m), **changes)


def situation(**changes: Any) -> Situation:
    """Return the situation in the air at the drop height at the south-west corner, without fire."""
    given: dict[str, Any] = {
        "unit": unit(),
        "dropped_m": np.empty((0, 2)),
        "fire": NO_FIRE,
        "lights": lights,
        "at_s": 60.0,
        "x_m": 20.0,
        "y_m": 60.0,
        "height_m": SETTINGS.drop_height_m,
        "wind_m_s": 2.0,
        "toward_rad": SOUTH,
        "spheres": SETTINGS.spheres,
        "battery_s": SETTINGS.battery_s,
        "home_m": (20.0, 60.0),
    } | changes
    given.setdefault("area", given["unit"].area)
    return Situation(**given)


def backing_line() -> Floats:
    """Return sources along the southern side, lit at 0."""
    return line_sources(np.array([[0.0, 0.0], [SIDE_M, 0.0]]), 0.0, 2.0)
