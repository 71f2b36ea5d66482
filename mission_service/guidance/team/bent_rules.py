"""Bent's rules by name: planner, negotiation and importance function (thesis, chapter 4)."""

from collections.abc import Mapping

from mission_service.config.scenario import Scenario
from mission_service.guidance.team.baselines import Bumper, Circling
from mission_service.guidance.team.bent_region import CourseRule
from mission_service.guidance.team.bent_steering import (
    back_and_forth,
    highest_dynamic,
    highest_static,
    predictive,
    predictive_kept,
)
from mission_service.guidance.team.bent_team import RegionTeam
from mission_service.guidance.team.front_ring import TeamRule
from mission_service.guidance.team.negotiation import (
    Negotiation,
    on_arrival,
    on_centre,
    on_importance,
)

PLANNERS: Mapping[str, CourseRule] = {
    "back-and-forth": back_and_forth,
    "highest-dynamic": highest_dynamic,
    "highest-static": highest_static,
    "predictive": predictive,
}
NEGOTIATIONS: Mapping[str, Negotiation] = {"importance": on_importance, "centre": on_centre}
LATER_PLANNERS: Mapping[str, CourseRule] = {"predictive-kept": predictive_kept}
LATER_NEGOTIATIONS: Mapping[str, Negotiation] = {"arrival": on_arrival}
IMPORTANCES = ("linear", "exponential")
BENCHMARKS = ("circling", "bumper")


def bent_rule(planner: str, negotiation: str | None, importance: str) -> TeamRule:
    """Return the thesis's rule with the given names; a baseline needs no negotiation.

    Raises KeyError for an unknown name.
    """
    if planner in BENCHMARKS:
        return Circling() if planner == "circling" else Bumper()
    steer = (PLANNERS | LATER_PLANNERS)[planner]  # type: ignore[operator]
    negotiate = (NEGOTIATIONS | LATER_NEGOTIATIONS)[negotiation]  # type: ignore[operator]
    return RegionTeam(steer, negotiate, exponential=importance == "exponential")


def bent(scenario: Scenario) -> TeamRule:
    """Return the rule from Bent's thesis that a scenario selects."""
    planner = scenario.planner
    return bent_rule(planner.rule.removeprefix("team."), planner.negotiation, planner.importance)
