"""Fly random worlds with closed airspace, and check each journal by independent code.

python -m benchmarks.airspace_worlds [FIRST] [COUNT] [--margin M]

Each world has one to three vehicles of random kinds around the demo's fire, two to five volumes
that are closed from the start, later, or by an operator in flight, some of which open again, and
operators' orders at random times. The checker reads only the journal. It uses neither the
service's geometry nor its libraries. A violation is:

- a position of a mission or an orbit inside a volume that is closed when the command is sent,
- a vehicle that enters a closed volume, if it was far enough away when the volume closed,
- a vehicle that stays in a closed volume longer than it needs to fly out.

The numbers without the guard are printed beside (``--without``: ``[airspace]`` is left out of the
scenario, and the operators close nothing, but the checker uses the same volumes).
"""

import argparse
import json
import math
import multiprocessing
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.events import AirspaceClosed, AirspaceOpened, AnyOperatorEvent, OrderGiven
from mission_service.simulation.sim import simulate

START_S, FLIES_S = 3600.0, 1200.0
FIRE = (36.364232, -84.140907)
HOMES = ((36.370784, -84.132309), (36.368, -84.13), (36.3694, -84.1311))
M_PER_DEG_LAT = 111_200.0
M_PER_DEG_LON = M_PER_DEG_LAT * math.cos(math.radians(FIRE[0]))
RULES = ("predictive", "islam_hu_damped", "informative", "team.balanced", "formation")
TURN_S = 45.0  # upload, start of the mission and half a turn
FREE_M = 350.0  # a vehicle farther from the volume when it closes has time to turn away


@dataclass(frozen=True)
class World:
    """One random world: the scenario, and the events of its operators by time."""

    scenario: Scenario
    requests: tuple[AnyOperatorEvent, ...]


def world_of(seed: int, margin_m: float = 60.0) -> World:
    """Return the random world of a seed."""
    random = np.random.default_rng(seed)
    rule = str(random.choice(RULES))
    count = int(random.integers(1, 4)) if rule.startswith(("team.", "formation")) else 1
    settings = [
        f'planner.rule="{rule}"',
        f"seed={seed}",
        f"duration_s={START_S + FLIES_S}",
        f"weather.0.wind_speed_m_s={random.uniform(1.0, 9.0):.1f}",
        f"weather.0.wind_from_deg={random.uniform(0.0, 360.0):.0f}",
        f"airspace.margin_m={margin_m:g}",
    ]
    scenario = load_scenario("demo", tuple(settings))
    kinds = ["plane"] if rule == "formation" else ["plane", "plane", "copter"]
    vehicles = [
        scenario.vehicles[0].model_copy(
            update={
                "name": f"v{number}",
                "system_id": number + 1,
                "stack": str(random.choice(["px4", "ardupilot"])),
                "kind": str(random.choice(kinds)),
                "airspeed_m_s": float(random.uniform(13.0, 20.0)),
                "altitude_agl_m": 120.0 + 45.0 * number,
                "link": f"udpin:127.0.0.1:{14600 + number}",
                "home_lat_deg": HOMES[number][0],
                "home_lon_deg": HOMES[number][1],
            }
        )
        for number in range(count)
    ]
    volumes: list[dict[str, Any]] = []
    requests: list[AnyOperatorEvent] = []
    for number in range(int(random.integers(2, 6))):
        volume = _volume(random, f"volume {number}")
        closes_s = float(random.uniform(60.0, FLIES_S * 0.8))
        kind = random.choice(["always", "later", "operator"])
        if kind == "operator":
            for_s = float(random.uniform(100.0, 900.0)) if random.random() < 0.5 else None
            corners = tuple(map(tuple, volume["corners"]))
            at_us = round((START_S + closes_s) * 1e6)
            requests.append(
                AirspaceClosed(
                    *(at_us, "ann", "desk", volume["name"], corners),
                    floor_amsl_m=volume.get("floor_amsl_m"),
                    ceiling_amsl_m=volume.get("ceiling_amsl_m"),
                    for_s=for_s,
                )
            )
            if random.random() < 0.3:
                opens_us = at_us + round(float(random.uniform(50.0, 300.0)) * 1e6)
                requests.append(AirspaceOpened(opens_us, "ann", "desk", volume["name"]))
            continue
        if kind == "later":
            volume["from_s"] = START_S + closes_s
        if random.random() < 0.3:
            volume["until_s"] = START_S + closes_s + float(random.uniform(100.0, 600.0))
        volumes.append(volume)
    for vehicle in vehicles:
        at_s = float(random.uniform(100.0, FLIES_S))
        order = str(random.choice(["hold", "return", "land", "none"]))
        if order != "none":
            requests.append(
                OrderGiven(round((START_S + at_s) * 1e6), "ann", "desk", vehicle.name, order)  # type: ignore[arg-type]
            )
        if order == "hold":
            later_us = round((START_S + at_s + 200.0) * 1e6)
            requests.append(OrderGiven(later_us, "ann", "desk", vehicle.name, "resume"))
    data = scenario.model_dump()
    data["airspace"]["closed"] = volumes
    data["vehicles"] = [vehicle.model_dump() for vehicle in vehicles]
    checked = type(scenario).model_validate(data)
    return World(checked, tuple(sorted(requests, key=lambda event: event.at_us)))


