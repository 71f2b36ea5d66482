"""A burn to its end as it would go now, without a vehicle: report and picture."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from mission_service.burn.burn_report import burn_json, draw_burn, totals
from mission_service.burn.fire_state import BelievedFire, toward
from mission_service.burn.planner import Situation
from mission_service.burn.unit import unit_of
from mission_service.burn.whole_burn import whole_burn
from mission_service.config import Scenario
from mission_service.errors import ScenarioError
from mission_service.fire_setup import landscape_of, weather_of


def preview(scenario: Scenario, out: Path) -> dict[str, Any]:
    """All lines of a scenario's burn from its deployment on; writes burn.json and burn.png.

    Returns the totals. The pause between two lines, for approval, counts with none.
    Raises MissionServiceError for a scenario without a burn or with a unit that cannot be.
    """
    burn = scenario.burn
    if burn is None or not scenario.vehicles:
        raise ScenarioError(f"{scenario.name}: there is no burn to preview: it needs [burn]")
    landscape = landscape_of(scenario)
    home = scenario.vehicles[0]
    home_lat_lon = (home.home_lat_deg, home.home_lon_deg)
    x_m, y_m = landscape.xy_of_lat_lon(*home_lat_lon)
    unit = unit_of(burn, landscape, home_lat_lon)
    fire = BelievedFire(burn, landscape, weather_of(scenario))
    begin_s = max(scenario.start_s, scenario.deploy_at_s)
    weather = fire.weather_at(begin_s)
    east, north = toward(landscape, weather.wind_speed_m_s, weather.wind_from_deg)
    situation = Situation(
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
    found = whole_burn(situation, burn)
    told = json.dumps(burn_json(found, unit.area))
    (out / "burn.json").write_text(told + "\n", encoding="utf-8")
    draw_burn(out / "burn.png", found, unit.area, scenario.name)
    return totals(found, unit.area)
