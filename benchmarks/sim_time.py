"""Processor time of the default simulation by part, and of the start of the command line.

    python -m benchmarks.sim_time

The shares are from one run under cProfile, the real-time factor from a run without it. The limits
of CPU time are 30 s for the simulation, 1 s for ``config check`` and 0.2 s for ``--help``.
"""

import cProfile
import pstats
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click

from mission_service.config.scenario import load_scenario
from mission_service.simulation.sim import simulate

PARTS = {
    "planner and core": "core.py:handle",
    "estimate": "run_estimate.py:advance",
    "camera and simulated fire": "simulated_cameras.py:observe",
    "mock autopilot": "sim.py:_advance_mock",
    "decoding and client": "native.py:receive_data",
    "state view": "state_view.py:apply",
    "journal": "guarded_journal.py:write_event",
}


def fly(folder: str) -> float:
    """Run the default simulation once; return its CPU time in s."""
    began = time.process_time()
    simulate(load_scenario("default"), Path(folder) / "journal.jsonl", created="")
    return time.process_time() - began


def started(*arguments: str) -> float:
    """Return the CPU time of a command in s, with warm caches."""
    command = (sys.executable, "-m", "mission_service.cli", *arguments)
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print start-up times, real-time factor and shares."""
    for arguments in (("--help",), ("config", "check", "default")):
        click.echo(f"{' '.join(arguments)}: {started(*arguments):.2f} s of CPU")
    with tempfile.TemporaryDirectory() as folder:
        plain_s = fly(folder)
        profile = cProfile.Profile()
        profile.runcall(fly, folder)
    stats = pstats.Stats(profile)
    cumulative = {
        f"{Path(file).name}:{name}": entry[3]
        for (file, _, name), entry in stats.stats.items()  # type: ignore[attr-defined]
    }
    hours = load_scenario("default").duration_s / 3600.0
    click.echo(
        f"{hours:g} h simulated in {plain_s:.1f} s of CPU: {hours * 3600 / plain_s:.0f} x real time"
    )
    for part, function in PARTS.items():
        share = cumulative[function] / stats.total_tt  # type: ignore[attr-defined]
        click.echo(f"{share:6.1%}  {part}")


if __name__ == "__main__":
    main()
