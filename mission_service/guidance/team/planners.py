"""Creates the members of a team, one planner for each vehicle, from the scenario."""

from pkgutil import resolve_name

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.guidance.front.planners import ground_of, path_settings, turn_back_s
from mission_service.guidance.protocol import Planner
from mission_service.guidance.team.front_ring import TeamRule
from mission_service.guidance.team.team import MemberPerformance, Team, TeamSettings
from mission_service.guidance.team.way import FOLDER, RULES


def members_of(scenario: Scenario, landscape: Landscape) -> dict[str, Planner]:
    """Return the planners of a scenario's vehicles, by name; the planners form one team."""
    planner, ground = scenario.planner, ground_of(scenario, landscape)
    settings = TeamSettings(
        cell_m=landscape.cell_size_m,
        clockwise_first=planner.first_direction == "clockwise",
        ignition_known=planner.ignition_known,
        baseline_s=planner.baseline_s,
        smoothing_deg=planner.smoothing_deg,
        path=path_settings(scenario, landscape.cell_size_m),
    )
    performance = {
        section.name: MemberPerformance(section.airspeed_m_s, turn_back_s(section))
        for section in scenario.vehicles
    }
    rule: TeamRule = resolve_name(f"{FOLDER}.{RULES[planner.rule]}")(scenario)
    team = Team(rule, settings, performance, landscape.shape, ground.centre, ground.burns_from_s)
    return {name: team.member(name) for name in performance}
