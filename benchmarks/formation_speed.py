"""How many times faster than real time a formation flies: ideal worlds, and `sim` with MAVLink.

    python -m benchmarks.formation_speed [--no-sim]

One core: CPU time of this process, kernels compiled before. Each flight is 20 minutes over the fire
of experiment 2_1.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click

from mission_service.experiments.virtual_agents.ideal_world import FormationWorld, Rules, fly
from mission_service.experiments.virtual_agents.scenarios import DURATION_S, EXPERIMENTS, burned
from mission_service.guidance.formation.settings import Settings

SEED = 1
SIM = "virtual-agents"


def ideal(uavs: int, duration_s: float = DURATION_S) -> None:
    """A flight without MAVLink."""
    (experiment,) = (one for one in EXPERIMENTS if one.name == "Exp2_1")
    arrival_s = burned(experiment.p_spread, experiment.first_cells, SEED)
    fly(FormationWorld(arrival_s, uavs, Settings(), Rules(duration_s=duration_s), SEED))


def simulated() -> float:
    """``sim virtual-agents``; returns how long a time it flew."""
    from mission_service.config.scenario import load_scenario
    from mission_service.simulation.sim import simulate

    scenario = load_scenario(SIM, ())
    with tempfile.TemporaryDirectory() as folder:
        simulate(scenario, Path(folder) / "journal.jsonl", "benchmark")
    return scenario.duration_s - scenario.start_s


def timed(work: Callable[[], object]) -> float:
    """CPU seconds."""
    began_s = time.process_time()
    work()
    return time.process_time() - began_s


def tell(text: str) -> None:
    """A line of the result."""
    click.echo(f"{text}")


def main() -> None:
    """Print a line each."""
    ideal(8, 120.0)  # compiles
    for uavs, wanted in ((8, 100), (16, None), (32, None), (64, 10)):
        ratio = DURATION_S / timed(lambda uavs=uavs: ideal(uavs))  # type: ignore[misc]
        aim = f" (wanted: {wanted})" if wanted else ""
        tell(f"{uavs:3} UAVs, no MAVLink: {ratio:6.0f} times real time{aim}")
    if "--no-sim" in sys.argv:
        return
    flown_s: list[float] = []
    cpu_s = timed(lambda: flown_s.append(simulated()))
    tell(f"  8 UAVs, MAVLink:    {flown_s[0] / cpu_s:6.0f} times real time (wanted: 20)")


if __name__ == "__main__":
    main()
