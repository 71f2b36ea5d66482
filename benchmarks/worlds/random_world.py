"""Random worlds: terrain, wind, vehicles, closed volumes, other aircraft, troubles and orders."""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from benchmarks.worlds.ground import CENTRE, Place, Terrain, lat_lon_of, plane_m
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, load_scenario, parse_scenario
from mission_service.config.surveillance_section import Resolution
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import (
    Aborted,
    AirspaceClosed,
    AirspaceOpened,
    AnyOperatorEvent,
    OrderGiven,
)

START_S, FLIES_S = 3600.0, 330.0
ROWS, CELL_M = 150, 40.0
MAX_AWAY_M = 1900.0  # of volumes' centres from the fire
TRIES = 20
ORDERS = ("hold", "resume", "return", "land", "go-around", "start", "abort")
TroubleKind = Literal[
    "link lost",
    "link lost, returns",
    "link lost, holds",
    "failsafe: return",
    "failsafe: hold",
    "pilot holds",
    "reboot",
    "no fix",
    "refuses commands",
    "refuses uploads",
]
Random = np.random.Generator


@dataclass(frozen=True)
class Trouble:
    """A disturbance of a vehicle between two mission times."""

    kind: TroubleKind
    vehicle: str
    from_s: float
    until_s: float


@dataclass(frozen=True)
class Crossing:
    """Another aircraft on a straight track; it is at ``place_m`` at ``at_s``."""

    name: str
    at_s: float
    place_m: Place
    altitude_amsl_m: float
    east_m_s: float
    north_m_s: float
    climb_m_s: float


@dataclass(frozen=True)
class World:
    """One random world.

    ``over`` are the volumes that people close in front of a vehicle: for each name, the vehicle and
    the distance ahead of it in metres. The corners of these requests are around ``CENTRE``.
    """

    seed: int
    scenario: Scenario
    terrain: Terrain
    requests: tuple[AnyOperatorEvent, ...]
    troubles: tuple[Trouble, ...] = ()
    aircraft: tuple[Crossing, ...] = ()
    over: dict[str, tuple[str, float]] = field(default_factory=dict)


def world_of(seed: int) -> World:
    """Return the random world of a seed, which the service accepts."""
    for number in range(TRIES):
        random = np.random.default_rng((seed, number))
        try:
            world = _world(random, seed)
            Core(world.scenario, landscape_of(world.terrain))  # plans all landings
        except ScenarioError:  # such as a home without an approach that is clear of the hills
            continue
        return world
    raise ScenarioError(f"world {seed}: no valid world after {TRIES} attempts")


@lru_cache(maxsize=4)
def landscape_of(terrain: Terrain) -> Landscape:
    """Return the landscape of a terrain, on the service's grid."""
    flat = _flat()
    lat_deg, lon_deg = _grid()
    elevation_m = np.asarray(terrain.ground_m(*plane_m(lat_deg, lon_deg)), dtype=np.float32)
    return Landscape(flat.crs, flat.west_m, flat.north_m, CELL_M, flat.fuel_model, elevation_m)


@lru_cache(maxsize=1)
def _flat() -> Landscape:
    return flat_landscape(ROWS, ROWS, CELL_M, *CENTRE)


@lru_cache(maxsize=1)
def _grid() -> tuple[Any, Any]:
    rows, cols = np.meshgrid(np.arange(float(ROWS)), np.arange(float(ROWS)), indexing="ij")
    flat = _flat()
    lat_deg, lon_deg = flat.lat_lon_of(*flat.xy_of(rows, cols))
    return np.asarray(lat_deg), np.asarray(lon_deg)


@lru_cache(maxsize=1)
def _defaults() -> dict[str, Any]:
    return load_scenario("demo").model_dump()


