"""Accuracy of a formation flight: ``python -m benchmarks.formation_flight [journal]``.

Without a journal the benchmark flies ``virtual-agents`` in virtual time, with eight mock PX4 planes
and MAVLink frames. It compares the reported positions with the commanded orbits. It uses samples
from ``FROM_S`` on, of orbits that were commanded at least ``AGE_S`` earlier, because vehicles take
time to reach a new orbit.
"""

import json
import math
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from mission_service.commands import ChangeSpeed, Orbit, UploadMission
from mission_service.config.scenario import load_scenario, parse_scenario
from mission_service.events import CommandFinished, Telemetry, UploadFinished
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.simulation.sim import simulate

FROM_S = 600.0
AGE_S = 20.0
SAMPLE_US = 1_000_000


@dataclass(frozen=True)
class Sample:
    """Position of a vehicle on its orbit: distance as a fraction of the radius, and phase."""

    at_us: int
    vehicle: str
    share: float
    phase_rad: float


def samples_of(path: Path, from_s: float = FROM_S) -> tuple[list[Sample], Counter[str]]:
    """Return one sample a second of each vehicle, and counts of commands and uploads."""
    reader = SegmentReader(path)
    landscape = landscape_of(parse_scenario(reader.header["scenario"], path))
    circles: dict[str, tuple[int, float, float, float]] = {}
    sampled: dict[str, int] = {}
    found: list[Sample] = []
    counts: Counter[str] = Counter()
    at_us = 0
    for entry in reader:
        content = entry.content
        match content:
            case Orbit():
                x_m, y_m = landscape.xy_of_lat_lon(content.lat_deg, content.lon_deg)
                circles[content.vehicle] = (at_us, x_m, y_m, content.radius_m)
                counts["orbits"] += 1
            case ChangeSpeed():
                counts["speeds"] += 1
            case UploadMission():
                counts["uploads"] += 1
            case CommandFinished() if not content.accepted:
                counts["refused"] += 1
            case UploadFinished() if content.outcome != "accepted":
                counts["uploads not accepted"] += 1
            case Telemetry():
                at_us, name = content.at_us, content.vehicle
                due = at_us >= sampled.get(name, round(from_s * 1e6))
                if not due or name not in circles:
                    continue
                sampled[name] = at_us + SAMPLE_US
                ordered_us, x_m, y_m, radius_m = circles[name]
                counts["samples"] += 1
                if at_us - ordered_us >= AGE_S * 1e6:
                    at_x_m, at_y_m = landscape.xy_of_lat_lon(content.lat_deg, content.lon_deg)
                    share = math.dist((at_x_m, at_y_m), (x_m, y_m)) / abs(radius_m)
                    phase_rad = math.atan2(at_y_m - y_m, at_x_m - x_m)
                    found.append(Sample(at_us, name, share, phase_rad))
    return found, counts


def figures_of(path: Path, from_s: float = FROM_S) -> dict[str, Any]:
    """Return the statistics of the flight in a journal."""
    found, counts = samples_of(path, from_s)
    off_radius = np.array([abs(sample.share - 1.0) for sample in found])
    together: dict[int, list[float]] = {}
    for sample in found:
        together.setdefault(sample.at_us // SAMPLE_US, []).append(sample.phase_rad)
    off_phase = [
        abs((phase - mean + math.pi) % math.tau - math.pi)
        for phases in together.values()
        for mean in [math.atan2(np.sin(phases).mean(), np.cos(phases).mean())]
        for phase in phases
    ]
    off_deg = np.rad2deg(np.array(off_phase))
    return {
        "orbits": counts["orbits"],
        "speeds": counts["speeds"],
        "uploads": counts["uploads"],
        "refused": counts["refused"],
        "uploads_not_accepted": counts["uploads not accepted"],
        "samples": len(found),
        "on_circles_share": round(len(found) / max(counts["samples"], 1), 3),
        "radius_off_median": round(float(np.median(off_radius)), 4),
        "radius_off_95": round(float(np.percentile(off_radius, 95)), 4),
        "radius_off_most": round(float(off_radius.max()), 4),
        "radius_within_10_percent": round(float((off_radius <= 0.1).mean()), 4),
        "phase_off_median_deg": round(float(np.median(off_deg)), 1),
        "phase_off_95_deg": round(float(np.percentile(off_deg, 95)), 1),
        "phase_within_15_deg": round(float((off_deg <= 15.0).mean()), 4),
    }


def main() -> None:
    """Print the statistics of the given journal, or of a new flight."""
    if len(sys.argv) > 1:
        click.echo(json.dumps(figures_of(Path(sys.argv[1])), indent=2))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.jsonl"
        scenario = load_scenario("virtual-agents")
        began_s = time.process_time()  # CPU time of this process on one core
        record, _ = simulate(scenario, path, created="")
        took_s = time.process_time() - began_s
        figures = figures_of(path)
    figures["times_real_time"] = round(scenario.duration_s / took_s, 1)
    figures["closest_pair_m"] = None if record.closest is None else record.closest.distance_m
    click.echo(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
