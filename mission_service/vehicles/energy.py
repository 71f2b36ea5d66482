"""Estimates, from each source of data, how long a vehicle's energy lasts. Pure.

The sources are: the vehicle's ``endurance_s``; the charge in percent, with the learned rate at
which it falls, or with a rate computed from the consumed charge in mAh or from the current; the
autopilot's own estimate (BATTERY_STATUS.time_remaining); a voltage below ``battery_min_voltage_v``.
The source with the least time left on task is used.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from mission_service.config.sections import VehicleSection
from mission_service.vehicles.battery_reports import CONFIRMED_S, BatteryReports


class TimeLeft(NamedTuple):
    """The time left according to one source."""

    source: str
    until_home_s: float  # latest arrival at home, from now; then the reserve remains
    until_empty_s: float  # NaN if unknown


class EnergyEstimate(NamedTuple):
    """The estimate from the source with the least time left on task."""

    at_s: float
    source: str
    time_on_task_s: float  # until the vehicle must fly home; negative after this time
    time_home_s: float  # until arrival at home; infinity if the wind prevents it
    time_landing_s: float  # from the arrival at home to the touchdown
    until_empty_s: float  # NaN if unknown

    @property
    def runs_out(self) -> bool:
        """Whether the energy does not suffice for the flight home, even without a reserve."""
        return self.until_empty_s < self.time_home_s

    @property
    def words(self) -> str:
        """The estimate for operators, such as "12 min on task, 3 min home (source: battery)"."""
        on_task = f"{self.time_on_task_s / 60.0:.0f} min on task"
        if self.time_on_task_s <= 0.0:
            on_task = "no time left on task"
        home = f"{self.time_home_s / 60.0:.0f} min home"
        if math.isinf(self.time_home_s):
            home = "no way home against the wind"
        return f"{on_task}, {home} (source: {self.source})"


@dataclass(slots=True)
class EnergyState:
    """The estimate of one vehicle, and the alarms and the confirmation that depend on it."""

    estimate: EnergyEstimate | None = None
    reported_at_s: float = -math.inf
    flies_on: bool = False  # an operator confirmed an order to fly on beyond the limit
    time_up_since_s: float | None = None  # since when it should have been flying home
    overdue: bool = False  # whether the alarm is raised
    low: Literal["", "warning", "severe"] = ""  # severity of the alarm about low energy


def times_left(
    section: VehicleSection, battery: BatteryReports, flown_s: float, lands_s: float, at_s: float
) -> list[TimeLeft]:
    """Return the time left according to each source that has a value.

    The landing, which takes ``lands_s``, is flown within ``endurance_reserve_s``, or within the
    time it takes if that is longer; ``battery_reserve_pct`` remains after the landing.
    """
    found = []
    if section.endurance_s is not None:
        left_s = section.endurance_s - flown_s
        reserve_s = max(section.endurance_reserve_s, lands_s)
        found.append(TimeLeft("endurance_s", left_s - reserve_s, left_s))
    reserve_pct = section.battery_reserve_pct
    level_pct = battery.level_pct(at_s)
    if level_pct is not None:
        rates = {
            "battery": battery.discharge_pct_s(),
            "current": battery.discharge_by_charge_pct_s(),
        }
        for source, rate in rates.items():
            if rate is not None:
                until_s = (level_pct - reserve_pct) / rate - lands_s
                found.append(TimeLeft(source, until_s, level_pct / rate))
        if rates["battery"] is None and level_pct <= reserve_pct:
            found.append(TimeLeft("battery", -lands_s, math.nan))
    if battery.empty_at.value is not None:
        left_s = max(battery.empty_at.value - at_s, 0.0)
        used = 1.0 if not level_pct else max(1.0 - reserve_pct / level_pct, 0.0)
        found.append(TimeLeft("autopilot's estimate", left_s * used - lands_s, left_s))
    since_s = battery.low_voltage_since_s
    if since_s is not None and at_s - since_s >= CONFIRMED_S:
        found.append(TimeLeft("voltage", -lands_s, math.nan))
    return found


def estimate(
    times: list[TimeLeft], home_s: float, lands_s: float, at_s: float
) -> EnergyEstimate | None:
    """Return the estimate from the source with the least time left on task; None without a source.

    ``home_s`` is the duration of the flight home, ``lands_s`` that of the landing.
    """
    if not times:
        return None
    least = min(times, key=lambda each: each.until_home_s)
    on_task_s = least.until_home_s - home_s
    return EnergyEstimate(at_s, least.source, on_task_s, home_s, lands_s, least.until_empty_s)