def _world(random: Random, seed: int) -> World:
    terrain = _terrain(random)
    weather = {
        **_defaults()["weather"][0],
        "wind_speed_m_s": round(float(random.uniform(0.0, 8.0)), 1),
        "wind_from_deg": round(float(random.uniform(0.0, 360.0))),
    }
    vehicles = [_vehicle(random, number) for number in range(int(random.integers(1, 4)))]
    names = [vehicle["name"] for vehicle in vehicles]
    closed, requests = _airspace(random, terrain)
    airspace: dict[str, Any] = {"closed": closed, "margin_m": float(random.choice([30, 60, 100]))}
    if random.random() < 0.15:
        highest_agl_m = max(vehicle["altitude_agl_m"] for vehicle in vehicles)
        airspace["max_altitude_agl_m"] = highest_agl_m + float(random.uniform(50.0, 200.0))
    if random.random() < 0.2:
        corners = [
            lat_lon_of(2500.0 * math.cos(angle), 2500.0 * math.sin(angle))
            for angle in np.linspace(0.0, math.tau, 12, endpoint=False)
        ]
        airspace["allowed"] = [{"name": "operating area", "corners": corners}]
    data = {
        "name": f"world {seed}",
        "seed": seed,
        "start_s": START_S,
        "deploy_at_s": START_S,
        "duration_s": START_S + FLIES_S,
        "planner": {"rule": "islam_hu"},
        "weather": [weather],
        "ignition": [{"lat_deg": CENTRE[0], "lon_deg": CENTRE[1]}],
        "vehicles": vehicles,
        "airspace": airspace,
    }
    aircraft: tuple[Crossing, ...] = ()
    if random.random() < 0.5:
        resolution = str(random.choice(get_args(Resolution)))
        data["surveillance"] = {"resolution": resolution}
        aircraft = _aircraft(random, terrain)
    over: dict[str, tuple[str, float]] = {}
    for number in range(int(random.integers(0, 3))):
        volume = _volume(random, f"over {number}", terrain, amsl_only=True, at_m=(0.0, 0.0))
        requests += _closed_by_people(random, volume)
        over[volume["name"]] = (str(random.choice(names)), float(random.uniform(-100.0, 500.0)))
    requests += _orders(random, names)
    troubles = _troubles(random, names)
    requests += _rescues(random, troubles)
    scenario = parse_scenario(data, Path("world.toml"))
    in_order = tuple(sorted(requests, key=lambda event: event.at_us))
    return World(seed, scenario, terrain, in_order, troubles, aircraft, over)


def _terrain(random: Random) -> Terrain:
    """Return hills with slopes of at most about 40 %."""
    hills = []
    for _ in range(int(random.integers(0, 7))):
        width_m = float(random.uniform(150.0, 600.0))
        height_m = float(random.uniform(0.1, 0.6)) * width_m
        east_m, north_m = random.uniform(-2200.0, 2200.0, 2)
        hills.append((float(east_m), float(north_m), min(height_m, 200.0), width_m))
    slopes = random.uniform(-0.04, 0.04, 2)
    return Terrain(
        float(random.uniform(250.0, 600.0)), float(slopes[0]), float(slopes[1]), tuple(hills)
    )


def _vehicle(random: Random, number: int) -> dict[str, Any]:
    bearing, away_m = random.uniform(0.0, math.tau), random.uniform(300.0, 1300.0)
    lat_deg, lon_deg = lat_lon_of(away_m * math.sin(bearing), away_m * math.cos(bearing))
    return {
        "name": f"v{number}",
        "system_id": number + 1,
        "stack": str(random.choice(["px4", "ardupilot"])),
        "kind": str(random.choice(["plane", "plane", "copter"])),
        "link": f"udpin:127.0.0.1:{14600 + number}",
        "home_lat_deg": lat_deg,
        "home_lon_deg": lon_deg,
        "airspeed_m_s": float(random.uniform(12.0, 20.0)),
        "altitude_agl_m": 70.0 + 45.0 * number + float(random.uniform(0.0, 10.0)),
        "loiter_radius_m": float(random.choice([60.0, 90.0, 120.0])),
        "autostart": True,
    }


def _airspace(
    random: Random, terrain: Terrain
) -> tuple[list[dict[str, Any]], list[AnyOperatorEvent]]:
    """Return volumes of the scenario, and requests that close or open volumes."""
    volumes: list[dict[str, Any]] = []
    requests: list[AnyOperatorEvent] = []
    for number in range(int(random.integers(2, 6))):
        kind = random.choice(["always", "later", "operator"])
        volume = _volume(random, f"volume {number}", terrain, kind == "operator")
        if kind == "operator":
            requests += _closed_by_people(random, volume)
            continue
        closes_s = _closes_s(random)
        if kind == "later":
            volume["from_s"] = closes_s
        if random.random() < 0.3:
            volume["until_s"] = closes_s + float(random.uniform(50.0, 200.0))
        volumes.append(volume)
    return volumes, requests


def _closes_s(random: Random) -> float:
    return START_S + float(random.uniform(40.0, FLIES_S * 0.85))


def _closed_by_people(random: Random, volume: dict[str, Any]) -> list[AnyOperatorEvent]:
    """Return the request that closes a volume, and perhaps one that opens it."""
    closes_s = _closes_s(random)
    for_s = float(random.uniform(50.0, 300.0)) if random.random() < 0.5 else None
    found: list[AnyOperatorEvent] = [
        AirspaceClosed(
            *(round(closes_s * 1e6), "ann", "desk", volume["name"]),
            tuple(map(tuple, volume["corners"])),
            floor_amsl_m=volume.get("floor_amsl_m"),
            ceiling_amsl_m=volume.get("ceiling_amsl_m"),
            for_s=for_s,
        )
    ]
    if random.random() < 0.3:
        opens_us = round((closes_s + float(random.uniform(30.0, 150.0))) * 1e6)
        found.append(AirspaceOpened(opens_us, "ann", "desk", volume["name"]))
    return found


