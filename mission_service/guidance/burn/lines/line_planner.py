"""Plans the next ignition line using algorithm 1 of Beachly et al. (section V).

The paper leaves some points open, which are decided here as follows:

- The burn is complete when no area is left upwind of the next line. If the next line lies in a gap
  between parts of the area, or has no safe drop, the line is cut off: planning continues with the
  area upwind of the line.
- The faster of the two paths is chosen. A path with less than ``MIN_DROPS_SHARE`` of the other
  path's drops is not chosen, because a gap in a line is worse than a delay of one minute.
- If the spheres or the battery end a line early, the remaining area does not change. The next plan
  is then for the rest of the same line, because positions near earlier drops are excluded.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.ellipses.point_observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.lines.flight_constraints import (
    FireOfSources,
    FlightConstraints,
    FlightPoint,
)
from mission_service.guidance.burn.lines.hazard import hazard_of, margins_of
from mission_service.guidance.burn.lines.ignition_lines import (
    IgnitionLine,
    alignment_m,
    drop_points,
    extent_across,
    line_across,
    upwind_of,
)
from mission_service.guidance.burn.lines.line_flight import LineFlight, fly_line

Floats = NDArray[np.float64]

MIN_DROPS_SHARE = 0.9  # a path needs at least this fraction of the other path's drops
ON_GROUND_M = 1.0
MAX_LINES = 10_000  # maximum number of lines in one burn


@dataclass(frozen=True, eq=False)
class Situation:
    """The situation in which a line is planned, in the landscape's metres and mission time.

    ``area`` is the remaining part of the unit, and ``dropped_m`` (n, 2) holds the previous drops of
    this burn. ``fire`` simulates all fire, including fire from previous drops. ``lights`` returns
    the fire from given sources only, as an ``EllipseFire`` that spreads in the same way.
    """

    unit: BurnUnit
    area: BaseGeometry
    dropped_m: Floats
    fire: Simulation
    lights: FireOfSources
    at_s: float  # time at which the plan begins
    x_m: float
    y_m: float
    height_m: float  # the vehicle's height above the ground
    wind_m_s: float
    toward_rad: float  # direction towards which the wind blows, anticlockwise from grid east
    spheres: int  # number of spheres on board
    battery_s: float  # remaining flight time
    home_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class LinePlan:
    """The plan for a line; its times are relative to ``begin_s``.

    ``area_left`` is the area that remains after all drops. If ``climbs_first``, the start is in
    danger, and the plan begins with a climb that is not safe. ``min_time_margin_s`` includes that
    climb. The margin is negative if fire is within reach, and infinite if no fire comes within
    reach.
    """

    begin_s: float
    path: Floats  # (n, 4) x, y, height_m, after_s; at its end the vehicle holds at the safe height
    drops: Floats  # (m, 3) x, y, after_s
    skipped: Floats  # (k, 2) positions where no drop is safe
    duration_s: float
    min_time_margin_s: float
    area_left: BaseGeometry
    line: IgnitionLine
    ended: Literal["", "spheres", "battery"]  # reason for an early end
    climbs_first: bool
    home_s: float  # duration of the return home from the path's end, including landing
    spheres_left: int
    lines_cut: int  # number of lines cut off before this line, because no drop was safe there


@dataclass(frozen=True, eq=False)
class NoPlan:
    """The reason why no line is planned, and the number of lines cut off without a safe drop."""

    why: Literal["complete", "spheres", "battery", "danger", "outside"]
    words: str
    lines_cut: int = 0


def next_line(situation: Situation, settings: BurnSection) -> LinePlan | NoPlan:
    """Plan the next line, and check it against all fire, including fire from the line's own drops.

    Raises MissionServiceError if drops would follow each other too quickly, if the unit needs too
    many lines, or if the fire simulation returns invalid times.
    """
    _refuse_too_fast(settings)
    start = FlightPoint(situation.x_m, situation.y_m, situation.height_m, situation.at_s)
    air = constraints_of(situation, settings)
    if air.high is not None and not air.high.is_straight_clear(start[:2], start[:2]):
        return NoPlan("outside", "the vehicle is outside the fence; fly it back inside")
    on_ground = situation.height_m < ON_GROUND_M
    if on_ground and not air.margin_s((start, start)) >= settings.time_margin_s:
        return NoPlan("danger", "the fire is too close to the vehicle on the ground")
    area, lines_cut = situation.area, 0
    for _ in range(MAX_LINES):
        if area.is_empty:
            break
        line = line_across(area, situation.toward_rad, settings.line_spacing_m)
        rest = upwind_of(area, line)
        if rest.is_empty:
            break
        trips = [
            fly_line(
                *(air, start, places, situation.spheres),
                situation.battery_s - settings.battery_reserve_s,
            )
            for places in drop_orders(situation, settings, area, line)
        ]
        best = fastest_flight(trips)
        if best is not None:
            return _plan(best, situation, line, rest, lines_cut)
        if any(trip.why_ended == "spheres" for trip in trips):
            return NoPlan("spheres", "no spheres are left; reload them", lines_cut)
        if any(trip.why_ended == "battery" for trip in trips):
            return NoPlan("battery", "the battery is too low for another drop; replace it")
        area, lines_cut = rest, lines_cut + 1
    else:
        raise MissionServiceError(
            f"burn: more than {MAX_LINES} lines at a spacing of {settings.line_spacing_m:g} m; "
            "increase line_spacing_m"
        )
    cut = f"; no drop is safe on {lines_cut} more lines" if lines_cut else ""
    return NoPlan("complete", f"burn complete{cut}", lines_cut)


def constraints_of(situation: Situation, settings: BurnSection) -> FlightConstraints:
    """Return the constraints that apply to every flight in a situation."""
    margins = margins_of(settings, situation.wind_m_s, situation.toward_rad)
    unit = situation.unit
    hazard = hazard_of(situation.fire, unit.area.bounds, margins)
    return FlightConstraints(
        *(unit, settings, situation.fire, situation.lights, hazard),
        *(unit.low_graph, unit.high_graph, situation.home_m),
    )


def drop_orders(
    situation: Situation, settings: BurnSection, area: BaseGeometry, line: IgnitionLine
) -> list[Floats]:
    """Return a line's drop positions (n, 2) twice, ordered from each end (algorithm lines 5 to 8).

    The algorithm flies to the nearest remaining position; because all positions are on the same
    line, this is always the neighbour. The list is empty if the line has no position for a drop.
    """
    ends_m = extent_across(area, line)
    if ends_m is None:
        return []
    spacing_m = settings.drop_spacing_m
    near_m = settings.line_spacing_m / 2.0
    through_m = alignment_m(line, ends_m, situation.dropped_m, area, near_m)
    places = drop_points(line, ends_m, through_m, spacing_m)
    places = places[situation.unit.may_drop(places) & shapely.covers(area, shapely.points(places))]
    if len(situation.dropped_m) and len(places):
        apart = places[:, None, :] - situation.dropped_m[None, :, :]
        nearest_m = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1)
        places = places[nearest_m >= min(spacing_m, settings.line_spacing_m) / 2.0]
    return [places[::-1], places] if len(places) else []


def fastest_flight(trips: list[LineFlight]) -> LineFlight | None:
    """Return the fastest flight with enough drops, or None if no flight has a drop.

    A flight to the line's end is preferred to one that the spheres or the battery cut short.
    If flights have the same duration, the first is returned.
    """
    max_drops = max((len(trip.drops) for trip in trips), default=0)
    enough = [trip for trip in trips if len(trip.drops) >= max(MIN_DROPS_SHARE * max_drops, 1)]
    return min(enough, key=lambda trip: (trip.why_ended != "", trip.duration_s), default=None)


def _plan(
    trip: LineFlight, situation: Situation, line: IgnitionLine, rest: BaseGeometry, lines_cut: int
) -> LinePlan:
    begin_s = situation.at_s
    path = np.array(trip.route, np.float64)
    path[:, 3] -= begin_s
    drops = trip.drops - (0.0, 0.0, begin_s)
    return LinePlan(
        begin_s=begin_s,
        path=path,
        drops=drops,
        skipped=trip.skipped,
        duration_s=trip.duration_s,
        min_time_margin_s=trip.min_margin_s,
        area_left=situation.area if trip.why_ended else rest,
        line=line,
        ended=trip.why_ended,
        climbs_first=trip.climbs_first,
        home_s=trip.home_s,
        spheres_left=situation.spheres - len(drops),
        lines_cut=lines_cut,
    )


def _refuse_too_fast(settings: BurnSection) -> None:
    min_spacing_m = settings.speed_m_s * 60.0 / settings.max_drops_per_min
    if settings.drop_spacing_m < min_spacing_m * (1.0 - 1e-9):
        raise MissionServiceError(
            f"burn: drop_spacing_m = {settings.drop_spacing_m:g} must be at least "
            f"{min_spacing_m:g} m at {settings.speed_m_s:g} m/s and "
            f"{settings.max_drops_per_min:g} drops a minute"
        )
