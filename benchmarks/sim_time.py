"""Where the time of the default simulation goes: ``python -m benchmarks.sim_time``.

Shares are of one run under cProfile; the real-time factor is of a run without it.
"""

import cProfile
import pstats
import sys
import tempfile
import time
from pathlib import Path

from mission_service.config.scenario import load_scenario
from mission_service.simulation.sim import simulate

PARTS = {
    "planner and core": "core.py:handle",
    "camera and fire": "engine.py:_look",
    "mock autopilot": "autopilot.py:handle_timer",
    "decoding and client": "client.py:receive_data",
    "journal": "journal.py:_write",
}


def fly(folder: str) -> float:
    """One run; seconds of the machine."""
    began = time.perf_counter()
    simulate(load_scenario("default"), Path(folder) / "journal.jsonl", created="")
    return time.perf_counter() - began


def main() -> None:
    """Print real-time factor and shares."""
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
    sys.stdout.write(
        f"{hours:g} h flown in {plain_s:.1f} s: {hours * 3600 / plain_s:.0f} x real time\n"
    )
    for part, function in PARTS.items():
        share = cumulative.get(function, 0.0) / stats.total_tt  # type: ignore[attr-defined]
        sys.stdout.write(f"{share:6.1%}  {part}\n")


if __name__ == "__main__":
    main()
