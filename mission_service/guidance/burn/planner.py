"""The next ignition line: algorithm 1 of Beachly et al. (section V), and what it leaves open.

- Burn complete is when nothing is left upwind of the next line. A line between the parts of an area
  in several is cut off as one without a safe drop is; more may be left upwind.
- The faster of the two paths is taken, but only among those that drop at least ``MOST`` of what the
  better one drops: a gap in a line costs more than a minute does.
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
from mission_service.guidance.burn.flight import Air, Lights, Place, Trip, fly
from mission_service.guidance.burn.hazard import hazard_of, margins_of
from mission_service.guidance.burn.lines import (
    Line,
    alignment_m,
    drop_points,
    line_across,
    stretch,
    upwind_of,
)
from mission_service.guidance.burn.unit import Unit

Floats = NDArray[np.float64]

MOST = 0.9  # of the drops of the path with more of them; the other may do with so many
ON_GROUND_M = 1.0
MOST_LINES = 10_000  # of one burn


@dataclass(frozen=True, eq=False)
class Situation:
    """What the next line is planned on, in the landscape's metres and seconds of mission time.

    ``area`` is what of the unit is still to be burned off; ``dropped_m`` (n, 2) are the drops of
    this burn so far. ``fire`` has all that burns or will by itself, spheres dropped before with it;
    ``lights`` gives the fire of some sources alone, as EllipseFire of the same spreads does.
    """

    unit: Unit
    area: BaseGeometry
    dropped_m: Floats
    fire: Simulation
    lights: Lights
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
    """A line to be dropped, all times after ``begin_s``.

    ``area_left`` is what of the area remains once all of it is dropped. ``climbs_first``: the
    vehicle is in danger where it starts, and the first climb is not safe (and counts in
    ``least_time_margin_s``, which is negative where it burns, infinite if no fire comes near).
    """

    begin_s: float
    path: Floats  # (n, 4) x, y, height_m, after_s; ends at the safe height, to hold there
    drops: Floats  # (m, 3) x, y, after_s
    skipped: Floats  # (k, 2): not safe to drop at
    duration_s: float
    least_time_margin_s: float
    area_left: BaseGeometry
    line: Line
    ended: Literal["", "spheres", "battery"]  # what ended it before the line was done
    climbs_first: bool
    home_s: float  # from its end to the ground at home, at the safe height
    spheres_left: int
    lines_cut: int  # off before it, since no drop was safe there


@dataclass(frozen=True, eq=False)
class NoPlan:
    """Why there is none. ``complete``: no line is left; ``lines_cut`` of them for no safe drop."""

    why: Literal["complete", "spheres", "battery", "danger", "outside"]
    words: str
    lines_cut: int = 0


def next_line(situation: Situation, settings: BurnSection) -> LinePlan | NoPlan:
    """The plan of the next line, checked against the fire it will itself light.

    Raises MissionServiceError if drops would come faster than may be, or the fire simulation gives
    no times.
    """
    _refuse_too_fast(settings)
    start = Place(situation.x_m, situation.y_m, situation.height_m, situation.at_s)
    air = air_of(situation, settings)
    if air.high is not None and not air.high.straight(start[:2], start[:2]):
        return NoPlan("outside", "the vehicle is outside the fence; bring it back")
    if situation.height_m < ON_GROUND_M and not _safe_start(air, start):
        return NoPlan("danger", "fire is too near the place where the vehicle stands")
    area, lines_cut = situation.area, 0
    for _ in range(MOST_LINES):
        if area.is_empty:
            break
        line = line_across(area, situation.toward_rad, settings.line_spacing_m)
        rest = upwind_of(area, line)
        if rest.is_empty:
            break
        trips = [
            fly(
                *(air, start, places, situation.spheres),
                situation.battery_s - settings.battery_reserve_s,
            )
            for places in orders(situation, settings, area, line)
        ]
        best = chosen(trips)
        if best is not None:
            return _plan(best, situation, line, rest, lines_cut)
        if any(trip.why_ended == "spheres" for trip in trips):
            return NoPlan("spheres", "no spheres are left; reload", lines_cut)
        if any(trip.why_ended == "battery" for trip in trips):
            return NoPlan("battery", "the battery suffices for no further drop; change it")
        area, lines_cut = rest, lines_cut + 1
    else:
        raise MissionServiceError(
            f"burn: more than {MOST_LINES} lines of {settings.line_spacing_m:g} m; make "
            "line_spacing_m larger"
        )
    cut = f"; on {lines_cut} more lines no drop is safe" if lines_cut else ""
    return NoPlan("complete", f"burn complete{cut}", lines_cut)


def air_of(situation: Situation, settings: BurnSection) -> Air:
    """What all flights of a situation are checked against."""
    margins = margins_of(settings, situation.wind_m_s, situation.toward_rad)
    unit = situation.unit
    return Air(
        unit,
        settings,
        situation.fire,
        situation.lights,
        hazard_of(situation.fire, unit.area.bounds, margins),
        unit.low_paths,
        unit.high_paths,
        situation.home_m,
    )


def orders(
    situation: Situation, settings: BurnSection, area: BaseGeometry, line: Line
) -> list[Floats]:
    """Places to drop at on a line, from each of its ends on (lines 5 to 8); none if none may be.

    The nearest next one is always the neighbour, since all lie on one line.
    """
    ends_m = stretch(area, line)
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


def chosen(trips: list[Trip]) -> Trip | None:
    """The fastest of those that drop enough; None if none drops anything. The first of equals.

    One that comes to the line's end is better than one ended by spheres or battery.
    """
    most = max((len(trip.drops) for trip in trips), default=0)
    if most == 0:
        return None
    enough = [trip for trip in trips if len(trip.drops) >= MOST * most]
    return min(enough, key=lambda trip: (trip.why_ended != "", trip.duration_s))


def _plan(
    trip: Trip, situation: Situation, line: Line, rest: BaseGeometry, lines_cut: int
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
        least_time_margin_s=trip.least_margin_s,
        area_left=left,
        line=line,
        ended=trip.why_ended,
        climbs_first=trip.climbs_first,
        home_s=trip.home_s,
        spheres_left=situation.spheres - len(drops),
        lines_cut=lines_cut,
    )


def _safe_start(air: Air, start: Place) -> bool:
    return air.margin_s((start, start)) >= air.settings.time_margin_s


def _refuse_too_fast(settings: BurnSection) -> None:
    least_m = settings.speed_m_s * 60.0 / settings.most_drops_per_min
    if settings.drop_spacing_m < least_m * (1.0 - 1e-9):
        raise MissionServiceError(
            f"burn: drop_spacing_m = {settings.drop_spacing_m:g} must be at least {least_m:g} m at "
            f"{settings.speed_m_s:g} m/s and {settings.most_drops_per_min:g} drops a minute"
        )
