"""Real-time factor of formations, in the ideal simulation and in `sim` with MAVLink.

    python -m benchmarks.formation_speed [--no-sim]

The factor is the simulated time divided by the CPU time of this process, without the compilation of
kernels. Each flight takes 20 minutes over the fire of experiment 2_1.
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
    """Fly a formation without MAVLink."""
    (experiment,) = (one for one in EXPERIMENTS if one.name == "Exp2_1")
    arrival_s = burned(experiment.p_spread, experiment.first_cells, SEED)
    fly(FormationWorld(arrival_s, uavs, Settings(), Rules(duration_s=duration_s), SEED))


def simulated() -> float:
    """Run ``sim virtual-agents``; return the simulated time in s."""
    from mission_service.config.scenario import load_scenario
    from mission_service.simulation.sim import simulate

    scenario = load_scenario(SIM, ())
    with tempfile.TemporaryDirectory() as folder:
        simulate(scenario, Path(folder) / "journal.jsonl", "benchmark")
    return scenario.duration_s - scenario.start_s


def timed(work: Callable[[], object]) -> float:
    """Return the CPU time of a function call in s."""
    began_s = time.process_time()
    work()
    return time.process_time() - began_s


def main() -> None:
    """Print the real-time factor of each flight."""
    ideal(8, 120.0)  # compiles the kernels
    for uavs, limit in ((8, 100), (16, None), (32, None), (64, 10)):
        ratio = DURATION_S / timed(lambda uavs=uavs: ideal(uavs))  # type: ignore[misc]
        note = f" (limit: {limit})" if limit else ""
        click.echo(f"{uavs:3} UAVs, no MAVLink: {ratio:6.0f} times real time{note}")
    if "--no-sim" in sys.argv:
        return
    flown_s: list[float] = []
    cpu_s = timed(lambda: flown_s.append(simulated()))
    click.echo(f"  8 UAVs, MAVLink:    {flown_s[0] / cpu_s:6.0f} times real time (limit: 20)")


if __name__ == "__main__":
    main()
