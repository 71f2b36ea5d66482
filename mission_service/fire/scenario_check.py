"""Check all inputs of a scenario without a run."""

from typing import Any

from autopilot_bridge.links.signing import read_key
from firemodel.landscape.landscape import crs_label
from mission_service.config.scenario import Scenario
from mission_service.config.shared_links import sharing
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import check_fire, landscape_of, warnings_on
from mission_service.fire.sensors import sensors_of


def check(scenario: Scenario) -> dict[str, Any]:
    """Load all inputs of a scenario and return a summary; raise an error for any problem."""
    landscape = landscape_of(scenario)
    check_fire(scenario, landscape)
    sensors_of(scenario, landscape)
    sharing(scenario.vehicles)
    for vehicle in scenario.vehicles:
        if vehicle.signing_key is not None:
            read_key(vehicle.signing_key)
        x_m, y_m = landscape.xy_of_lat_lon(vehicle.home_lat_deg, vehicle.home_lon_deg)
        if not landscape.contains(x_m, y_m):
            raise ScenarioError(
                f"{scenario.name}: home of {vehicle.name} (lat {vehicle.home_lat_deg}, "
                f"lon {vehicle.home_lon_deg}) lies outside the landscape"
            )
    rows, cols = landscape.shape
    return {
        "scenario": scenario.name,
        "landscape": f"{rows} x {cols} cells of {landscape.cell_size_m:g} m, "
        f"{crs_label(landscape.crs)}",
        "vehicles": ", ".join(vehicle.name for vehicle in scenario.vehicles),
        "warnings": [*late_times(scenario), *warnings_on(scenario, landscape)],
    }


def late_times(scenario: Scenario) -> list[str]:
    """Return a warning for each ignition or takeoff that is not before the end of the run."""
    end_s = scenario.duration_s
    found = [
        f"ignition.{number}: at_s = {each.at_s:g} is not before duration_s = {end_s:g}, so this "
        "ignition has no effect"
        for number, each in enumerate(scenario.ignition)
        if each.at_s >= end_s
    ]
    if scenario.vehicles and scenario.deploy_at_s >= end_s:
        found.append(
            f"deploy_at_s = {scenario.deploy_at_s:g} is not before duration_s = {end_s:g}, so no "
            "vehicle takes off"
        )
    return found
