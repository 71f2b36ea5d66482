"""The way of flying along a front as a team: one map for all vehicles, and a rule for the team.

A rule is a file of this folder and a line in ``RULES``.
"""

from mission_service.guidance.front.way import along_front
from mission_service.guidance.way import later

FOLDER = __package__
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
TEAM = along_front(tuple(RULES), later(f"{FOLDER}.planners:seats_of"))
