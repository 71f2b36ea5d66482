"""Count reversals in the scenario islam-hu: ``python -m benchmarks.alpha_sweep [--json]``."""

import json
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import click

from mission_service.config.scenario import load_scenario
from mission_service.simulation.sim import simulate

ALPHAS = (0.0, 0.8, 1.0, 1.2, 1.5, 5.0)


def reversals(alpha: float) -> int:
    """Fly the scenario once in calm air and return the number of reversals."""
    scenario = load_scenario("islam-hu", (f"planner.alpha={alpha}", "fly_in_wind=false"))
    with tempfile.TemporaryDirectory() as folder:
        record, _ = simulate(scenario, Path(folder) / "journal.jsonl", created="")
    return sum(vehicle.reversal_count for vehicle in record.vehicles.values())


def main() -> None:
    """Print the number of reversals for each alpha."""
    with ProcessPoolExecutor(2) as pool:
        counts = list(pool.map(reversals, ALPHAS))
    if "--json" in sys.argv[1:]:
        click.echo(
            json.dumps([{"alpha": a, "reversals": n} for a, n in zip(ALPHAS, counts, strict=True)])
        )
        return
    click.echo("| α | " + " | ".join(f"{alpha:g}" for alpha in ALPHAS) + " |\n", nl=False)
    click.echo("|---" * (len(ALPHAS) + 1) + "|\n", nl=False)
    click.echo("| reversals | " + " | ".join(map(str, counts)) + " |\n", nl=False)


if __name__ == "__main__":
    main()
