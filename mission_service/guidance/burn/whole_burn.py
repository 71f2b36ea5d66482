"""Simulates a burn from start to finish: the lines in order, the loads, the times and the fire."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.ellipses.point_observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.lines.flight_constraints import FlightPoint
from mission_service.guidance.burn.lines.line_planner import (
    LinePlan,
    NoPlan,
    Situation,
    constraints_of,
    next_line,
)

Floats = NDArray[np.float64]

MAX_ROUNDS = 2_000  # maximum number of lines, reloads and waits together
WAIT_S, MAX_WAITS = 60.0, 60  # duration and maximum number of waits for fire near home to burn out


@dataclass(frozen=True)
class Assumptions:
    """The settings and the wind on which the results of the simulation depend."""

    ignition_delay_s: float
    spheres_a_load: int
    max_drops_per_min: float
    speed_m_s: float
    climb_m_s: float
    sink_m_s: float
    drop_height_m: float
    safe_height_m: float
    battery_s: float
    battery_reserve_s: float
    reload_s: float
    pause_s: float  # time between the end of a line and the start of the next
    time_margin_s: float
    distance_margin_m: float
    wind_m_s: float  # constant for lines and margins; the fire's wind may change
    toward_rad: float


@dataclass(frozen=True, eq=False)
class BurnLine:
    """A line, or the part of a line that one load of spheres ignites."""

    number: int  # from 1
    load: int  # number of the load, from 1
    plan: LinePlan

    @property
    def end_s(self) -> float:
        """Return the time at which the vehicle begins to hold at the safe height."""
        return self.plan.begin_s + self.plan.duration_s


@dataclass(frozen=True, eq=False)
class WholeBurn:
    """A whole burn; ``ended`` is the reason for its end, ``end_s`` the time of the last landing."""

    lines: tuple[BurnLine, ...]
    loads: int
    begin_s: float
    end_s: float
    fire: Simulation
    area_left: BaseGeometry
    ended: NoPlan
    assumptions: Assumptions


class CombinedFires:
    """Several fires combined: each point ignites at its earliest ignition time in any fire."""

    def __init__(self, fires: Sequence[Simulation]) -> None:
        self.fires = tuple(fires)

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the ignition times (n,) of points (n, 2; x, y in metres); infinity if never."""
        found: Floats = np.min([fire.ignition_time_s(points_m) for fire in self.fires], axis=0)
        return found


def whole_burn(situation: Situation, settings: BurnSection, pause_s: float = 0.0) -> WholeBurn:
    """Plan all lines from a situation until none is left, each ``pause_s`` after the previous one.

    If the spheres or the battery do not suffice for the rest of a line, the vehicle reloads before
    the rest is flown, unless its load and battery are still full. For a reload the vehicle returns
    home at the safe height, spends ``reload_s`` on the ground, and takes off at home.
    """
    now, base = situation, situation.fire
    lit = np.empty((0, 3))
    lines: list[BurnLine] = []
    load, waits = 1, 0
    fresh = now.spheres >= settings.spheres and now.battery_s >= settings.battery_s
    for _ in range(MAX_ROUNDS):
        plan = next_line(now, settings)
        short = plan.why in ("spheres", "battery") if isinstance(plan, NoPlan) else bool(plan.ended)
        if short and not fresh:
            now, load, fresh = _reloaded(now, settings), load + 1, True
            continue
        if isinstance(plan, NoPlan):
            # Wait until fire near home, for example from the burn's own spheres, burns out.
            if plan.why == "danger" and waits < MAX_WAITS:
                now, waits = replace(now, at_s=now.at_s + WAIT_S), waits + 1
                continue
            break
        lines.append(BurnLine(len(lines) + 1, load, plan))
        delay_s = plan.begin_s + settings.ignition_delay_s
        lit = np.concatenate([lit, plan.drops + np.array([0.0, 0.0, delay_s])])
        now, fresh = _after(now, plan, CombinedFires([base, now.lights(lit)]), pause_s), False
    else:
        plan = NoPlan("complete", f"stopped after {MAX_ROUNDS} lines and reloads")
    return WholeBurn(
        lines=tuple(lines),
        loads=load,
        begin_s=situation.at_s,
        end_s=now.at_s + _return_s(now, settings),
        fire=now.fire,
        area_left=now.area,
        ended=plan if isinstance(plan, NoPlan) else NoPlan("complete", "burn complete"),
        assumptions=_assumed(situation, settings, pause_s),
    )


def _after(now: Situation, plan: LinePlan, fire: Simulation, pause_s: float) -> Situation:
    x_m, y_m, height_m, after_s = plan.path[-1].tolist()
    return replace(
        now,
        area=plan.area_left,
        dropped_m=np.concatenate([now.dropped_m, plan.drops[:, :2]]),
        fire=fire,
        at_s=plan.begin_s + after_s + pause_s,
        x_m=x_m,
        y_m=y_m,
        height_m=height_m,
        spheres=plan.spheres_left,
        battery_s=now.battery_s - after_s - pause_s,
    )


def _return_s(now: Situation, settings: BurnSection) -> float:
    """Return the duration of a return home; 0 for a vehicle on the ground at home."""
    if now.height_m <= 0.0 and (now.x_m, now.y_m) == now.home_m:
        return 0.0
    start = FlightPoint(now.x_m, now.y_m, now.height_m, now.at_s)
    air = constraints_of(now, settings)
    above = air.straight_up(start)[-1]
    home_s = air.home_s(above)
    return above.at_s - start.at_s + (home_s if math.isfinite(home_s) else 0.0)


def _reloaded(now: Situation, settings: BurnSection) -> Situation:
    return replace(
        now,
        at_s=now.at_s + _return_s(now, settings) + settings.reload_s,
        x_m=now.home_m[0],
        y_m=now.home_m[1],
        height_m=0.0,
        spheres=settings.spheres,
        battery_s=settings.battery_s,
    )


def _assumed(situation: Situation, settings: BurnSection, pause_s: float) -> Assumptions:
    given: dict[str, Any] = {
        "spheres_a_load": settings.spheres,
        "pause_s": pause_s,
        "wind_m_s": situation.wind_m_s,
        "toward_rad": situation.toward_rad,
    }
    names = [field.name for field in fields(Assumptions) if field.name not in given]
    return Assumptions(**given, **{name: getattr(settings, name) for name in names})
