"""A burn to its end as it would go now, without a vehicle: report and picture."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.landscape import Landscape
from mission_service.burn.burn_report import burn_json, draw_burn, totals
from mission_service.burn.fire_state import BelievedFire, toward
from mission_service.burn.planner import Situation, next_line
from mission_service.burn.unit import unit_of
from mission_service.burn.whole_burn import whole_burn
from mission_service.config import Scenario
from mission_service.config_sections import BurnSection
from mission_service.errors import ScenarioError
from mission_service.fire_setup import landscape_of, weather_of


def situation_of(scenario: Scenario, burn: BurnSection, landscape: Landscape) -> Situation:
    """Before the first line: the vehicle stands at home, and burns what the crew has lit."""
    home = scenario.vehicles[0]
    home_lat_lon = (home.home_lat_deg, home.home_lon_deg)
    x_m, y_m = landscape.xy_of_lat_lon(*home_lat_lon)
    unit = unit_of(burn, landscape, home_lat_lon)
    fire = BelievedFire(burn, landscape, weather_of(scenario))
    begin_s = max(scenario.start_s, scenario.deploy_at_s)
    weather = fire.weather_at(begin_s)
    east, north = toward(landscape, weather.wind_speed_m_s, weather.wind_from_deg)
    return Situation(
        unit=unit,
        area=unit.area,
        dropped_m=np.empty((0, 2)),
        fire=fire.simulation,
        lights=fire.lights,
        at_s=begin_s,
        x_m=x_m,
        y_m=y_m,
        height_m=0.0,
        wind_m_s=weather.wind_speed_m_s,
        toward_rad=math.atan2(north, east),
        spheres=burn.spheres,
        battery_s=burn.battery_s,
        home_m=(x_m, y_m),
    )


def preview(scenario: Scenario, out: Path) -> dict[str, Any]:
    """All lines of a scenario's burn from its deployment on; writes burn.json and burn.png.

    Returns the totals; no time is counted for approvals. Raises MissionServiceError for a scenario
    without a burn, or with a unit that cannot be.
    """
    burn = scenario.burn
    if burn is None or not scenario.vehicles:
        raise ScenarioError(f"{scenario.name}: there is no burn to preview: it needs [burn]")
    situation = situation_of(scenario, burn, landscape_of(scenario))
    found, area = whole_burn(situation, burn), situation.area
    told = json.dumps(burn_json(found, area))
    (out / "burn.json").write_text(told + "\n", encoding="utf-8")
    draw_burn(out / "burn.png", found, area, scenario.name)
    return totals(found, area)


def warm_up(scenario: Scenario, landscape: Landscape) -> None:
    """Plan once: what is compiled is compiled before anybody flies, not while a link is minded."""
    assert scenario.burn is not None
    next_line(situation_of(scenario, scenario.burn, landscape), scenario.burn)
