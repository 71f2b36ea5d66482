"""A small fire that several tests share, on real terrain."""

import io
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pyproj import Transformer

from firemodel.landscape.default import jacksboro
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from mission_service.config.scenario import load_scenario
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from tests.firemodel.grids import weather

NOW_S = 5400.0
WEATHER = WeatherStream([weather(5.0, 225.0), weather(3.0, 270.0, 7200.0)])
TO_MERCATOR = Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True)


@cache
def land() -> Landscape:
    return jacksboro(101, 91, 30.0)


def fire(now_s: float = NOW_S) -> AnyAngleFire:
    found = AnyAngleFire(land(), WEATHER, [(50, 40, 0.0)])
    found.advance(now_s)
    return found


def estimated(now_s: float = NOW_S, *changes: str) -> RunEstimate:
    """Return the estimate of the same fire, without observations."""
    lat, lon = (float(each) for each in land().lat_lon_of(*land().xy_of(50.0, 40.0)))
    winds = ", ".join(
        f"{{at_s={at_s}, wind_speed_m_s={speed}, wind_from_deg={from_deg}, dead_1h_pct=6, "
        "dead_10h_pct=7, dead_100h_pct=8, live_herb_pct=60, live_woody_pct=90}"
        for at_s, speed, from_deg in ((0.0, 5.0, 225.0), (7200.0, 3.0, 270.0))
    )
    grid = ("landscape.rows=101", "landscape.cols=91", "duration_s=40000", "estimate.members=8")
    lit = f"ignition=[{{lat_deg={lat}, lon_deg={lon}}}]"
    scenario = load_scenario("default", (*grid, lit, f"weather=[{winds}]", *changes))
    found = RunEstimate(scenario, landscape_of(scenario))
    found.advance(round(now_s * 1e6))
    return found


def pixels_of(png: bytes, mode: str = "RGBA") -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert(mode))


def signed_area(ring: Any) -> float:
    x, y = np.array(ring).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
