"""Complete random worlds: the fire of the demo, planners, MAVLink and mock autopilots."""

import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from pyproj import Transformer

from benchmarks.worlds.ground import Terrain, lat_lon_of
from benchmarks.worlds.random_world import World
from benchmarks.worlds.rules import Line
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import AirspaceClosed, AirspaceOpened, AnyOperatorEvent, OrderGiven
from mission_service.fire.scenario_fire import landscape_of
from mission_service.simulation.sim import simulate

START_S, FLIES_S = 3600.0, 1200.0
HOMES = ((36.370784, -84.132309), (36.368, -84.13), (36.3694, -84.1311))
RULES = ("predictive", "islam_hu_damped", "informative", "team.balanced", "formation")


class GridTerrain(Terrain):
    """The ground of a grid, for the checker."""

    def __init__(self, landscape: Landscape) -> None:
        super().__init__(0.0)
        # The dataclass is frozen.
        object.__setattr__(self, "_to_grid", Transformer.from_crs(4326, landscape.crs))
        object.__setattr__(self, "_grid", landscape)

    def ground_m(self, east_m: Any, north_m: Any) -> Any:
        """Return the ground between the four cells around a position."""
        grid: Landscape = self._grid  # type: ignore[attr-defined]
        x_m, y_m = self._to_grid.transform(*lat_lon_of(east_m, north_m))  # type: ignore[attr-defined]
        elevation_m = np.asarray(grid.elevation_m)
        row = np.clip(
            (grid.north_m - y_m) / grid.cell_size_m - 0.5, 0, elevation_m.shape[0] - 1.001
        )
        col = np.clip((x_m - grid.west_m) / grid.cell_size_m - 0.5, 0, elevation_m.shape[1] - 1.001)
        top, left = np.asarray(row).astype(int), np.asarray(col).astype(int)
        down, right = row - top, col - left
        upper = elevation_m[top, left] * (1 - right) + elevation_m[top, left + 1] * right
        lower = elevation_m[top + 1, left] * (1 - right) + elevation_m[top + 1, left + 1] * right
        return upper * (1 - down) + lower * down


def complete_world_of(seed: int) -> World:
    """Return the random complete world of a seed."""
    random = np.random.default_rng(seed)
    rule = str(random.choice(RULES))
    count = int(random.integers(1, 4)) if rule.startswith(("team.", "formation")) else 1
    settings = [
        f'planner.rule="{rule}"',
        f"seed={seed}",
        f"duration_s={START_S + FLIES_S}",
        f"weather.0.wind_speed_m_s={random.uniform(1.0, 9.0):.1f}",
        f"weather.0.wind_from_deg={random.uniform(0.0, 360.0):.0f}",
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
    in_order = tuple(sorted(requests, key=lambda event: event.at_us))
    return World(seed, checked, GridTerrain(landscape_of(checked)), in_order)


def _volume(random: np.random.Generator, name: str) -> dict[str, Any]:
    """Return a polygon of 3 to 7 corners near the fire; two thirds reach down to the ground."""
    away_m, bearing = random.uniform(150.0, 1800.0), random.uniform(0.0, math.tau)
    centre = (away_m * math.sin(bearing), away_m * math.cos(bearing))
    count, size_m = int(random.integers(3, 8)), random.uniform(100.0, 700.0)
    angles = np.sort(random.uniform(0.0, math.tau, count))
    corners = [
        lat_lon_of(centre[0] + size_m * math.sin(angle), centre[1] + size_m * math.cos(angle))
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


def complete_flight_of(world: World, without: bool = False) -> Iterator[Line]:
    """Fly a complete world and yield the lines of its journal.

    If ``without``, the flight has no closed airspace.
    """
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
        yield from (json.loads(line) for line in path.read_text().splitlines()[1:])
