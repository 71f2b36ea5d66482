"""The map of a burn shows the fire for which plans are made, and its uncertainty."""

import asyncio

import numpy as np

from mission_service.config.scenario import load_scenario
from mission_service.events import Corrected
from mission_service.fire.burn_forecast import EstimatedForecasts
from mission_service.fire.estimated_fire import EstimatedFire
from mission_service.fire.scenario_fire import landscape_of, weather_of


def test_the_estimate_is_shown_and_a_correction_reduces_its_uncertainty_nearby() -> None:
    scenario = load_scenario("burn")
    assert scenario.burn is not None
    landscape = landscape_of(scenario)
    estimated = EstimatedFire(scenario.burn, landscape, weather_of(scenario))
    forecasts = EstimatedForecasts(lambda: estimated, landscape, lambda: 600.0)
    before = asyncio.run(forecasts.arrival(1200.0))
    row, col = np.argwhere((before.arrival_s > 900) & (before.arrival_s < 1000))[0]
    x_m, y_m = landscape.xy_of(float(row), float(col))
    place = np.array([[float(x_m), float(y_m)]])
    at_place = estimated.simulation.ignition_time_s(place)[0]
    assert before.arrival_s[row, col] == at_place
    unsure = asyncio.run(forecasts.probability(float(at_place)))
    assert abs(unsure[row, col] - 0.5) < 1e-9
    later = asyncio.run(forecasts.probability(float(at_place) + 60.0))
    assert 0.5 < later[row, col] < 0.95
    cell = np.array([row * landscape.shape[1] + col])
    quantiles = forecasts.arrival_quantiles_s([cell], (0.1, 0.5, 0.9), 3600.0)
    until_s, ((early_s,), (median_s,), (late_s,)) = asyncio.run(quantiles)
    assert until_s == 4200.0
    assert early_s < median_s == at_place < late_s
    at_late = asyncio.run(forecasts.probability(float(late_s)))
    assert abs(at_late[row, col] - 0.9) < 1e-9
    lat, lon = (float(value) for value in landscape.lat_lon_of(*place[0]))
    now_us, boss = 700_000_000, "firing-boss"
    estimated.apply(Corrected(now_us, "ann", boss, "burning", "point", ((lat, lon),), now_us))
    after = asyncio.run(forecasts.arrival(1200.0)).arrival_s[row, col]
    assert 690.0 < after < (at_place + 700.0) / 2, "it has come sooner than estimated"
    surer = asyncio.run(forecasts.probability(float(after) + 60.0))
    assert surer[row, col] > later[row, col]
