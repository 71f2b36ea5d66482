"""The way of flying along a front with a separate planner for each vehicle.

To add a planner to this package, add a file to this folder and a line to ``PLANNERS``. To add a
planner from another package, use ``front_way``.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from pydantic import BaseModel

from mission_service.config.rule_lookup import faults_of
from mission_service.guidance.way_of_flying import WayOfFlying, later

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from mission_service.config.scenario import Scenario
    from mission_service.config.sections import VehicleSection
    from mission_service.guidance.protocol import Ground, Planner

Maker = Callable[["Scenario", "VehicleSection", "Ground"], "Planner"]
Planners = Callable[["Scenario", "Landscape"], "Mapping[str, Planner]"]

FOLDER = __package__
# For each rule, the function (module:name) that creates the planner of one vehicle.
PLANNERS = {
    "islam_hu_damped": "islam_hu_planner:islam_hu_planner",
    "islam_hu": "islam_hu_planner:islam_hu_planner",
    "circling": "islam_hu_planner:islam_hu_planner",
    "predictive": "predictive_planner:predictive_planner",
}


def front_way(rule: str, planner: Maker, section: type[BaseModel] | None = None) -> WayOfFlying:
    """Return a way of flying for another package, with a separate planner for each vehicle.

    Args:
        rule: The value of ``planner.rule``, which is also the name of the entry point.
        planner: The function that creates the planner of one vehicle.
        section: The model of the scenario table named after the rule. The function ``planner``
            reads this table with ``config.scenario.own_table(scenario, section)``.

    Returns:
        The object to which an entry point in the group ``mission_service.planners`` refers.
    """
    return along_front((rule,), partial(_checked, planner), section, relieves=True)


def along_front(
    rules: tuple[str, ...],
    planners: Planners,
    section: type[BaseModel] | None = None,
    relieves: bool = False,
) -> WayOfFlying:
    """Return a way of flying along a front.

    The function ``planners`` returns the planners of all vehicles, by vehicle name. ``relieves`` is
    True if these planners are separate, so that vehicles may relieve each other.
    """
    return WayOfFlying(
        rules,
        guidance=partial(later(f"{FOLDER}.controller:FrontFlight"), planners),
        warm_up=partial(later(f"{FOLDER}.warm_up:warm_up"), planners),
        section=section,
        along_front=True,
        relieves=relieves,
    )


def _each_alone(maker: Maker, scenario: "Scenario", landscape: "Landscape") -> "dict[str, Planner]":
    from mission_service.guidance.front.planners import ground_of

    ground = ground_of(scenario, landscape)
    return {section.name: maker(scenario, section, ground) for section in scenario.vehicles}


def _checked(maker: Maker, scenario: "Scenario", landscape: "Landscape") -> "dict[str, Planner]":
    """Return the planners of another package. Raises PlannerError if a planner lacks methods."""
    from mission_service.guidance.protocol import Planner, Steered

    with faults_of(scenario.planner.rule):
        planners = _each_alone(maker, scenario, landscape)
        needed = [name for name in (*vars(Steered), *vars(Planner)) if not name.startswith("_")]
        for vehicle, planner in planners.items():
            if missing := [name for name in needed if not hasattr(planner, name)]:
                kind = type(planner).__name__
                raise TypeError(f"the planner of {vehicle} ({kind}) lacks {', '.join(missing)}")
    return planners


def _planners(scenario: "Scenario", landscape: "Landscape") -> "dict[str, Planner]":
    maker: Maker = resolve_name(f"{FOLDER}.{PLANNERS[scenario.planner.rule]}")
    return _each_alone(maker, scenario, landscape)


FRONT = along_front(tuple(PLANNERS), _planners, relieves=True)
