"""Check ignition plans by brute force, with fine samples of the path and its surroundings.

The check shares no code, raster or geometry with the planner. It takes arrival times directly from
the fire model. It tests each side of a polygon to determine whether a point is inside, and its
distance.
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Floats
from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.lines.line_planner import LinePlan, Situation

# Spacing of samples in the surroundings, on level legs, and in climbs and descents.
GRID_M, STEP_M, STEP_S = 0.7, 0.8, 0.5
NEAR_M = 1e-3


def faults(
    plan: LinePlan, situation: Situation, settings: BurnSection, sources: Floats
) -> list[str]:
    """Return one line for each fault of a plan.

    The places of ``sources`` (n, 3) x, y, at_s of the fire are checked in addition to the grid.
    """
    return [
        *_of_flight(plan, situation, settings),
        *_of_drops(plan, situation, settings),
        *_of_places(plan, situation, settings),
        *_of_fire(plan, situation, settings, sources),
    ]


def _of_flight(plan: LinePlan, situation: Situation, settings: BurnSection) -> Iterator[str]:
    path = plan.path
    start = (situation.x_m, situation.y_m, situation.height_m, 0.0)
    if not np.allclose(path[0], start, atol=1e-6):
        yield f"begins at {path[0]}, not at {start}"
    if abs(path[-1, 2] - max(path[-1, 2], settings.safe_height_m)) > 1e-6:
        yield f"ends at {path[-1, 2]} m"
    for one, other in pairwise(path):
        level, up = math.hypot(*(other[:2] - one[:2])), other[2] - one[2]
        rate = settings.climb_m_s if up > 0 else settings.sink_m_s
        needs = level / settings.speed_m_s if abs(up) < 1e-9 else abs(up) / rate
        if abs(up) > 1e-9 and level > 1e-6:
            yield f"leg {one} to {other} is neither level nor vertical"
        if abs(other[3] - one[3] - needs) > 1e-6 * max(1.0, needs):
            yield f"leg {one} to {other} takes {needs} s"
        low = level > 1e-6 and one[2] < settings.safe_height_m - 1e-6
        if low and abs(one[2] - settings.drop_height_m) > 1e-6:
            yield f"flown at {one[2]} m"
    if abs(path[-1, 3] - plan.duration_s) > 1e-6:
        yield "duration is not that of the path"
    home_m = math.hypot(*(path[-1, :2] - np.array(situation.home_m)))
    home_s = home_m / settings.speed_m_s + path[-1, 2] / settings.sink_m_s
    if plan.duration_s + home_s > situation.battery_s - settings.battery_reserve_s + 1e-6:
        yield f"battery: {plan.duration_s} s and {home_s} s for the way home"


def _of_drops(plan: LinePlan, situation: Situation, settings: BurnSection) -> Iterator[str]:
    drops, unit = plan.drops, situation.unit
    if not 0 < len(drops) <= situation.spheres:
        yield f"{len(drops)} drops with {situation.spheres} spheres"
    if len(drops) > 1 and np.diff(drops[:, 2]).min() < 60.0 / settings.max_drops_per_min - 1e-6:
        yield "drops too fast"
    for number in range(4):
        at = np.interp(drops[:, 2], plan.path[:, 3], plan.path[:, min(number, 2)])
        want = drops[:, number] if number < 2 else np.full(len(drops), settings.drop_height_m)
        if np.abs(at - want).max(initial=0.0) > 1e-4:
            yield "a drop is not on the path"
    within, away = _inside(drops[:, :2], unit.area)
    if (~within | (away < settings.edge_m - 1e-6)).any():
        yield f"drop outside of the unit, or within {settings.edge_m} m of its edge"
    within, away = _inside(drops[:, :2], unit.no_drop)
    if (within | (away < settings.edge_m - 1e-6)).any():
        yield "drop on a no-drop area"
    if unit.fence is not None and not _inside(drops[:, :2], unit.fence)[0].all():
        yield "drop outside of the fence"
    for person in unit.people:
        if (np.hypot(*(drops[:, :2] - person[1:3]).T) < person.radius_m).any():
            yield f"drop in the exclusion circle {person.name}"
    burns = drops[:, 2] + plan.begin_s + settings.ignition_delay_s
    if (situation.fire.ignition_time_s(drops[:, :2]) <= burns).any():
        yield "drop on burned ground"
    for number in range(1, len(drops)):
        before = np.column_stack([drops[:number, :2], burns[:number]])
        if (
            situation.lights(before).ignition_time_s(drops[number : number + 1, :2])
            <= burns[number]
        ):
            yield "drop on ground burned by an earlier drop"


def _of_places(plan: LinePlan, situation: Situation, settings: BurnSection) -> Iterator[str]:
    unit, path = situation.unit, plan.path
    legs = [_samples(one, other) for one, other in pairwise(path)]
    number = np.repeat(np.arange(len(legs)), [len(leg) for leg in legs])
    points = np.concatenate(legs)[:, :2]
    if unit.fence is not None:
        within, away = _inside(points, unit.fence)
        for leg in np.unique(number[~within & (away > NEAR_M)]):
            yield f"leg {leg} leaves the fence"
    # The first climb or descent at the start position may be outside the unit.
    low = np.array([min(a, b) < settings.safe_height_m - 1e-6 for a, b in pairwise(path[:, 2])])
    at_start = [np.hypot(*(leg[:, :2] - path[0, :2]).T).max() < 1e-6 for leg in legs]
    low &= ~np.array(at_start)
    points, number = points[low[number]], number[low[number]]
    within, away = _inside(points, unit.area)
    for leg in np.unique(number[~within & (away > NEAR_M)]):
        yield f"leg {leg} leaves the unit below the safe height"
    for person in unit.people:
        near = np.hypot(*(points - person[1:3]).T) < person.radius_m - NEAR_M
        for leg in np.unique(number[near]):
            yield f"leg {leg} is below the safe height in the exclusion circle {person.name}"


def _of_fire(
    plan: LinePlan, situation: Situation, settings: BurnSection, sources: Floats
) -> Iterator[str]:
    path = plan.path + np.array([0.0, 0.0, 0.0, plan.begin_s])
    drops = plan.drops + np.array([0.0, 0.0, plan.begin_s + settings.ignition_delay_s])
    low = [
        (number, one, other)
        for number, (one, other) in enumerate(pairwise(path))
        if min(one[2], other[2]) < settings.safe_height_m - 1e-6
    ]
    reach_m = settings.distance_margin_m + settings.wind_margin_s * situation.wind_m_s
    places = _around([_samples(one, other) for _, one, other in low], reach_m)
    places = np.concatenate([places, sources[:, :2], drops[:, :2]])
    fire_s = situation.fire.ignition_time_s(places)
    min_s = math.inf
    for number, one, other in low:
        samples = _samples(one, other)
        if plan.climbs_first and number == 0:
            continue
        margin_s = _least(samples, places, fire_s, situation, settings)
        min_s = min(min_s, margin_s)
        if margin_s < settings.time_margin_s:
            yield f"leg {number} is in danger: time margin to the fire {margin_s:.1f} s"
        # Only earlier drops matter: later ones ignite after the leg.
        before = drops[drops[:, 2] - settings.ignition_delay_s <= one[3] + 1e-6]
        if not len(before):
            continue
        first, last = samples[0, :2], samples[-1, :2]
        nears = one[2] > other[2]
        for x, y, _ in before:
            away = np.hypot(*(samples[:, :2] - (x, y)).T)
            nears |= bool(np.minimum.accumulate(away[::-1])[::-1].min() < away[0] - 0.01)
        need_s = settings.time_margin_s if nears else 0.0
        own_s = situation.lights(before).ignition_time_s(places)
        margin_s = _least(samples, places, own_s, situation, settings)
        if margin_s < need_s:
            yield (
                f"leg {number} {first} to {last} is in danger of its own drops: {margin_s:.1f} s"
            )
    if min_s < plan.min_time_margin_s - 1e-3 and not plan.climbs_first:
        yield f"smallest margin {min_s:.2f} s, but the plan has {plan.min_time_margin_s:.2f} s"


def _least(
    samples: Floats, places: Floats, times: Floats, situation: Situation, settings: BurnSection
) -> float:
    """Return the smallest time margin in s to fire within reach, computed from its definition."""
    matters = np.isfinite(times)
    low, high = samples[:, :2].min(axis=0), samples[:, :2].max(axis=0)
    reach_m = settings.distance_margin_m + settings.wind_margin_s * situation.wind_m_s
    matters &= ((places >= low - reach_m) & (places <= high + reach_m)).all(axis=1)
    matters &= times > samples[0, 3] - settings.residence_s
    places, times = places[matters], times[matters]
    wind = situation.wind_m_s * np.array(
        [math.cos(situation.toward_rad), math.sin(situation.toward_rad)]
    )
    min_s = math.inf
    for x, y, _, at_s in samples:
        # Only fire with a margin below the smallest found so far is considered.
        could = (times - at_s < min_s) & (times > at_s - settings.residence_s)
        away = np.array([x, y]) - places[could]
        distance = np.hypot(*away.T)
        downwind = np.maximum(away @ wind, 0.0) / np.maximum(distance, 1e-9)
        near = distance <= settings.distance_margin_m + settings.wind_margin_s * downwind
        if near.any():
            min_s = float((times[could][near] - at_s).min())
    return min_s


def _samples(one: Floats, other: Floats) -> Floats:
    level = math.hypot(*(other[:2] - one[:2]))
    count = max(math.ceil(level / STEP_M), 1 if level else math.ceil((other[3] - one[3]) / STEP_S))
    return np.asarray(one + (other - one) * np.linspace(0.0, 1.0, count + 1)[:, None])


def _around(legs: list[Floats], reach_m: float) -> Floats:
    """Return the points (n, 2) of a fine grid within reach of some samples."""
    if not legs:
        return np.empty((0, 2))
    middles = np.round(np.concatenate(legs)[:, :2] / GRID_M).astype(np.int64)
    width = math.ceil(reach_m / GRID_M) + 2
    low = middles.min(axis=0) - width
    away = np.ones(middles.max(axis=0) + width + 1 - low, np.bool_)
    away[middles[:, 0] - low[0], middles[:, 1] - low[1]] = False
    near = ndimage.distance_transform_edt(away) <= width
    found: Floats = (np.argwhere(near) + low) * GRID_M
    return found


def _inside(points: Floats, area: BaseGeometry) -> tuple[NDArray[np.bool_], Floats]:
    """Return whether points (n, 2) are inside (by counting crossings), and distances from sides."""
    within, away = np.zeros(len(points), np.bool_), np.full(len(points), np.inf)
    for ring in shapely.get_rings(shapely.get_parts(area)):
        for (ax, ay), (bx, by) in pairwise(shapely.get_coordinates(ring).tolist()):
            crosses = (points[:, 1] < ay) != (points[:, 1] < by)
            with np.errstate(divide="ignore", invalid="ignore"):
                at_x = ax + (points[:, 1] - ay) / (by - ay) * (bx - ax)
            within ^= crosses & (points[:, 0] < at_x)
            side = np.array([bx - ax, by - ay])
            part = np.clip(((points - (ax, ay)) @ side) / max(float(side @ side), 1e-12), 0.0, 1.0)
            away = np.minimum(away, np.hypot(*(points - (ax, ay) - part[:, None] * side).T))
    return within, away
