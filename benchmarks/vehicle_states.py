"""Vehicles through refusals, losses, failsafes, orders and landings, at random; none may be harmed.

    python -m benchmarks.vehicle_states [STEPS] [SEED]

STEPS (default 100,000) of the state machine that ``make test`` runs for some thousand, beginning
with SEED (default: drawn). Tells how often each situation was met, and each kind of violation with
what led to it. The exit code is 1 if there was one.
"""

import random
import sys
import time
from collections import Counter

import click

from tests.service.vehicle_machine import VehicleMachine, run

EXAMPLES, STEPS_EACH = 100, 50


def main(steps: int, seed: int) -> int:
    """Run until there were so many steps; returns the exit code."""
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


def _show(words: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{words:<40}\r")
        sys.stderr.flush()


if __name__ == "__main__":
    told = [int(each) for each in sys.argv[1:]]
    sys.exit(main(*(told + [100_000, random.randrange(10**6)][len(told) :])))
