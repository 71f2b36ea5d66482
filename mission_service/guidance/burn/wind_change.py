"""Changes of the wind that invalidate a plan."""

import math
from collections.abc import Sequence

from mission_service.config.sections import BurnSection
from mission_service.ignition_plan import IgnitionPlan

CALM_M_S = 1.0  # below it the direction of the wind does not count
WindFrom = tuple[float, float]  # speed in m/s, where it comes from in degrees from true north


def wind_differs(plan: IgnitionPlan, wind: WindFrom, burn: BurnSection) -> str | None:
    """How a wind differs from the planned one by more than is allowed; None if it does not."""
    speed_m_s, from_deg = wind
    turned_deg = abs((from_deg - plan.wind_from_deg + 180.0) % 360.0 - 180.0)
    faster = abs(speed_m_s - plan.wind_speed_m_s) > burn.wind_changes_m_s
    blows = max(speed_m_s, plan.wind_speed_m_s) > CALM_M_S
    if not faster and not (blows and turned_deg > burn.wind_changes_deg):
        return None
    return (
        f"the wind is {speed_m_s:.1f} m/s from {from_deg:.0f}°, planned for was "
        f"{plan.wind_speed_m_s:.1f} m/s from {plan.wind_from_deg:.0f}°"
    )


def mean_wind(winds: Sequence[WindFrom]) -> WindFrom:
    """The mean of winds as vectors."""
    east = sum(speed * math.sin(math.radians(from_deg)) for speed, from_deg in winds) / len(winds)
    north = sum(speed * math.cos(math.radians(from_deg)) for speed, from_deg in winds) / len(winds)
    return math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0
