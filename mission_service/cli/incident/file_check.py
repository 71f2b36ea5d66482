"""Checks a scenario file and all files that it names."""

from typing import Any


def checked(file: str, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the summary of a scenario, with its warnings. Raises ScenarioError."""
    from autopilot_bridge.errors import BridgeError
    from firemodel.errors import FireModelError
    from mission_service.airspace.volumes import require_homes_inside, volumes_of
    from mission_service.config.rule_lookup import own_ways
    from mission_service.config.scenario import load_scenario, scenario_path
    from mission_service.errors import MissionServiceError, ScenarioError
    from mission_service.fire.scenario_check import check
    from mission_service.fire.scenario_fire import landscape_of

    loaded = load_scenario(file, overrides)
    try:
        summary = check(loaded)
        landscape = landscape_of(loaded)
        volumes_of(loaded.airspace, landscape)
        require_homes_inside(loaded, landscape)
        if loaded.vehicles and loaded.planner.rule not in own_ways():
            from mission_service.core.core import Core

            Core(loaded, landscape)  # also creates the planners of other packages
    except (
        BridgeError,
        FireModelError,
        MissionServiceError,
    ) as error:  # the error text does not name the file
        raise ScenarioError(f"{scenario_path(file)}: {error}") from None
    return summary
