"""The way of flying along a front as a team, with one map for all vehicles and a team rule.

To add a rule, add a file to this folder and a line to ``RULES``.
"""

from mission_service.guidance.front.way import along_front
from mission_service.guidance.way_of_flying import later

FOLDER = __package__
# For each rule, the function (module:name) that creates the rule.
RULES = {
    "team.balanced": "balanced:balanced",
    "team.circling": "bent_rules:bent",
    "team.bumper": "bent_rules:bent",
    "team.back-and-forth": "bent_rules:bent",
    "team.highest-dynamic": "bent_rules:bent",
    "team.highest-static": "bent_rules:bent",
    "team.predictive": "bent_rules:bent",
    "team.predictive-kept": "bent_rules:bent",
}
TEAM = along_front(tuple(RULES), later(f"{FOLDER}.planners:members_of"))
