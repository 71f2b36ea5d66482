"""Compiles the kernels for a burn before flight."""

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.guidance.burn.lines.line_planner import next_line
from mission_service.guidance.burn.preview import situation_of


def warm_up(scenario: Scenario, landscape: Landscape) -> None:
    """Plan one line, so that the kernels are compiled before flight and not during it."""
    assert scenario.burn is not None
    next_line(situation_of(scenario, scenario.burn, landscape), scenario.burn)
