"""Twelve hours over one front in virtual time, by aircraft that relieve each other.

    python -m benchmarks.watch [HOURS] [SEED] [--once]

Four mock planes with batteries of 20 minutes and six spare batteries (charged within 45 minutes)
circle one front in turn, so that the planned age of a sector is a lap. A simulated person orders
the start of each vehicle whose battery has been replaced; without the order no vehicle takes off.
All figures are measured from the journal. Exit with 1 if a limit is exceeded: 50 m between the
places where a task was left and resumed, the separation of the scenario, takeoffs without an order,
a sector of the front unseen for longer than the longest relief interval and the longest lap. The
flight is repeated, unless ``--once`` is given: both journals must be equal after their first line.
"""

import hashlib
import math
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from firemodel.assimilation.observation import BURNED, UNBURNED
from mission_service.commands import ShowRelief
from mission_service.config.scenario import Scenario
from mission_service.core.core import Core
from mission_service.events import AnyOperatorEvent, Observed, OrderGiven, Telemetry
from mission_service.fire.observed_window import states_in
from mission_service.fire.scenario_fire import fire_position, landscape_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.simulation.sim import simulate
from tests.service.relief_flights import Relief, relief_scenario, reliefs_in, unsigned_takeoffs_in

SECTORS = 12  # of the front, seen from the place of the ignition
MAX_RESUME_M = 50.0
FULL_PCT = 99.0
SLOW_FIRE = (
    *("weather.0.wind_speed_m_s=2", "weather.0.dead_1h_pct=12", "weather.0.dead_10h_pct=13"),
    *("weather.0.dead_100h_pct=14", "weather.0.live_herb_pct=100", "weather.0.live_woody_pct=110"),
)


def scenario_of(hours: float, seed: int) -> Scenario:
    """Return the scenario of the watch, which begins an hour after the ignition."""
    scenario = relief_scenario(4, *SLOW_FIRE)
    vehicles = tuple(
        each.model_copy(update={"endurance_s": 1200.0, "endurance_reserve_s": 120.0})
        for each in scenario.vehicles
    )
    data = scenario.model_dump() | {
        "seed": seed,
        "planner": {"rule": "circling"},
        "duration_s": scenario.start_s + hours * 3600.0,
        "vehicles": [each.model_dump() for each in vehicles],
    }
    data["simulation"] = {
        "fire": {},
        "batteries": {"packs": 6, "charge_s": 2700.0, "swap_s": 180.0},
    }
    return Scenario.model_validate(data)


def sign_off(now_us: int, core: Core) -> list[AnyOperatorEvent]:
    """Order the start of each vehicle on the ground that has a full battery and no sign-off."""
    orders: list[AnyOperatorEvent] = []
    for name, vehicle in core.vehicles.items():
        availability, charge_pct = vehicle.availability, vehicle.battery.level_pct(now_us / 1e6)
        waits = vehicle.waits_for_operator and availability.online and not availability.armed
        if waits and charge_pct is not None and charge_pct >= FULL_PCT:
            orders.append(OrderGiven(now_us, "benchmark", "", name, "start"))
    return orders


@dataclass
class Watch:
    """The figures of a watch."""

    reliefs: list[Relief]
    oldest_s: float = 0.0  # longest time for which a sector of the front was unseen
    longest_lap_s: float = 0.0
    intervals_s: list[float] = field(default_factory=list)  # between reliefs


def sectors_seen(event: Observed, centre: tuple[float, float]) -> NDArray[np.int64]:
    """Return the sectors in which a window shows unburned cells beside burned cells."""
    cells = states_in(event.cells)
    burned, unburned = cells == BURNED, cells == UNBURNED
    beside = np.zeros_like(burned)
    beside[1:] |= unburned[:-1]
    beside[:-1] |= unburned[1:]
    beside[:, 1:] |= unburned[:, :-1]
    beside[:, :-1] |= unburned[:, 1:]
    rows, cols = np.nonzero(burned & beside)
    bearing = np.arctan2(event.col + cols - centre[1], centre[0] - event.row - rows)
    return np.unique(np.floor(bearing / math.tau * SECTORS).astype(np.int64) % SECTORS)


