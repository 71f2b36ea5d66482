"""Plans a vehicle's first mission, from takeoff to the fire."""

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.fire.scenario_fire import fire_position
from mission_service.missions.from_path import mission_along
from mission_service.missions.landing import Landing

Floats = NDArray[np.float64]


def approach_path(scenario: Scenario, landscape: Landscape, start_m: tuple[float, float]) -> Floats:
    """Return a straight line from the vehicle's position to the reported position of the fire."""
    return np.array([start_m, fire_position(scenario, landscape)])


def approach_mission(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """Return a vehicle's first mission: take off, fly to the fire, loiter there."""
    home = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    return mission_along(
        approach_path(scenario, landscape, home),
        scenario.planner.first_direction == "clockwise",
        section,
        landscape,
        from_ground=True,
        landing=Landing(scenario, section, landscape).items_at(scenario.first_flight_s),
    )
