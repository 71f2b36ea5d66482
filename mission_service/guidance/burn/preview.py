"""Simulates a whole burn without a vehicle, and writes a report and a picture."""

import json
from pathlib import Path
from typing import Any

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import BurnSection
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import landscape_of, weather_of
from mission_service.guidance.burn.burn_report import burn_json, burn_totals, draw_burn
from mission_service.guidance.burn.burn_state import BurnState
from mission_service.guidance.burn.lines.line_planner import Situation
from mission_service.guidance.burn.whole_burn import whole_burn


def situation_of(scenario: Scenario, burn: BurnSection, landscape: Landscape) -> Situation:
    """Return the situation before the first line: vehicle at home, and the crew's fires lit."""
    home = scenario.vehicles[0]
    state = BurnState(burn, landscape, weather_of(scenario), home)
    home_m = landscape.xy_of_lat_lon(home.home_lat_deg, home.home_lon_deg)
    begin_s = max(scenario.start_s, scenario.deploy_at_s)
    return state.situation_from(home_m, 0.0, 0.0, home_m, begin_s)


def preview(scenario: Scenario, out: Path) -> dict[str, Any]:
    """Simulate all lines of a scenario's burn; write burn.json and burn.png; return the totals.

    The burn begins at deployment, and approvals take no time. Raises MissionServiceError if the
    scenario has no burn or an invalid unit.
    """
    burn = scenario.burn
    if burn is None or not scenario.vehicles:
        raise ScenarioError(f"{scenario.name}: has no burn to preview; add a table [burn]")
    situation = situation_of(scenario, burn, landscape_of(scenario))
    found, area = whole_burn(situation, burn), situation.area
    (out / "burn.json").write_text(json.dumps(burn_json(found, area)) + "\n", encoding="utf-8")
    draw_burn(out / "burn.png", found, area, scenario.name)
    return burn_totals(found, area)
