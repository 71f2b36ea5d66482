"""Flights of vehicles that relieve each other, and measurements of the reliefs in a journal."""

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mission_service.commands import DirectionDecision, Return, ShowRelief, StartMission
from mission_service.config.scenario import Scenario, run_of, scenario_path
from mission_service.events import ModeChanged, OrderGiven, Telemetry
from mission_service.ground_distance import distance_m
from mission_service.journal.journal_file import SegmentReader

NAMES = ("hawk", "kite", "swift", "wren")
FROM_S = 3598.0


def relief_scenario(count: int = 3, *overrides: str, **relief: Any) -> Scenario:
    """Return PX4 planes of short endurance at one home that relieve each other near the fire."""
    path = scenario_path("team")
    data = tomllib.loads(path.read_text())
    plane = {key: value for key, value in data["vehicles"][0].items() if key != "autostart"}
    plane |= {"endurance_s": 800.0, "endurance_reserve_s": 60.0, "airspeed_m_s": 18.0}
    data["vehicles"] = [
        plane | {"name": name, "system_id": number + 1, "link": f"udpin:127.0.0.1:{14550 + number}"}
        for number, name in enumerate(NAMES[:count])
    ]
    data |= {"start_s": FROM_S, "duration_s": 7200.0, "planner": {"rule": "islam_hu_damped"}}
    data["relief"] = {"vehicles": list(NAMES[:count]), "overlap_s": 60.0, **relief}
    data["weather"][0]["wind_speed_m_s"] = 2
    return run_of(data, path, overrides)[0]


@dataclass
class Relief:
    """A relief as it was flown: where the task was left and where it was resumed."""

    left_by: str
    resumed_by: str
    at_s: float
    gap_s: float
    distance_m: float  # least distance of the next vehicle's track from the place
    directions: list[str] = field(default_factory=list)  # before and after


def reliefs_in(path: Path) -> list[Relief]:
    """Return the reliefs of a journal, measured from positions and commands alone.

    The task is left where the vehicle on task is when it is ordered home, or after its last
    position.
    """
    found: list[Relief] = []
    places: dict[str, tuple[float, float]] = {}
    present, left_at_s, at_s = "", 0.0, 0.0
    left: tuple[float, float] | None = None
    nearest: dict[str, float] = {}
    direction: dict[str, str] = {}
    awaiting: Relief | None = None
    for entry in SegmentReader(path):
        match entry.content:
            case Telemetry() as event:
                at_s, name = event.at_us / 1e6, event.vehicle
                places[name] = event.lat_deg, event.lon_deg
                if name == present:
                    left_at_s = at_s
                if left is not None:
                    away_m = distance_m(places[name], left)
                    nearest[name] = min(nearest.get(name, math.inf), away_m)
            case ShowRelief(role="leaves") as shown if shown.vehicle == present:
                left, present_before = places[present], present
                present, nearest = "", {}
                awaiting = Relief(present_before, "", at_s, 0.0, math.inf)
                awaiting.directions.append(direction.get(present_before, ""))
            case ShowRelief(role="on task") as shown if shown.vehicle != present:
                if awaiting is not None:
                    awaiting.resumed_by, awaiting.gap_s = shown.vehicle, at_s - left_at_s
                    awaiting.distance_m = nearest[shown.vehicle]
                    found.append(awaiting)
                    awaiting = None
                present, left = shown.vehicle, None
            case DirectionDecision() as decision:
                other = {"clockwise": "anticlockwise", "anticlockwise": "clockwise"}
                way: str = decision.direction
                if found and len(found[-1].directions) == 1:
                    # The direction before a turn back in the first decision.
                    first = other[way] if decision.reversed else way
                    found[-1].directions.append(first)
                direction[decision.vehicle] = way
            case _:
                pass
    return found


def _starts_in(path: Path) -> Iterator[tuple[float, str, bool]]:
    """Yield time and vehicle of each start on the ground, and whether an operator ordered it.

    An order counts until the vehicle is disarmed.
    """
    ordered, armed, at_us = dict.fromkeys(NAMES, False), dict.fromkeys(NAMES, False), 0
    for entry in SegmentReader(path):
        match entry.content:
            case OrderGiven(order="start" | "resume" | "takeoff") as event:
                ordered[event.vehicle] = True
            case ModeChanged() as event:
                if armed[event.vehicle] and not event.armed:
                    ordered[event.vehicle] = False
                armed[event.vehicle] = event.armed
            case StartMission(vehicle=name) if not armed[name]:
                yield at_us / 1e6, name, ordered[name]
            case Telemetry() as event:
                at_us = event.at_us
            case _:
                pass


def takeoffs_in(path: Path) -> list[tuple[float, str]]:
    """Return the times and vehicles of the starts that were ordered on the ground."""
    return [(at_s, name) for at_s, name, _ in _starts_in(path)]


def unsigned_takeoffs_in(path: Path) -> list[tuple[float, str]]:
    """Return the takeoffs without an operator's order since the vehicle was disarmed last."""
    return [(at_s, name) for at_s, name, ordered in _starts_in(path) if not ordered]


def returns_in(path: Path) -> list[str]:
    """Return the vehicles that were ordered home."""
    return [e.content.vehicle for e in SegmentReader(path) if isinstance(e.content, Return)]
