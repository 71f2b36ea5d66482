"""From a scenario to its planners: one table of rules, and what each is told."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.fire.setup import fire_position, weather_of
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.front.perimeter_planner import PerimeterPlanner, PerimeterSettings
from mission_service.guidance.front.predictive_planner import (
    PredictivePlanner,
    PredictiveSettings,
    model_of,
)
from mission_service.guidance.protocol import Planner
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.baselines import Bumper, Circling
from mission_service.guidance.team.bent_rules import LATER_PLANNERS, PLANNERS, bent_rule
from mission_service.guidance.team.ring import TeamRule
from mission_service.guidance.team.team import MemberPerformance, Team, TeamSettings

TURN_BACK_RAD = 6.3  # flown to turn back: half a circle, and back onto the line


@dataclass(frozen=True)
class Ground:
    """Where a fire is watched: the grid, the cell the fire is said to be in, and since when."""

    landscape: Landscape
    centre: tuple[float, float]
    burns_from_s: float


def perimeter(rule: Literal["damped", "literal", "circling"]) -> "AloneMaker":
    """Islam & Hu's planner with one of its rules."""

    def planner(scenario: Scenario, section: VehicleSection, ground: Ground) -> Planner:
        told, cell_m = scenario.planner, ground.landscape.cell_size_m
        settings = PerimeterSettings(
            rule=rule,
            alpha=told.alpha,
            clockwise_first=told.first_direction == "clockwise",
            ignition_known=told.ignition_known,
            baseline_s=told.baseline_s,
            smoothing_deg=told.smoothing_deg,
            reversal_margin=told.reversal_margin,
            least_gain_cells=told.least_gain_cells,
            dwell_s=told.dwell_s,
            speed_cells_s=section.airspeed_m_s / cell_m,
            path=_path_settings(scenario, cell_m),
        )
        return PerimeterPlanner(
            settings, ground.landscape.shape, ground.centre, ground.burns_from_s
        )

    return planner


def predictive(scenario: Scenario, section: VehicleSection, ground: Ground) -> Planner:
    """The predictive planner; it knows the landscape and the moistures at the beginning."""
    told, cell_m = scenario.planner, ground.landscape.cell_size_m
    settings = PredictiveSettings(
        clockwise_first=told.first_direction == "clockwise",
        ignition_known=told.ignition_known,
        speed_cells_s=section.airspeed_m_s / cell_m,
        turn_radius_cells=section.turn_radius_m / cell_m,
        flies_in_wind=True,
        wind_20ft_share=1.0,  # a wrong share is learned as part of the fire's spread
        path=_path_settings(scenario, cell_m),
    )
    return PredictivePlanner(
        settings,
        ground.landscape.shape,
        ground.centre,
        ground.burns_from_s,
        cell_m,
        model_of(ground.landscape, weather_of(scenario).at(ground.burns_from_s)),
    )


def turn_back_s(section: VehicleSection) -> float:
    """What turning back costs a vehicle."""
    return TURN_BACK_RAD * section.turn_radius_m / section.airspeed_m_s


def balanced(scenario: Scenario) -> TeamRule:
    """The team with the least mean cost."""
    turns_s = [turn_back_s(section) for section in scenario.vehicles]
    return Balanced(scenario.planner.importance, sum(turns_s) / len(turns_s))


def bent(name: str) -> "RuleMaker":
    """One of Bent's planners in regions that are negotiated."""
    return lambda scenario: bent_rule(
        name, scenario.planner.negotiation, scenario.planner.importance
    )


AloneMaker = Callable[[Scenario, VehicleSection, Ground], Planner]
RuleMaker = Callable[[Scenario], TeamRule]

# Each vehicle with a planner of its own. A new planner is a line here.
ALONE: dict[str, AloneMaker] = {
    "damped": perimeter("damped"),
    "literal": perimeter("literal"),
    "circling": perimeter("circling"),
    "predictive": predictive,
}
# All vehicles in one team. A new rule is a line here.
TEAM: dict[str, RuleMaker] = {
    "team.balanced": balanced,
    "team.circling": lambda scenario: Circling(),
    "team.bumper": lambda scenario: Bumper(),
    **{f"team.{name}": bent(name) for name in (*PLANNERS, *LATER_PLANNERS)},
}
RULES = (*ALONE, *TEAM)


def planners_of(scenario: Scenario, landscape: Landscape) -> dict[str, Planner]:
    """A planner for each vehicle of a scenario, by name, in the units of the landscape's grid."""
    row, col = landscape.row_col_of(*fire_position(scenario, landscape))
    # An ignition is known as a cell; so is the centre the angles are counted from.
    centre = (float(round(float(row))), float(round(float(col))))
    burns_from_s = scenario.ignition[0].at_s if scenario.ignition else scenario.fire.burning_at_s
    ground = Ground(landscape, centre, burns_from_s)
    rule = scenario.planner.rule
    if rule in ALONE:
        return {
            section.name: ALONE[rule](scenario, section, ground) for section in scenario.vehicles
        }
    told = scenario.planner
    settings = TeamSettings(
        cell_m=landscape.cell_size_m,
        clockwise_first=told.first_direction == "clockwise",
        ignition_known=told.ignition_known,
        baseline_s=told.baseline_s,
        smoothing_deg=told.smoothing_deg,
        path=_path_settings(scenario, landscape.cell_size_m),
    )
    flyers = {
        section.name: MemberPerformance(section.airspeed_m_s, turn_back_s(section))
        for section in scenario.vehicles
    }
    team = Team(TEAM[rule](scenario), settings, flyers, landscape.shape, centre, burns_from_s)
    return {name: team.member(name) for name in flyers}


def _path_settings(scenario: Scenario, cell_m: float) -> PathSettings:
    mission = scenario.mission
    return PathSettings(mission.horizon_m / cell_m, mission.lead_m / cell_m)