def watched(path: Path, scenario: Scenario) -> Watch:
    """Return the figures of a journal."""
    landscape = landscape_of(scenario)
    row, col = landscape.row_col_of(*fire_position(scenario, landscape))
    centre = float(row), float(col)
    found = Watch(reliefs_in(path))
    seen_at_s = np.full(SECTORS, np.nan)
    began_at_s: float | None = None
    at_s, swept, last = 0.0, 0.0, math.nan
    lap_began_s, present = 0.0, ""
    for entry in SegmentReader(path):
        match entry.content:
            case Observed() as event if event.vehicle == present:
                at_s = event.at_us / 1e6
                sectors = sectors_seen(event, centre)
                ages = at_s - seen_at_s[sectors]
                if np.isfinite(ages).any():
                    found.oldest_s = max(found.oldest_s, float(np.nanmax(ages)))
                seen_at_s[sectors] = at_s
            case ShowRelief(role="on task") as shown if shown.vehicle != present:
                if began_at_s is not None:
                    found.intervals_s.append(at_s - began_at_s)
                began_at_s, present, swept, last = at_s, shown.vehicle, 0.0, math.nan
                lap_began_s = at_s
            case Telemetry() as event:
                at_s = event.at_us / 1e6
                if event.vehicle != present:
                    continue
                x_m, y_m = landscape.xy_of_lat_lon(event.lat_deg, event.lon_deg)
                own = landscape.row_col_of(x_m, y_m)
                bearing = math.atan2(float(own[1]) - centre[1], centre[0] - float(own[0]))
                if not math.isnan(last):
                    swept += (bearing - last + math.pi) % math.tau - math.pi
                last = bearing
                if abs(swept) >= math.tau:
                    found.longest_lap_s = max(found.longest_lap_s, at_s - lap_began_s)
                    swept, lap_began_s = 0.0, at_s
            case _:
                pass
    unseen = at_s - seen_at_s
    found.oldest_s = max(found.oldest_s, float(np.nanmax(unseen)))
    return found


def digest_of(path: Path) -> str:
    """Return the digest of a journal after its first line."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        file.readline()
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def report(path: Path, scenario: Scenario, statistics: RunStatistics) -> bool:
    """Print the figures of a watch; return whether all limits are kept."""
    found = watched(path, scenario)
    worst_m = max((each.distance_m for each in found.reliefs), default=math.nan)
    gaps_s = sorted(each.gap_s for each in found.reliefs) or [math.nan]
    turned = sum(len(set(each.directions)) > 1 for each in found.reliefs)
    unsigned = unsigned_takeoffs_in(path)
    longest_s = max(found.intervals_s, default=math.nan)
    separation_m = scenario.mission.separation_m
    closest_m = math.inf if statistics.closest is None else statistics.closest.distance_m
    lines = {
        "reliefs": f"{len(found.reliefs)}",
        "largest distance to resume": f"{worst_m:.0f} m (limit {MAX_RESUME_M:.0f} m)",
        "resumed in another direction": f"{turned}",
        "no vehicle on task": f"{gaps_s[len(gaps_s) // 2]:.0f} s, at most {gaps_s[-1]:.0f} s",
        "longest relief interval": f"{longest_s:.0f} s",
        "longest lap": f"{found.longest_lap_s:.0f} s",
        "longest time unseen, a sector": f"{found.oldest_s:.0f} s",
        "takeoffs without an order": f"{len(unsigned)}",
        "closest pair": f"{closest_m:.0f} m (limit {separation_m:.0f} m)",
    }
    for name, figure in lines.items():
        click.echo(f"{name:30} {figure}")
    kept = worst_m <= MAX_RESUME_M and not unsigned and turned == 0
    kept &= closest_m >= separation_m
    return kept and found.oldest_s <= longest_s + found.longest_lap_s


def main(hours: float, seed: int, once: bool) -> None:
    """Fly the watch, and again; print its figures."""
    scenario = scenario_of(hours, seed)
    digests = []
    with tempfile.TemporaryDirectory() as folder:
        kept = True
        for number in range(1 if once else 2):
            path = Path(folder) / f"{number}.jsonl"
            statistics, _ = simulate(scenario, path, "", crew=sign_off)
            digests.append(digest_of(path))
            if number == 0:
                kept = report(path, scenario, statistics)
    if not once:
        equal = len(set(digests)) == 1
        click.echo(f"{'second journal':30} {'equal' if equal else 'different'}")
        kept &= equal
    sys.exit(not kept)


if __name__ == "__main__":
    given = [each for each in sys.argv[1:] if each != "--once"]
    hours, seed = [*given, *("12", "1")[len(given) :]]
    main(float(hours), int(seed), "--once" in sys.argv)
