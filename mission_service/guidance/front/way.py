"""The way of flying along a front, each vehicle by a planner of its own.

A planner is a file of this folder and a line in ``PLANNERS``; one of another package is described
by ``front_way``.
"""

from collections.abc import Callable, Mapping
from pkgutil import resolve_name

from pydantic import BaseModel

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.guidance.protocol import Ground, Guidance, Planner, WayOfFlying
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import Spacing

Maker = Callable[[Scenario, VehicleSection, Ground], Planner]
Planners = Callable[[Scenario, Landscape], Mapping[str, Planner]]

# By rule: where a function is that makes the planner of one vehicle.
PLANNERS = {
    "damped": "perimeter:perimeter_planner",
    "literal": "perimeter:perimeter_planner",
    "circling": "perimeter:perimeter_planner",
    "predictive": "predictive:predictive_planner",
}


def front_way(rule: str, planner: Maker, section: type[BaseModel] | None = None) -> WayOfFlying:
    """A rule of another package, by which each vehicle flies along the front.

    Args:
        rule: its name in ``planner.rule``, and the name of its entry point.
        planner: makes the planner of one vehicle.
        section: the model of its table in the scenario, which has the rule's name; the planner's
            maker gets it by ``own_table(scenario, section)``.

    Returns:
        What the entry point of group ``mission_service.planners`` leads to.
    """
    return along_front((rule,), lambda scenario, land: each_alone(planner, scenario, land), section)


def each_alone(maker: Maker, scenario: Scenario, landscape: Landscape) -> dict[str, Planner]:
    """A planner for each vehicle of a scenario, by name."""
    from mission_service.guidance.front.planners import ground_of

    ground = ground_of(scenario, landscape)
    return {section.name: maker(scenario, section, ground) for section in scenario.vehicles}


def along_front(
    rules: tuple[str, ...], planners: Planners, section: type[BaseModel] | None = None
) -> WayOfFlying:
    """A way of flying along a front, with ``planners`` for all vehicles of a scenario by name."""

    def guidance(
        scenario: Scenario, landscape: Landscape, spacing: Spacing, missions: MissionsSent
    ) -> Guidance:
        from mission_service.guidance.front.controller import FrontFlight

        return FrontFlight(scenario, landscape, planners(scenario, landscape), spacing, missions)

    def warm_up(scenario: Scenario, landscape: Landscape) -> None:
        from mission_service.guidance.front.warm_up import warm_up as fly_a_lap

        fly_a_lap(planners, scenario, landscape)

    return WayOfFlying(rules, guidance, warm_up, to_the_fire, section=section, along_front=True)


def to_the_fire(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """A vehicle's first mission: to where the fire is said to be."""
    from mission_service.missions.approach import approach_mission

    return approach_mission(scenario, section, landscape)


def _planners(scenario: Scenario, landscape: Landscape) -> dict[str, Planner]:
    maker: Maker = resolve_name(f"{__package__}.{PLANNERS[scenario.planner.rule]}")
    return each_alone(maker, scenario, landscape)


FRONT = along_front(tuple(PLANNERS), _planners)
