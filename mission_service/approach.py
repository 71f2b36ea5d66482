"""The first mission of a vehicle: to the fire. And the landing that some missions must end with."""

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape import Landscape
from mission_service.config import Scenario
from mission_service.config_sections import VehicleSection
from mission_service.landing import landing_of, needs_landing
from mission_service.planning import fire_position
from mission_service.translate import mission_along

Floats = NDArray[np.float64]


def approach_path(scenario: Scenario, landscape: Landscape, start_m: tuple[float, float]) -> Floats:
    """A straight line from where the vehicle is to where the fire is said to be."""
    return np.array([start_m, fire_position(scenario, landscape)])


def approach_mission(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """The first mission of a vehicle: take off, fly to the fire, loiter there."""
    home = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    return mission_along(
        approach_path(scenario, landscape, home),
        scenario.planner.first_direction == "clockwise",
        section,
        landscape,
        from_ground=True,
        landing=landing_of_vehicle(scenario, section, landscape),
    )


def landing_of_vehicle(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """The landing that a vehicle's missions end with, if they must; into the first wind given."""
    if not needs_landing(section):
        return ()
    wind_from_deg = scenario.weather[0].wind_from_deg if scenario.weather else 0.0
    return landing_of(section, landscape, wind_from_deg)
