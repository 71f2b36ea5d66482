"""Bent's planners by name: what a team of Bent's is made of (thesis, chapter 4)."""

from collections.abc import Mapping

from mission_service.config.scenario import Scenario
from mission_service.guidance.team.benchmarks import Bumper, Circling
from mission_service.guidance.team.bent_back_and_forth import back_and_forth
from mission_service.guidance.team.bent_highest_dynamic import highest_dynamic
from mission_service.guidance.team.bent_highest_static import highest_static
from mission_service.guidance.team.bent_predictive import predictive
from mission_service.guidance.team.bent_predictive_kept import predictive_kept
from mission_service.guidance.team.bent_region import Steer
from mission_service.guidance.team.bent_team import RegionTeam
from mission_service.guidance.team.negotiation import Negotiation, on_importance
from mission_service.guidance.team.negotiation_arrival import on_arrival
from mission_service.guidance.team.negotiation_centre import on_centre
from mission_service.guidance.team.ring import TeamRule

PLANNERS: Mapping[str, Steer] = {
    "back-and-forth": back_and_forth,
    "highest-dynamic": highest_dynamic,
    "highest-static": highest_static,
    "predictive": predictive,
}
NEGOTIATIONS: Mapping[str, Negotiation] = {"importance": on_importance, "centre": on_centre}
LATER_PLANNERS: Mapping[str, Steer] = {"predictive-kept": predictive_kept}
LATER_NEGOTIATIONS: Mapping[str, Negotiation] = {"arrival": on_arrival}
IMPORTANCES = ("linear", "exponential")
BENCHMARKS = ("circling", "bumper")


def bent_rule(planner: str, negotiation: str | None, importance: str) -> TeamRule:
    """A rule of the thesis by its names; a benchmark has no negotiation. Raises KeyError."""
    if planner in BENCHMARKS:
        return Circling() if planner == "circling" else Bumper()
    steer = (PLANNERS | LATER_PLANNERS)[planner]  # type: ignore[operator]
    negotiate = (NEGOTIATIONS | LATER_NEGOTIATIONS)[negotiation]  # type: ignore[operator]
    return RegionTeam(steer, negotiate, exponential=importance == "exponential")


def bent(scenario: Scenario) -> TeamRule:
    """The rule that a scenario names."""
    told = scenario.planner
    return bent_rule(told.rule.removeprefix("team."), told.negotiation, told.importance)
