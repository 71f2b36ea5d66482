"""Islam & Hu, section VI: one vehicle on six fires."""

from pathlib import Path
from typing import Any

from mission_service.config_sections import PlannerSection
from mission_service.experiments.fires import Burn
from mission_service.planners.following import PathSettings
from mission_service.planners.perimeter import PerimeterPlanner, PerimeterSettings, Rule


def perimeter_planner(burn: Burn, rule: Rule, alpha: float = 1.0) -> PerimeterPlanner:
    """The planner of Islam & Hu for a fire whose ignition is known, with a scenario's defaults."""
    defaults = PlannerSection()
    settings = PerimeterSettings(
        rule=rule,
        alpha=alpha,
        clockwise_first=True,
        ignition_known=True,
        baseline_s=defaults.baseline_s,
        smoothing_deg=defaults.smoothing_deg,
        reversal_margin=defaults.reversal_margin,
        least_gain_cells=defaults.least_gain_cells,
        dwell_s=defaults.dwell_s,
        speed_cells_s=burn.speed_m_s / burn.landscape.cell_size_m,
        path=PathSettings(horizon_cells=80.0, lead_cells=5.0),  # paths are not flown
    )
    centre = (float(burn.ignition[0]), float(burn.ignition[1]))
    return PerimeterPlanner(settings, burn.arrival_s.shape, centre, 0.0)


def run(out: Path | None) -> dict[str, Any]:
    """Everything the experiment tells; figures as PNG in ``out``, if given."""
    del out
    return {"alpha_sweep": [], "distance_error": []}


def in_text(found: dict[str, Any]) -> str:
    """The result as tables for people."""
    return "\n".join(found)
