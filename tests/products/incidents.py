"""Incidents without a journal, for tests of single products."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.fire.forecast import Arrival
from mission_service.products.heat import Heat
from mission_service.products.incident import ImageTimes, Incident
from mission_service.runtime.observation_sources import ObservationSources
from mission_service.runtime.run_statistics import RunStatistics

ROWS, COLS, CELL_M = 60, 80, 30.0


def land(crs: str = "EPSG:32616", west_m: float = 750e3, north_m: float = 4030e3) -> Landscape:
    """Return hills of grass."""
    rise = np.sin(np.linspace(0.0, 6.0, ROWS))[:, None] * np.cos(np.linspace(0.0, 9.0, COLS))
    return Landscape(
        crs,
        west_m,
        north_m,
        CELL_M,
        np.full((ROWS, COLS), 102, dtype=np.int16),
        (300.0 + 40.0 * rise).astype(np.float32),
    )


def growing(landscape: Landscape, m_s: float = 0.05) -> Any:
    """Return the arrival times (y, x) of a round fire from the middle of a landscape."""
    row, col = np.indices(landscape.shape)
    rows, cols = landscape.shape
    distance = np.hypot(row - rows // 2, col - cols // 2) * landscape.cell_size_m
    return distance / m_s


def incident(landscape: Landscape | None = None, **changes: Any) -> Incident:
    """Return a round fire two and a half hours after its begin, with a forecast of two hours."""
    landscape = landscape or land()
    arrival_s = changes.pop("arrival_s", growing(landscape))
    at_s, forecast_s = 9000.0, changes.pop("forecast_s", 7200.0)
    late = np.clip((arrival_s - at_s) / 14_400.0, 0.0, 1.0)
    found = Incident(
        name="Round fire",
        landscape=landscape,
        at_s=at_s,
        time_zero=datetime(2026, 8, 1, 18, tzinfo=UTC),
        prescribed=False,
        arrival=Arrival(at_s, at_s + forecast_s, arrival_s, 0),
        forecast_s=forecast_s,
        probability=1.0 - late if forecast_s else None,
        fire=None,
        heat=Heat([], [], []),
        record=RunStatistics((), 0, ObservationSources(landscape, (), 0)),
        images=ImageTimes(0, None, None),
    )
    return replace(found, **changes)
