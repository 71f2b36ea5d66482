"""Computes from the scenario the inputs that all front planners use."""

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.fire.scenario_fire import fire_position
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.protocol import Ground

TURN_BACK_RAD = 6.3  # length of a turn back in turn radii: half a circle and a return to the line


def ground_of(scenario: Scenario, landscape: Landscape) -> Ground:
    """Return the grid, the cell of the reported fire, and the ignition time of a scenario."""
    row, col = landscape.row_col_of(*fire_position(scenario, landscape))
    # The fire ignites in one cell, so the centre of the map's bearings is rounded to a cell.
    centre = (float(round(float(row))), float(round(float(col))))
    burns_from_s = scenario.ignition[0].at_s if scenario.ignition else scenario.fire.burning_at_s
    return Ground(landscape, centre, burns_from_s)


def turn_back_s(section: VehicleSection) -> float:
    """Return the time in seconds that a vehicle needs to turn back."""
    return TURN_BACK_RAD * section.turn_radius_m / section.airspeed_m_s


def path_settings(scenario: Scenario, cell_m: float) -> PathSettings:
    """Return the length of a path, and how far ahead of the vehicle the path starts, in cells."""
    mission = scenario.mission
    return PathSettings(mission.horizon_m / cell_m, mission.lookahead_m / cell_m)
