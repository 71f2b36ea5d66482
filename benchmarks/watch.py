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


class SectorAges:
    """The times for which the sectors of the front were unseen, from the observed windows.

    Sectors are ranges of bearings from the centre of the area observed as burned. Sectors without
    front, as of a small fire, count as seen.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.oldest_s = 0.0  # longest time for which a sector was unseen
        self._burned = np.zeros(shape, dtype=np.bool_)
        self._cells = 0  # number of burned cells for which centre and sectors were computed
        self._centre = (0.0, 0.0)
        self._has_front = np.zeros(SECTORS, dtype=np.bool_)
        self._seen_at_s = np.full(SECTORS, np.nan)

    def add(self, event: Observed) -> None:
        """Add a window."""
        at_s, cells = event.at_us / 1e6, states_in(event.cells)
        rows, cols = cells.shape
        burned = self._burned[event.row : event.row + rows, event.col : event.col + cols]
        burned |= cells == BURNED
        count = int(np.count_nonzero(self._burned))
        if count == 0:
            return
        if count > self._cells:
            places = np.nonzero(self._burned)
            self._centre, self._cells = (float(places[0].mean()), float(places[1].mean())), count
            self._has_front[:] = False
            self._has_front[self._sectors(*edge_of(self._burned, ~self._burned))] = True
        self._seen_at_s[~self._has_front] = at_s
        self.finish(at_s)  # before the sectors of this window count as seen
        row, col = edge_of(cells == BURNED, cells == UNBURNED)
        self._seen_at_s[self._sectors(row + event.row, col + event.col)] = at_s

    def finish(self, at_s: float) -> None:
        """Update the longest time at the end of the flight, or at any time."""
        if np.isfinite(self._seen_at_s).any():
            self.oldest_s = max(self.oldest_s, at_s - float(np.nanmin(self._seen_at_s)))

    def _sectors(self, rows: NDArray[np.int64], cols: NDArray[np.int64]) -> NDArray[np.int64]:
        bearing = np.arctan2(cols - self._centre[1], self._centre[0] - rows)
        return np.unique(np.floor(bearing / math.tau * SECTORS).astype(np.int64) % SECTORS)


def edge_of(
    burned: NDArray[np.bool_], others: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the burned cells with one of the other cells at a side."""
    beside = np.zeros_like(burned)
    beside[1:] |= others[:-1]
    beside[:-1] |= others[1:]
    beside[:, 1:] |= others[:, :-1]
    beside[:, :-1] |= others[:, 1:]
    rows, cols = np.nonzero(burned & beside)
    return rows, cols


def watched(path: Path, scenario: Scenario) -> Watch:
    """Return the figures of a journal."""
    landscape = landscape_of(scenario)
    row, col = landscape.row_col_of(*fire_position(scenario, landscape))
    centre = float(row), float(col)
    found, ages = Watch(reliefs_in(path)), SectorAges(landscape.shape)
    began_at_s: float | None = None
    at_s, swept, last = 0.0, 0.0, math.nan
    lap_began_s, present = 0.0, ""
    for entry in SegmentReader(path):
        match entry.content:
            case Observed() as event if event.vehicle == present:
                at_s = event.at_us / 1e6
                ages.add(event)
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
    ages.finish(at_s)
    found.oldest_s = ages.oldest_s
    return found


def digest_of(path: Path) -> str:
    """Return the digest of a journal after its first line."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        file.readline()
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def report(
    path: Path, scenario: Scenario, closest_m: float | None, max_gap_s: float = math.inf
) -> bool:
    """Print the figures of a watch; return whether all limits are kept.

    Args:
        path: The journal, in one segment.
        closest_m: Smallest distance of two vehicles in the air.
        max_gap_s: Limit of the time without a vehicle on task.
    """
    found = watched(path, scenario)
    worst_m = max((each.distance_m for each in found.reliefs), default=math.nan)
    gaps_s = sorted(each.gap_s for each in found.reliefs) or [math.nan]
    turned = sum(len(set(each.directions)) > 1 for each in found.reliefs)
    unsigned = unsigned_takeoffs_in(path)
    longest_s = max(found.intervals_s, default=math.nan)
    separation_m = scenario.mission.separation_m
    closest_m = math.inf if closest_m is None else closest_m
    lines = {
        "reliefs": f"{len(found.reliefs)}",
        "largest distance to resume": f"{worst_m:.0f} m (limit {MAX_RESUME_M:.0f} m)",
        "resumed in another direction": f"{turned}",
        "no vehicle on task": f"{gaps_s[len(gaps_s) // 2]:.0f} s, at most {gaps_s[-1]:.0f} s",
        "longest relief interval": f"{longest_s:.0f} s",
        "longest lap": f"{found.longest_lap_s:.0f} s",
        "longest time unseen, a sector": f"{found.oldest_s:.0f} s",
        "takeoffs without an order": f"{len(unsigned)}",
        "smallest distance": f"{closest_m:.0f} m (limit {separation_m:.0f} m)",
    }
    for name, figure in lines.items():
        click.echo(f"{name:30} {figure}")
    kept = worst_m <= MAX_RESUME_M and not unsigned and turned == 0
    kept &= closest_m >= separation_m and gaps_s[-1] <= max_gap_s
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
                closest = statistics.closest
                kept = report(path, scenario, None if closest is None else closest.distance_m)
    if not once:
        equal = len(set(digests)) == 1
        click.echo(f"{'second journal':30} {'equal' if equal else 'different'}")
        kept &= equal
    sys.exit(not kept)


if __name__ == "__main__":
    given = [each for each in sys.argv[1:] if each != "--once"]
    hours, seed = [*given, *("12", "1")[len(given) :]]
    main(float(hours), int(seed), "--once" in sys.argv)
