"""Compiles the fire's kernels before flight; the first compilation takes many seconds."""

from dataclasses import replace

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import (
    Ignition,
    LandscapeSection,
    SuppressionLine,
    WeatherEntry,
)
from mission_service.config.scenario import Scenario
from mission_service.events import Observed, WindSet
from mission_service.fire.run_estimate import PERIOD_US, RunEstimate
from mission_service.fire.scenario_fire import landscape_of

LAT_DEG, LON_DEG = 36.0, -84.0
CELLS, CELL_SIZE_M = 40, 30.0
GROWS_S = 900.0
# Radii of the burned area in successive images. After several images, the fire drops its unused
# points; there are enough images for this.
CORRECTED_TO_CELLS = 12 * (10.0, 5.0)


def warm_up(scenario: Scenario) -> None:
    """Burn a small fire with the scenario's scheme in changing wind, and correct it with images.

    Each kernel of the estimated and the simulated fire is called at least once, which compiles it
    or loads it from the disk cache.
    """
    small = _small(scenario)
    level = landscape_of(small)
    crowns = scenario.fire.crown != "none"
    estimate = RunEstimate(small, _with_trees(level) if crowns else level)
    at_us = round(GROWS_S * 1e6)
    estimate.advance(at_us)
    name = small.vehicles[0].name
    rows, cols = np.indices((CELLS, CELLS))
    away_cells = np.hypot(rows - CELLS // 2, cols - CELLS // 2)
    for reach_cells in CORRECTED_TO_CELLS:
        burned = np.where(away_cells <= reach_cells, "b", "u")
        estimate.on_event(Observed(at_us, name, 0, 0, tuple("".join(row) for row in burned)))
        at_us += 2 * PERIOD_US
        estimate.advance(at_us)
    estimate.apply_report(WindSet(at_us, "service", "", 3.0, 90.0))
    estimate.advance(at_us + 2 * PERIOD_US)
    estimate.fire.front(estimate.fire.time_s)


def _small(scenario: Scenario) -> Scenario:
    """Return a scenario with the scheme of ``scenario`` and an ignition on a small level area."""
    level = LandscapeSection(
        source="flat",
        rows=CELLS,
        cols=CELLS,
        cell_size_m=CELL_SIZE_M,
        lat_deg=LAT_DEG,
        lon_deg=LON_DEG,
    )
    initial = {"perimeter": None, "arrival": None, "initial_cells": None}
    changes = {
        "landscape": level,
        "fire": scenario.fire.model_copy(update=initial),
        "ignition": (Ignition(lat_deg=LAT_DEG, lon_deg=LON_DEG),),
        "weather_file": None,
        "wind_grids": None,
        "terrain_wind": None,
        "weather": (_wind(0.0, 0.0), _wind(GROWS_S / 2.0, 60.0)),
        "suppression": (_line(),) if scenario.suppression else (),
        "burn": None,
        "start_s": 0.0,
    }
    return scenario.model_copy(update=changes)


def _with_trees(level: Landscape) -> Landscape:
    """Return a landscape with the layers required for crown fire."""
    layers = (np.full(level.shape, value, np.float32) for value in (0.6, 15.0, 2.0, 0.15))
    cover, height, base, density = layers
    return replace(
        level,
        canopy_cover=cover,
        canopy_height_m=height,
        canopy_base_m=base,
        canopy_bulk_density_kg_m3=density,
    )


def _line() -> SuppressionLine:
    """Return a control line beside the ignition that is built while the fire burns."""
    lon_deg = LON_DEG + 2e-3
    points = ((LAT_DEG - 1e-3, lon_deg), (LAT_DEG + 1e-3, lon_deg))
    return SuppressionLine(points=points, rate_m_h=1000.0)


def _wind(at_s: float, from_deg: float) -> WeatherEntry:
    """Return dry weather with a light wind from ``at_s`` on."""
    return WeatherEntry(
        at_s=at_s,
        wind_speed_m_s=2.0,
        wind_from_deg=from_deg,
        dead_1h_pct=4.0,
        dead_10h_pct=5.0,
        dead_100h_pct=6.0,
        live_herb_pct=60.0,
        live_woody_pct=80.0,
    )