def _volume(random: np.random.Generator, name: str) -> dict[str, Any]:
    """Return a polygon of 3 to 7 corners near the fire; two thirds reach down to the ground."""
    away_m, bearing = random.uniform(150.0, 1800.0), random.uniform(0.0, math.tau)
    centre = (away_m * math.sin(bearing), away_m * math.cos(bearing))
    count, size_m = int(random.integers(3, 8)), random.uniform(100.0, 700.0)
    angles = np.sort(random.uniform(0.0, math.tau, count))
    corners = [
        (
            FIRE[0] + (centre[1] + size_m * math.cos(angle)) / M_PER_DEG_LAT,
            FIRE[1] + (centre[0] + size_m * math.sin(angle)) / M_PER_DEG_LON,
        )
        for angle in angles
    ]
    found: dict[str, Any] = {"name": name, "corners": corners}
    if random.random() < 0.33:
        found["floor_amsl_m"] = float(random.uniform(300.0, 700.0))
    if random.random() < 0.33:
        found["ceiling_amsl_m"] = found.get("floor_amsl_m", 400.0) + float(
            random.uniform(50.0, 500.0)
        )
    return found


# The checker, by its own geometry on a plane around the fire --------------------------------------


@dataclass
class Closed:
    """A volume with the times between which it is closed."""

    name: str
    corners_m: list[tuple[float, float]]
    floor_m: float
    ceiling_m: float
    from_s: float
    until_s: float

    def contains(self, x_m: float, y_m: float, altitude_m: float, within_m: float = 0.0) -> bool:
        """Return whether a position is inside by more than ``within_m``."""
        if not self.floor_m + within_m < altitude_m < self.ceiling_m - within_m:
            return False
        return _is_inside(self.corners_m, x_m, y_m) and self.edge_m(x_m, y_m) > within_m

    def edge_m(self, x_m: float, y_m: float) -> float:
        """Return the horizontal distance from the outline."""
        return min(
            _from_side_m(x_m, y_m, one, other)
            for one, other in zip(
                self.corners_m, [*self.corners_m[1:], self.corners_m[0]], strict=True
            )
        )


def _plane_m(lat_deg: float, lon_deg: float) -> tuple[float, float]:
    return (lon_deg - FIRE[1]) * M_PER_DEG_LON, (lat_deg - FIRE[0]) * M_PER_DEG_LAT


def _is_inside(corners: list[tuple[float, float]], x_m: float, y_m: float) -> bool:
    """Return whether a position is in a polygon: the number of sides to its east is odd."""
    inside = False
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (y1 > y_m) != (y2 > y_m) and x_m < x1 + (y_m - y1) * (x2 - x1) / (y2 - y1):
            inside = not inside
    return inside


def _from_side_m(
    x_m: float, y_m: float, one: tuple[float, float], other: tuple[float, float]
) -> float:
    along = (other[0] - one[0], other[1] - one[1])
    square = along[0] ** 2 + along[1] ** 2
    share = 0.0
    if square > 0.0:
        share = ((x_m - one[0]) * along[0] + (y_m - one[1]) * along[1]) / square
        share = min(max(share, 0.0), 1.0)
    return math.hypot(x_m - one[0] - share * along[0], y_m - one[1] - share * along[1])


def volumes_in(world: World) -> list[Closed]:
    """Return all volumes of a world with their times."""
    found = []
    for entry in world.scenario.airspace.closed:
        floor_m = -1e9 if entry.floor_amsl_m is None else entry.floor_amsl_m
        ceiling_m = 1e9 if entry.ceiling_amsl_m is None else entry.ceiling_amsl_m
        until_s = math.inf if entry.until_s is None else entry.until_s
        corners = [_plane_m(*corner) for corner in entry.corners or ()]
        found.append(Closed(entry.name, corners, floor_m, ceiling_m, entry.from_s, until_s))
    for event in world.requests:
        if isinstance(event, AirspaceClosed):
            at_s = event.at_us / 1e6
            floor_m = -1e9 if event.floor_amsl_m is None else event.floor_amsl_m
            ceiling_m = 1e9 if event.ceiling_amsl_m is None else event.ceiling_amsl_m
            until_s = math.inf if event.for_s is None else at_s + event.for_s
            corners = [_plane_m(*corner) for corner in event.corners]
            found.append(Closed(event.name, corners, floor_m, ceiling_m, at_s, until_s))
        elif isinstance(event, AirspaceOpened):
            for closed in found:
                if closed.name == event.name:
                    closed.until_s = min(closed.until_s, event.at_us / 1e6)
    return found


@dataclass
class Track:
    """What the checker keeps of one vehicle and one volume."""

    free: bool = True  # whether the vehicle has had the time to stay outside
    inside_since_s: float | None = None
    may_stay_s: float = 0.0
    seen: bool = False


