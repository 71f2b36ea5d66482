"""The camera's image of the true fire, and the initial fire of a formation."""

from dataclasses import replace

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.errors import ScenarioError
from mission_service.events import Telemetry
from mission_service.fire.camera import Camera, beyond_rectangle
from mission_service.fire.camera_views import observed as observed_from
from mission_service.fire.scenario_fire import burning_of, fire_of, landscape_of
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.guidance.formation.members import first_fire, settings_of
from mission_service.guidance.formation.settings import Settings


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("virtual-agents"))


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 90.0, 180.0, 250.0])
def test_a_rectangle_lies_along_the_heading(heading_deg: float) -> None:
    course = np.radians(heading_deg)
    ahead, right = (
        np.array([np.sin(course), np.cos(course)]),
        np.array([np.cos(course), -np.sin(course)]),
    )
    places = ((9.9, 0.0, False), (10.1, 0.0, True), (0.0, 4.1, True), (9.8, -3.9, False))
    for along, across, outside in places:
        east, north = along * ahead + across * right
        found = beyond_rectangle(np.array([-north]), np.array([east]), heading_deg, 4.0, 10.0)
        assert found.tolist() == [outside]


def test_the_footprint_has_the_papers_size_and_turns(land: Landscape) -> None:
    scenario = load_scenario("virtual-agents", ("fire.initial_cells=40",))
    world = SimulatedFire(fire_of(scenario, land), land)
    camera = Camera(np.radians(60.0), np.radians(46.8))
    lat, lon = scenario.ignition[0].lat_deg, scenario.ignition[0].lon_deg
    assert lat is not None
    assert lon is not None
    altitude_m = float(land.elevation_at(*land.xy_of_lat_lon(lat, lon))) + 300.0
    seen = {}
    for heading_deg in (0.0, 90.0):
        true_deg = heading_deg + land.grid_convergence_deg
        position = Telemetry(0, "heron", lat, lon, altitude_m, 300.0, 17.0, 0.0, true_deg)
        observed = observed_from(world.fire, position, camera)
        assert observed is not None
        inside = np.array([[cell != "." for cell in row] for row in observed.cells])
        seen[heading_deg] = (inside.any(axis=0).sum(), inside.any(axis=1).sum())
        assert "b" in "".join(observed.cells)
    width, length = seen[0.0]
    assert (width, length) == seen[90.0][::-1]
    assert width * 10.0 == pytest.approx(2 * 300 * np.tan(np.radians(30.0)), abs=10.0)
    assert length * 10.0 == pytest.approx(2 * 300 * np.tan(np.radians(23.4)), abs=10.0)


def test_a_formation_has_the_papers_settings() -> None:
    scenario = load_scenario("virtual-agents", ("formation.safety_radius_m=30",))
    settings = settings_of(scenario, scenario.vehicles[0])
    table_1 = Settings()
    assert settings.coverage_radius_m == pytest.approx(table_1.coverage_radius_m, abs=1.0)
    assert settings.camera.along_rad == pytest.approx(table_1.camera.along_rad, abs=1e-3)
    assert replace(settings, camera=table_1.camera) == table_1
    wide = scenario.vehicles[0].model_copy(update={"camera_along_deg": None})
    square_rad = settings_of(scenario, wide).camera.along_rad  # a 4:3 sensor
    assert square_rad == pytest.approx(table_1.camera.along_rad, abs=2e-3)


def test_a_fire_of_initial_cells_burns_from_the_start_and_goes_on(land: Landscape) -> None:
    scenario = load_scenario("virtual-agents", ("fire.initial_cells=300",))
    burning = burning_of(scenario, land)
    assert burning is not None
    cells = np.flatnonzero(np.isfinite(burning.arrival_s))
    assert 300 <= cells.size < 310
    assert first_fire(scenario, land).tolist() == cells.tolist()
    fire = fire_of(scenario, land)
    assert np.flatnonzero(fire.burned()).tolist() == cells.tolist()
    fire.advance(1200.0)
    assert np.count_nonzero(fire.burned()) > 400
    again = burning_of(scenario, land)
    assert again is not None
    assert np.array_equal(again.arrival_s, burning.arrival_s)
    other = burning_of(scenario.model_copy(update={"seed": 2}), land)
    assert other is not None
    assert not np.array_equal(other.arrival_s, burning.arrival_s)


def test_more_initial_cells_than_can_burn_are_refused() -> None:
    grid = ("landscape.rows=20", "landscape.cols=20", "fire.p_spread=0.5")
    scenario = load_scenario("virtual-agents", (*grid, "fire.initial_cells=401"))
    with pytest.raises(ScenarioError, match="no burnable cell is left after 400 cells"):
        burning_of(scenario, landscape_of(scenario))


def test_without_an_initial_fire_the_base_has_the_ignition(land: Landscape) -> None:
    scenario = load_scenario("virtual-agents")
    fire = scenario.fire.model_copy(update={"initial_cells": None})
    (cell,) = first_fire(scenario.model_copy(update={"fire": fire}), land)
    row, col = divmod(int(cell), land.shape[1])
    x_m, y_m = land.xy_of_lat_lon(scenario.ignition[0].lat_deg, scenario.ignition[0].lon_deg)
    assert (row, col) == pytest.approx(land.row_col_of(x_m, y_m), abs=0.5)
