"""Random refusals, lost links, failsafes, orders and landings of a vehicle, with checks of safety.

    python -m benchmarks.vehicle_states [STEPS] [SEED]

The benchmark runs STEPS (default 100,000) steps of the state machine of ``make test``, from SEED
(default: random). It prints the number of visits to each state, and each kind of violation with the
events that led to it. The exit code is 1 if there is a violation.
"""

import random
import sys
import time
from collections import Counter

import click

from tests.service.vehicle_machine import VehicleMachine, run

EXAMPLES, STEPS_EACH = 100, 50


def main(steps: int, seed: int) -> int:
    """Run at least ``steps`` steps; return the exit code."""
    met: Counter[str] = Counter()
    stories: dict[str, str] = {}
    counting = {"met": met, "stories": stories}
    began_s = time.monotonic()
    first = seed
    while met["steps"] < steps:
        run(type("Counting", (VehicleMachine,), counting), EXAMPLES, STEPS_EACH, seed)
        seed += 1
        _show(f"{met['steps']:,} steps")
    _show("")
    for situation, count in sorted(met.items()):
        if not situation.startswith("violation: "):
            click.echo(f"{count:10,}  {situation}")
    for kind, story in stories.items():
        click.echo(f"\n{met[f'violation: {kind}']} times: {story}")
    violations = sum(count for kind, count in met.items() if kind.startswith("violation: "))
    click.echo(
        f"\n{met['steps']:,} steps, {met['events']:,} events from seed {first} in "
        f"{time.monotonic() - began_s:.0f} s: {violations} violations"
    )
    return 1 if violations else 0


def _show(text: str) -> None:
    if sys.stderr.isatty():
        click.echo(f"\r{text:<40}\r", nl=False, err=True)


if __name__ == "__main__":
    given = [int(argument) for argument in sys.argv[1:]]
    sys.exit(main(*(given + [100_000, random.randrange(10**6)][len(given) :])))
