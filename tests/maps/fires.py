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


def pixels_of(png: bytes, mode: str = "RGBA") -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert(mode))


def signed_area(ring: Any) -> float:
    x, y = np.array(ring).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