def _volume(
    random: Random, name: str, terrain: Terrain, amsl_only: bool, at_m: Place | None = None
) -> dict[str, Any]:
    """Return a polygon of 3 to 7 corners, near the fire or at a place; a third reach the ground."""
    away_m, bearing = random.uniform(100.0, MAX_AWAY_M), random.uniform(0.0, math.tau)
    east_m, north_m = at_m or (away_m * math.sin(bearing), away_m * math.cos(bearing))
    size_m = random.uniform(80.0, 600.0)
    angles = np.sort(random.uniform(0.0, math.tau, int(random.integers(3, 8))))
    corners = [
        lat_lon_of(east_m + size_m * math.sin(angle), north_m + size_m * math.cos(angle))
        for angle in angles
    ]
    found: dict[str, Any] = {"name": name, "corners": corners}
    agl = not amsl_only and random.random() < 0.5
    reference, ground_m = (
        ("agl", 0.0) if agl else ("amsl", float(terrain.ground_m(east_m, north_m)))
    )
    floor_m = float(random.uniform(30.0, 250.0))
    if random.random() < 0.4:
        found[f"floor_{reference}_m"] = ground_m + floor_m
    if random.random() < 0.4:
        found[f"ceiling_{reference}_m"] = ground_m + floor_m + float(random.uniform(40.0, 200.0))
    return found


def _orders(random: Random, names: list[str]) -> list[AnyOperatorEvent]:
    """Return orders of people at random times."""
    found: list[AnyOperatorEvent] = []
    for _ in range(int(random.integers(0, 2 * len(names) + 1))):
        at_us = round((START_S + float(random.uniform(60.0, FLIES_S))) * 1e6)
        order = str(random.choice(ORDERS))
        if order == "abort":
            found.append(Aborted(at_us, "ann", "desk"))
            name = ""
        else:
            name = str(random.choice(names)) if random.random() < 0.9 else ""
            found.append(_order(at_us, name, order, bool(random.random() < 0.3)))
        if order in ("hold", "abort") and random.random() < 0.8:
            later_us = at_us + round(float(random.uniform(20.0, 90.0)) * 1e6)
            found.append(_order(later_us, name, "resume", False))
        if order == "land" and random.random() < 0.4:
            later_us = at_us + round(float(random.uniform(20.0, 200.0)) * 1e6)
            found.append(_order(later_us, name, "go-around", False))
    return found


def _order(at_us: int, name: str, order: str, confirmed: bool) -> OrderGiven:
    return OrderGiven(at_us, "ann", "desk", name, order, confirmed)  # type: ignore[arg-type]


def _troubles(random: Random, names: list[str]) -> tuple[Trouble, ...]:
    found = []
    for _ in range(int(random.integers(0, 4))):
        from_s = START_S + float(random.uniform(30.0, FLIES_S))
        kind = random.choice(get_args(TroubleKind))
        until_s = from_s + float(random.uniform(5.0, 90.0))
        found.append(Trouble(kind, str(random.choice(names)), from_s, until_s))
    return tuple(found)


def _rescues(random: Random, troubles: tuple[Trouble, ...]) -> list[AnyOperatorEvent]:
    """Return the confirmed orders by which people take vehicles back after their troubles."""
    return [
        _order(
            round((trouble.until_s + float(random.uniform(2.0, 30.0))) * 1e6),
            trouble.vehicle,
            str(random.choice(["resume", "resume", "return", "hold"])),
            True,
        )
        for trouble in troubles
        if random.random() < 0.8
    ]


def _aircraft(random: Random, terrain: Terrain) -> tuple[Crossing, ...]:
    """Return other aircraft that cross the area low."""
    found = []
    for number in range(int(random.integers(1, 4))):
        course, speed_m_s = random.uniform(0.0, math.tau), random.uniform(20.0, 80.0)
        place_m = tuple(float(each) for each in random.uniform(-1000.0, 1000.0, 2))
        height_m = float(random.uniform(30.0, 250.0))
        found.append(
            Crossing(
                f"A0000{number}",
                START_S + float(random.uniform(60.0, FLIES_S)),
                (place_m[0], place_m[1]),
                float(terrain.ground_m(*place_m)) + height_m,
                float(speed_m_s * math.sin(course)),
                float(speed_m_s * math.cos(course)),
                float(random.choice([0.0, 0.0, -2.0, 3.0])),
            )
        )
    return tuple(found)
