"""The ways of flying of this package, a line for each; those of others are entry points.

A folder's ``way.py`` describes it and is quick to import: what flies is imported when it does.
"""

from typing import cast

from firemodel.landscape.landscape import Landscape
from mission_service.config.rules import way_named
from mission_service.config.scenario import Scenario
from mission_service.guidance.burn.way import BURN
from mission_service.guidance.formation.way import FORMATION
from mission_service.guidance.front.way import FRONT
from mission_service.guidance.protocol import Lock, WayOfFlying
from mission_service.guidance.team.way import TEAM

WAYS = (FRONT, TEAM, FORMATION, BURN)


def way_of(scenario: Scenario) -> WayOfFlying:
    """The way in which a scenario's vehicles fly."""
    return way_for(scenario.planner.rule)


def way_for(rule: str) -> WayOfFlying:
    """The way of flying of a rule. Raises ValueError if there is none."""
    return cast(WayOfFlying, way_named(rule))


def lock_of(scenario: Scenario, landscape: Landscape) -> Lock | None:
    """The last check of commands, if the scenario's tables need one, whatever its rule is."""
    for way in (way_of(scenario), *WAYS):
        lock = way.lock(scenario, landscape)
        if lock is not None:
            return lock
    return None