def violations(world: World, lines: list[dict[str, Any]]) -> list[str]:
    """Return the violations in a journal, each in words."""
    closed = volumes_in(world)
    tracks: dict[tuple[str, str], Track] = {}
    speeds = {vehicle.name: vehicle.airspeed_m_s for vehicle in world.scenario.vehicles}
    wind_m_s = world.scenario.weather[0].wind_speed_m_s
    found = []
    at_s = 0.0
    for entry in lines:
        line = entry.get("event") or entry.get("command") or {}
        at_s = line.get("at_us", at_s * 1e6) / 1e6  # commands have the time of their event
        kind = line.get("type")
        if kind == "Telemetry" and line["altitude_relative_m"] > 15.0:
            for volume in closed:
                if not volume.from_s <= at_s < volume.until_s:
                    continue
                x_m, y_m = _plane_m(line["lat_deg"], line["lon_deg"])
                track = tracks.setdefault((line["vehicle"], volume.name), Track())
                slow_m_s = max(speeds[line["vehicle"]] - wind_m_s, 4.0)
                words = _moved(track, volume, (x_m, y_m, line["altitude_amsl_m"]), at_s, slow_m_s)
                if words:
                    found.append(f"{at_s:.0f} s: {line['vehicle']} {words}")
        elif kind == "UploadMission" and line["why"] != "leave closed airspace":
            found += _commanded(closed, line, at_s)
    return found


def _moved(
    track: Track, volume: Closed, position: tuple[float, float, float], at_s: float, slow_m_s: float
) -> str:
    """Update the track from a position; return a violation in words, or ""."""
    x_m, y_m, altitude_m = position
    inside = volume.contains(x_m, y_m, altitude_m, within_m=2.0)
    edge_m = volume.edge_m(x_m, y_m)
    if not track.seen:
        track.seen = True
        far = not _is_inside(volume.corners_m, x_m, y_m) and edge_m > FREE_M
        track.free = far or at_s > volume.from_s + TURN_S + FREE_M / slow_m_s
    elif not track.free and not inside and edge_m > FREE_M:
        track.free = True
    if not inside:
        if track.inside_since_s is not None:
            track.free, track.inside_since_s = False, None
        return ""
    if track.free:
        track.free = False
        track.inside_since_s, track.may_stay_s = at_s, 1e9
        return f"enters {volume.name}"
    if track.inside_since_s is None:
        track.inside_since_s = at_s
        # Straight out from anywhere: the widest extent of the polygon is the longest way.
        track.may_stay_s = TURN_S + 2.0 * (edge_m + 200.0) / slow_m_s
    if at_s - track.inside_since_s > track.may_stay_s:
        stayed_s, track.may_stay_s = track.may_stay_s, 1e9
        return f"stays in {volume.name} for more than {stayed_s:.0f} s"
    return ""


def _commanded(closed: list[Closed], line: dict[str, Any], at_s: float) -> list[str]:
    """Return the positions of a mission that are inside a closed volume, in words."""
    found = []
    for item in line["items"]:
        if item["command"] not in (16, 17):
            continue
        x_m, y_m = _plane_m(item["x"] / 1e7, item["y"] / 1e7)
        for volume in closed:
            if volume.from_s <= at_s < volume.until_s and volume.contains(
                x_m, y_m, item["z"], within_m=2.0
            ):
                found.append(f"{at_s:.0f} s: {line['vehicle']} commanded into {volume.name}")
        if item["command"] == 17:
            break
    return found[:1]


def fly(seed: int, margin_m: float, without: bool = False) -> tuple[int, list[str]]:
    """Fly a world and return its seed, the violations."""
    world = world_of(seed, margin_m)
    flown, requests = world.scenario, list(world.requests)
    if without:
        flown = flown.model_copy(update={"airspace": type(flown.airspace)()})
        requests = [event for event in requests if isinstance(event, OrderGiven)]

    def crew(now_us: int, core: Core) -> list[AnyOperatorEvent]:
        due = [event for event in requests if event.at_us <= now_us]
        del requests[: len(due)]
        return [msgspec.structs.replace(event, at_us=now_us) for event in due]

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.jsonl"
        simulate(flown, path, created="", crew=crew)
        lines = [json.loads(line) for line in path.read_text().splitlines()[1:]]
    return seed, violations(world, lines)


def main() -> None:
    """Print the violations of each world, and their number."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=10)
    parser.add_argument("--margin", type=float, default=60.0)
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--processes", type=int)
    given = parser.parse_args()
    worlds_with = 0
    seeds = range(given.first, given.first + given.count)
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        flights = partial(fly, margin_m=given.margin, without=given.without)
        for seed, found in pool.imap(flights, seeds):
            worlds_with += bool(found)
            click.echo(f"{seed}: {len(found)} violations")
            for words in found:
                click.echo(f"    {words}")
    click.echo(f"{given.count} worlds, {worlds_with} with violations")


if __name__ == "__main__":
    main()
