"""The next ignition line: algorithm 1 of Beachly et al. (section V), and its open points.

- The burn is complete when nothing is left upwind of the next line. A line between the parts of an
  area is cut off like one without a safe drop; more may be left upwind.
- The faster of the two paths is taken, but only among those that drop at least ``MIN_DROPS_SHARE``
  of what the better one drops: a gap in a line costs more than a minute does.
- A line that spheres or battery end early leaves the area as it was: the next plan is for the rest
  of the same line, since places near earlier drops are no longer candidates.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.ellipses.observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.hazard import hazard_of, margins_of
from mission_service.guidance.burn.ignition_lines import (
    IgnitionLine,
    alignment_m,
    drop_points,
    extent_across,
    line_across,
    upwind_of,
)
from mission_service.guidance.burn.line_flight import (
    FireOfSources,
    FlightConstraints,
    FlightPoint,
    LineFlight,
    fly_line,
)

Floats = NDArray[np.float64]

MIN_DROPS_SHARE = 0.9  # of the drops of the path with more of them; the other may do with so many
ON_GROUND_M = 1.0
MAX_LINES = 10_000  # of one burn


@dataclass(frozen=True, eq=False)
class Situation:
    """The input of a line's plan, in the landscape's metres and seconds of mission time.

    ``area`` is the part of the unit still to be burned; ``dropped_m`` (n, 2) are the drops of this
    burn so far. ``fire`` is the simulation of all fire, with that of the spheres dropped before;
    ``lights`` returns the fire of some sources alone, an EllipseFire of the same spreads.
    """

    unit: BurnUnit
    area: BaseGeometry
    dropped_m: Floats
    fire: Simulation
    lights: FireOfSources
    at_s: float  # when the plan begins
    x_m: float
    y_m: float
    height_m: float  # of the vehicle above the ground
    wind_m_s: float
    toward_rad: float  # where the wind blows to, anticlockwise from the grid's east
    spheres: int  # left
    battery_s: float  # of flight left
    home_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class LinePlan:
    """The plan of a line, all times after ``begin_s``.

    ``area_left`` is the area that remains after all drops. ``climbs_first``: the vehicle is in
    danger at its start, and the first climb is not safe (it counts in ``min_time_margin_s``,
    which is negative where it burns, infinite if no fire comes near).
    """

    begin_s: float
    path: Floats  # (n, 4) x, y, height_m, after_s; ends at the safe height, to hold there
    drops: Floats  # (m, 3) x, y, after_s
    skipped: Floats  # (k, 2): not safe to drop at
    duration_s: float
    min_time_margin_s: float
    area_left: BaseGeometry
    line: IgnitionLine
    ended: Literal["", "spheres", "battery"]  # what ended it before the line was done
    climbs_first: bool
    home_s: float  # from its end to the ground at home, at the safe height
    spheres_left: int
    lines_cut: int  # off before it, since no drop was safe there


@dataclass(frozen=True, eq=False)
class NoPlan:
    """Why there is no plan. ``complete``: no line is left; ``lines_cut`` had no safe drop."""

    why: Literal["complete", "spheres", "battery", "danger", "outside"]
    words: str
    lines_cut: int = 0


def next_line(situation: Situation, settings: BurnSection) -> LinePlan | NoPlan:
    """The plan of the next line, checked against the fire it will itself light.

    Raises MissionServiceError if drops would come faster than may be, or the fire simulation gives
    no times.
    """
    _refuse_too_fast(settings)
    start = FlightPoint(situation.x_m, situation.y_m, situation.height_m, situation.at_s)
    air = constraints_of(situation, settings)
    if air.high is not None and not air.high.is_straight_clear(start[:2], start[:2]):
        return NoPlan("outside", "the vehicle is outside the fence; bring it back")
    if situation.height_m < ON_GROUND_M and not _safe_start(air, start):
        return NoPlan("danger", "fire is too near the place where the vehicle stands")
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
            return NoPlan("spheres", "no spheres are left; reload", lines_cut)
        if any(trip.why_ended == "battery" for trip in trips):
            return NoPlan("battery", "the battery suffices for no further drop; change it")
        area, lines_cut = rest, lines_cut + 1
    else:
        raise MissionServiceError(
            f"burn: more than {MAX_LINES} lines of {settings.line_spacing_m:g} m; make "
            "line_spacing_m larger"
        )
    cut = f"; on {lines_cut} more lines no drop is safe" if lines_cut else ""
    return NoPlan("complete", f"burn complete{cut}", lines_cut)


def constraints_of(situation: Situation, settings: BurnSection) -> FlightConstraints:
    """The constraints of all flights of a situation."""
    margins = margins_of(settings, situation.wind_m_s, situation.toward_rad)
    unit = situation.unit
    return FlightConstraints(
        unit,
        settings,
        situation.fire,
        situation.lights,
        hazard_of(situation.fire, unit.area.bounds, margins),
        unit.low_graph,
        unit.high_graph,
        situation.home_m,
    )


def drop_orders(
    situation: Situation, settings: BurnSection, area: BaseGeometry, line: IgnitionLine
) -> list[Floats]:
    """Places (n, 2) to drop at on a line, in order from each of its ends (lines 5 to 8), or none.

    The nearest next place is always the neighbour, since all lie on one line.
    """
    ends_m = extent_across(area, line)
    if ends_m is None:
        return []
    spacing_m = settings.drop_spacing_m
    near_m = settings.line_spacing_m / 2.0
    through_m = alignment_m(line, ends_m, situation.dropped_m, area, near_m)
    places = drop_points(line, ends_m, through_m, spacing_m)
    good = situation.unit.may_drop(places) & shapely.covers(area, shapely.points(places))
    places = places[good]
    if len(situation.dropped_m) and len(places):
        apart = places[:, None, :] - situation.dropped_m[None, :, :]
        nearest_m = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1)
        places = places[nearest_m >= min(spacing_m, settings.line_spacing_m) / 2.0]
    if not len(places):
        return []
    return [places[::-1], places]


def fastest_flight(trips: list[LineFlight]) -> LineFlight | None:
    """The fastest of the flights that drop enough, the first of equals; None if none drops.

    A flight to the line's end is better than one ended by spheres or battery.
    """
    max_drops = max((len(trip.drops) for trip in trips), default=0)
    if max_drops == 0:
        return None
    enough = [trip for trip in trips if len(trip.drops) >= MIN_DROPS_SHARE * max_drops]
    return min(enough, key=lambda trip: (trip.why_ended != "", trip.duration_s))


def _plan(
    trip: LineFlight, situation: Situation, line: IgnitionLine, rest: BaseGeometry, lines_cut: int
) -> LinePlan:
    begin_s = situation.at_s
    path = np.array(trip.route, np.float64)
    path[:, 3] -= begin_s
    drops = trip.drops - (0.0, 0.0, begin_s)
    left = situation.area if trip.why_ended else rest
    return LinePlan(
        begin_s=begin_s,
        path=path,
        drops=drops,
        skipped=trip.skipped,
        duration_s=trip.duration_s,
        min_time_margin_s=trip.min_margin_s,
        area_left=left,
        line=line,
        ended=trip.why_ended,
        climbs_first=trip.climbs_first,
        home_s=trip.home_s,
        spheres_left=situation.spheres - len(drops),
        lines_cut=lines_cut,
    )


def _safe_start(air: FlightConstraints, start: FlightPoint) -> bool:
    return air.margin_s((start, start)) >= air.settings.time_margin_s


def _refuse_too_fast(settings: BurnSection) -> None:
    min_spacing_m = settings.speed_m_s * 60.0 / settings.max_drops_per_min
    if settings.drop_spacing_m < min_spacing_m * (1.0 - 1e-9):
        raise MissionServiceError(
            f"burn: drop_spacing_m = {settings.drop_spacing_m:g} must be at least "
            f"{min_spacing_m:g} m at {settings.speed_m_s:g} m/s and "
            f"{settings.max_drops_per_min:g} drops a minute"
        )
