"""The way of flying along a front as a team: one map for all vehicles, and a rule for the team.

A rule is a file of this folder and a line in ``RULES``.
"""

from pkgutil import resolve_name

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.guidance.front.way import along_front
from mission_service.guidance.protocol import Planner

# By rule: where a function is that makes it.
RULES = {
    "team.balanced": "balanced:balanced",
    "team.circling": "bent:bent",
    "team.bumper": "bent:bent",
    "team.back-and-forth": "bent:bent",
    "team.highest-dynamic": "bent:bent",
    "team.highest-static": "bent:bent",
    "team.predictive": "bent:bent",
    "team.predictive-kept": "bent:bent",
}


def _planners(scenario: Scenario, landscape: Landscape) -> dict[str, Planner]:
    from mission_service.guidance.team.planners import seats_of

    rule = resolve_name(f"{__package__}.{RULES[scenario.planner.rule]}")
    return seats_of(rule(scenario), scenario, landscape)


TEAM = along_front(tuple(RULES), _planners)
