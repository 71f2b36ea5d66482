"""The ways of flying in this package; other packages add ways of flying through entry points.

``config/rule_lookup.py`` finds the way of flying for a rule, in this package or in another package.
"""

from typing import TYPE_CHECKING, cast

from mission_service.config.rule_lookup import way_named
from mission_service.config.scenario import Scenario
from mission_service.guidance.burn.way import BURN
from mission_service.guidance.formation.way import FORMATION
from mission_service.guidance.front.informative.way import INFORMATIVE
from mission_service.guidance.front.way import FRONT
from mission_service.guidance.team.way import TEAM
from mission_service.guidance.way_of_flying import WayOfFlying

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from mission_service.guidance.protocol import Lock

WAYS = (FRONT, INFORMATIVE, TEAM, FORMATION, BURN)


def way_of(scenario: Scenario) -> WayOfFlying:
    """Return the way of flying that a scenario's rule selects."""
    return way_for(scenario.planner.rule)


def way_for(rule: str) -> WayOfFlying:
    """Return the way of flying that has the given rule. Raises ValueError for an unknown rule."""
    return cast(WayOfFlying, way_named(rule))


def lock_of(scenario: Scenario, landscape: "Landscape") -> "Lock | None":
    """Return the lock of a scenario, or None if the scenario's tables need no lock."""
    locks = (way.lock(scenario, landscape) for way in (*WAYS, way_of(scenario)))
    return next((lock for lock in locks if lock is not None), None)
