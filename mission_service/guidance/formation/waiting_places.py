"""Computes the positions at the fire's edge where a formation's first missions end."""

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.guidance.formation.members import Formation
from mission_service.missions.landing import Landing
from mission_service.missions.orbits import (
    Circle,
    Place,
    first_mission,
    waiting_place,
)


def clear_of_fire_m(formation: Formation, section: VehicleSection) -> float:
    """Return the distance from the fire's centre at which a loiter is clear of all known fire."""
    return formation.reach_m + 3.0 * section.loiter_radius_m


def waits_at(
    scenario: Scenario, formation: Formation, section: VehicleSection, home_m: Place
) -> Place:
    """Return the position at the fire's edge where a vehicle's first mission ends."""
    number = [each.name for each in scenario.vehicles].index(section.name)
    reach_m = clear_of_fire_m(formation, section)
    apart_m = 2.0 * section.loiter_radius_m + 4.0 * scenario.formation.safety_radius_m
    return waiting_place(number, formation.centre_m, reach_m, home_m, apart_m)


def mission_to_place(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """Return a vehicle's first mission, from the ground to the position at the fire's edge."""
    home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    place_m = waits_at(scenario, Formation(scenario, landscape), section, home_m)
    landing = Landing(scenario, section, landscape).items_at(scenario.first_flight_s)
    return first_mission(landscape, Circle(*place_m, -section.loiter_radius_m), section, landing)
