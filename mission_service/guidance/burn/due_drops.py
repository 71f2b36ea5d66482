"""Finds the drops of an approved plan that are due, and the reasons to skip them."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mission_service.guidance.burn.approved_plan import ApprovedPlan
from mission_service.guidance.burn.burn_state import BurnState
from mission_service.guidance.burn.drop_release import (
    ImpactPoint,
    VehicleMotion,
    impact_point,
    release_decision,
)
from mission_service.guidance.burn.sphere_account import PointXY, Sphere
from mission_service.position_fix import PositionFix

TELEMETRY_S = 0.1
RELEASES_BEFORE_S = 6.0  # a sphere is released at most this long before its planned time
# Limits of a drop, as fractions of the planned height (lowest, highest) and of the planned speed.
LOW_SHARE, HIGH_SHARE, FAST_SHARE = 0.7, 1.4, 1.3


class DueDrop(NamedTuple):
    """A drop that is due or missed; ``why_not`` is the reason to skip it, or None."""

    number: int
    target_m: PointXY
    falls_m: PointXY
    why_not: str | None

    def sphere(self, plan_hash: str, at_us: int) -> Sphere:
        """Return this drop's entry for the sphere account."""
        return Sphere(plan_hash, self.number, at_us, self.target_m, self.falls_m)


def due_drops(state: BurnState, flown: ApprovedPlan, fix: PositionFix) -> Iterator[DueDrop]:
    """Yield each drop of a plan once, when it becomes due, in plan order."""
    drops, until_s = flown.plan.drops, flown.progress.after_s + RELEASES_BEFORE_S
    if flown.next_drop == len(drops) or until_s < drops[flown.next_drop].after_s:
        return
    height_m, dropper = state.height_m(fix), state.burn.dropper
    moving = VehicleMotion(fix.x_m, fix.y_m, height_m, fix.east_m_s, fix.north_m_s)
    wind_m_s = state.wind_m_s(fix.at_s)
    falls = impact_point(moving, wind_m_s, dropper.terminal_speed_m_s, dropper.delay_s)
    too_high = height_m > HIGH_SHARE * flown.plan.drop_height_m
    while flown.next_drop < len(drops) and until_s >= drops[flown.next_drop].after_s:
        x_m, y_m = flown.targets_m[flown.next_drop].tolist()
        due = release_decision(moving, falls, (x_m, y_m), TELEMETRY_S, state.burn.max_miss_m)
        descends = too_high and flown.progress.after_s < drops[flown.next_drop].after_s
        if due == "wait" or descends:
            return
        number, flown.next_drop = flown.next_drop, flown.next_drop + 1
        missed = "the target was passed" if due == "missed" else None
        why_not = missed or _why_not(state, flown, moving, falls, fix)
        yield DueDrop(number, (x_m, y_m), (falls.x_m, falls.y_m), why_not)


def _why_not(
    state: BurnState,
    flown: ApprovedPlan,
    moving: VehicleMotion,
    falls: ImpactPoint,
    fix: PositionFix,
) -> str | None:
    plan, burn, at_us = flown.plan, state.burn, round(fix.at_s * 1e6)
    min_height_m, max_height_m = LOW_SHARE * plan.drop_height_m, HIGH_SHARE * plan.drop_height_m
    if not min_height_m <= moving.height_m <= max_height_m:
        return f"the vehicle is {moving.height_m:.0f} m above the ground"
    if math.hypot(fix.east_m_s, fix.north_m_s) > FAST_SHARE * plan.speed_m_s + 1.0:
        return "the vehicle is too fast"
    last_us, apart_us = state.account.last_at_us, 60e6 / burn.max_drops_per_min
    if last_us is not None and at_us - last_us < apart_us - TELEMETRY_S * 1e6:
        return f"the last drop was {(at_us - last_us) / 1e6:.1f} s ago"
    if state.account.left <= 0:
        return "no spheres are left"
    if not state.unit.may_drop(np.array([(falls.x_m, falls.y_m)]))[0]:
        return "the sphere would fall outside the unit, or near people"
    if state.fire.burns_s(falls.x_m, falls.y_m) <= fix.at_s + burn.ignition_delay_s:
        return "the sphere would fall on burning or burned ground"
    return None
