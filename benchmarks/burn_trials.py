"""Random burns (units, fires, winds and settings) and random changes during a flight."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Floats
from firemodel.ellipses.ellipse import EllipseFire, Spread
from firemodel.ellipses.line_ignitions import line_sources
from mission_service.config.sections import BurnSection, Station
from mission_service.guidance.burn.burn_unit import BurnUnit, ExclusionCircle
from mission_service.guidance.burn.lines.ignition_lines import only_areas
from mission_service.guidance.burn.lines.line_planner import LinePlan, Situation

Random = np.random.Generator

BASE = BurnSection(
    unit=((0.0, 0.0), (0.0, 1.0), (1.0, 1.0)),
    stations=(Station(name="chief", lat_deg=0.0, lon_deg=0.0),),
)


@dataclass(frozen=True)
class Trial:
    """A planning situation, its settings, and the rates and sources of its fire."""

    situation: Situation
    settings: BurnSection
    spreads: tuple[Spread, ...]
    sources: Floats


def drawn(random: Random) -> Trial:
    """Return a random burn, before its first line or between two lines."""
    settings = _settings(random)
    unit = _unit(random, settings.edge_m)
    toward = float(random.uniform(-math.pi, math.pi))
    wind = float(random.choice([0.0, random.uniform(0.5, 8.0)]))
    spreads = [_spread(random, -math.inf, toward)]
    if random.random() < 0.3:
        spreads.append(_spread(random, float(random.uniform(-100, 400)), toward + random.normal()))
    spreads[0] = spreads[0]._replace(from_s=-1e6)
    fires = [_fire(random, unit) for _ in range(random.integers(0, 5))]
    sources = np.concatenate([np.empty((0, 3)), *fires])
    area = _cut(random, unit.area)
    dropped = np.empty((0, 2))
    if random.random() < 0.4:  # an earlier line of spheres
        dropped = _fire(random, unit)[:, :2]
    height = float(random.choice([0.0, settings.drop_height_m, settings.safe_height_m, 33.0]))
    start = _point(random, unit.area if random.random() < 0.7 else unit.area.buffer(40.0))
    if unit.fence is not None and not unit.fence.covers(shapely.Point(start)):
        start = _point(random, unit.fence)
    home = _point(random, unit.area.buffer(30.0) if unit.fence is None else unit.fence)
    situation = Situation(
        unit=unit,
        area=area,
        dropped_m=dropped,
        fire=EllipseFire(spreads, sources),
        lights=_lights(spreads),
        at_s=float(random.uniform(0, 200)),
        x_m=start[0],
        y_m=start[1],
        height_m=height,
        wind_m_s=wind,
        toward_rad=toward,
        spheres=int(random.integers(1, 60)),
        battery_s=float(random.uniform(100, 1500)),
        home_m=home,
    )
    return Trial(situation, settings, tuple(spreads), sources)


def changed(random: Random, trial: Trial, plan: LinePlan) -> Trial:
    """Return the situation during a plan after new fire, a wind shift or an exclusion circle."""
    old, settings = trial.situation, trial.settings
    after = float(random.uniform(0, plan.duration_s))
    x, y, height = (float(np.interp(after, plan.path[:, 3], plan.path[:, n])) for n in range(3))
    done = plan.drops[plan.drops[:, 2] <= after] + np.array([0.0, 0.0, plan.begin_s])
    lit = done + np.array([0.0, 0.0, settings.ignition_delay_s])
    sources, spreads = np.concatenate([trial.sources, lit]), list(trial.spreads)
    now = plan.begin_s + after
    unit, toward, wind = old.unit, old.toward_rad, old.wind_m_s
    change = random.integers(3)
    if change == 0:
        more = _fire(random, unit)
        more[:, 2] = np.minimum(more[:, 2], now)
        sources = np.concatenate([sources, more])
    elif change == 1:
        toward += float(random.normal())
        wind = float(random.uniform(0, 8))
        spreads = [spread for spread in spreads if spread.from_s < now]
        spreads.append(_spread(random, now, toward))
    else:
        near = (x + float(random.normal(0, 20)), y + float(random.normal(0, 20)))
        unit = unit.with_people(
            (*unit.people, ExclusionCircle("new", *near, float(random.uniform(5, 25))))
        )
    situation = replace(
        old,
        unit=unit,
        dropped_m=np.concatenate([old.dropped_m, done[:, :2]]),
        fire=EllipseFire(spreads, sources),
        lights=_lights(spreads),
        at_s=now,
        x_m=x,
        y_m=y,
        height_m=height,
        wind_m_s=wind,
        toward_rad=toward,
        spheres=old.spheres - len(done),
        battery_s=old.battery_s - after,
    )
    return Trial(situation, settings, tuple(spreads), sources)


def _lights(spreads: list[Spread]) -> Any:
    return lambda sources: EllipseFire(spreads, sources)


def _settings(random: Random) -> BurnSection:
    speed = float(random.uniform(2, 8))
    rate = float(random.choice([30.0, 60.0, 120.0]))
    least = speed * 60.0 / rate
    return BASE.model_copy(
        update={
            "line_spacing_m": float(random.uniform(8, 40)),
            "drop_spacing_m": least + float(random.choice([0.0, random.uniform(0, 20)])),
            "speed_m_s": speed,
            "climb_m_s": float(random.uniform(1, 4)),
            "sink_m_s": float(random.uniform(1, 3)),
            "drop_height_m": float(random.uniform(8, 25)),
            "safe_height_m": float(random.uniform(40, 80)),
            "time_margin_s": float(random.uniform(0, 90)),
            "distance_margin_m": float(random.uniform(2, 15)),
            "wind_margin_s": float(random.choice([0.0, random.uniform(0, 3)])),
            "residence_s": float(random.uniform(0, 200)),
            "edge_m": float(random.choice([0.0, random.uniform(0, 8)])),
            "max_drops_per_min": rate,
            "ignition_delay_s": float(random.uniform(5, 60)),
            "battery_reserve_s": float(random.uniform(0, 100)),
        }
    )


def _about(random: Random, far: float) -> tuple[float, float]:
    x, y = random.uniform(-far, far, 2).tolist()
    return x, y


def _star(random: Random, middle: tuple[float, float], low: float, high: float) -> BaseGeometry:
    """Return a random polygon around a point, in most cases concave."""
    count = int(random.integers(3, 11))
    angles = np.sort(random.uniform(0, 2 * math.pi, count))
    far = random.uniform(low, high, count)
    shape = shapely.Polygon(
        np.stack([middle[0] + far * np.cos(angles), middle[1] + far * np.sin(angles)], axis=1)
    )
    return only_areas(shapely.make_valid(shape))


def _unit(random: Random, edge_m: float) -> BurnUnit:
    while True:
        area = _star(random, (0.0, 0.0), 30.0, 150.0)
        if random.random() < 0.2:
            area = area.union(_star(random, _about(random, 150), 20.0, 80.0))
        if random.random() < 0.3:
            area = area.difference(_star(random, _about(random, 60), 5.0, 40.0))
        area = only_areas(area)
        no_drop: BaseGeometry = shapely.MultiPolygon()
        if random.random() < 0.3:
            no_drop = _star(random, _about(random, 80), 5.0, 40.0)
        fence: BaseGeometry | None = None
        if random.random() < 0.5:
            wider_m = float(random.uniform(-5, 30))
            fence = shapely.make_valid(area.buffer(wider_m, join_style="mitre"))
            fence = fence.difference(_star(random, _about(random, 150), 10.0, 60.0))
            parts = shapely.get_parts(only_areas(fence))
            fence = max(parts, key=lambda part: part.area) if len(parts) else None
        people = tuple(
            ExclusionCircle(f"p{number}", *_about(random, 120), float(random.uniform(3, 25)))
            for number in range(random.integers(0, 4))
        )
        unit = BurnUnit(area, no_drop, fence, people, edge_m)
        if area.area > 1500.0 and not unit.droppable.is_empty:
            return unit


def _spread(random: Random, from_s: float, toward: float) -> Spread:
    back = float(random.choice([0.005, 0.02, 0.05, 0.2]))
    flank = back * float(random.choice([1.0, random.uniform(1.0, 3.0)]))
    head = flank * float(random.uniform(1.0, 30.0))
    return Spread(from_s, head, back, flank, toward)


def _fire(random: Random, unit: BurnUnit) -> Floats:
    """Return the sources of a point ignition, or of a line along or across the unit's edge."""
    west, south, east, north = unit.area.bounds
    at = float(random.uniform(-600, 300))
    kind = random.integers(3)
    places = random.uniform((west - 20, south - 20), (east + 20, north + 20), (2, 2))
    if kind == 0:
        places = places[:1]
    elif kind == 1:
        ring = shapely.get_rings(shapely.get_parts(unit.area))[0]
        begin = float(random.uniform(0, ring.length))
        part = shapely.line_interpolate_point(ring, np.linspace(begin, begin + 80.0, 12))
        places = shapely.get_coordinates(part)
    return line_sources(places, at, float(random.uniform(4, 20)))


def _cut(random: Random, area: BaseGeometry) -> BaseGeometry:
    """Return the whole area, or a random part of it that earlier lines have not burned."""
    if random.random() < 0.7:
        return area
    half = shapely.affinity.rotate(
        shapely.box(-1000, -1000, 1000, float(random.uniform(-60, 60))),
        float(random.uniform(0, 360)),
        origin=(0, 0),
    )
    left = only_areas(area.difference(half))
    return area if left.is_empty else left


def _point(random: Random, area: BaseGeometry) -> tuple[float, float]:
    west, south, east, north = area.bounds
    while True:
        x, y = float(random.uniform(west, east)), float(random.uniform(south, north))
        if area.covers(shapely.Point(x, y)):
            return x, y
