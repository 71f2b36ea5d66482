"""Fly random worlds with closed airspace, and check each flight by independent code.

    python -m benchmarks.airspace_worlds [FIRST] [COUNT] [--processes N] [--faults | --complete]

A light world (the default; less than a second) flies the core alone, with vehicles that move like
the mock autopilots but without MAVLink: hills, wind, one to three planes and copters of both
stacks, volumes that close and open (limits above sea level or ground), other aircraft with each
resolution, lost links, failsafes, refusals, reboots, and orders of people. A complete world
(``--complete``; half a minute) flies the demo's fire with the service's planners, MAVLink and mock
autopilots.

The checker (``worlds/checker.py``) reads only the lines of the journal. Its code shares nothing
with the service. With ``--faults``, faults are injected into the core, and a table shows in how
many of the worlds the checker finds each of them. The exit code is 1 if a flight without an
injected fault has a violation.
"""

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterable
from functools import partial

import click

from benchmarks.worlds.checker import Checker
from benchmarks.worlds.light_flight import SOUND, Fault, flight_of
from benchmarks.worlds.planted_faults import FAULTS
from benchmarks.worlds.random_world import World, world_of
from benchmarks.worlds.rules import Line, rules_of

Result = tuple[int, list[str], float]  # seed, violations, processor time in seconds


def violations(world: World, lines: Iterable[Line]) -> list[str]:
    """Return the violations in the lines of a flight, each in words."""
    checker = Checker(rules_of(world.scenario.model_dump(), world.terrain))
    return [words for line in lines for words in checker.receive(line)]


def fly(seed: int, fault: str = SOUND.name) -> Result:
    """Fly the light world of a seed, with the injected fault of that name."""
    began_s = time.process_time()
    planted: Fault = next((each for each in FAULTS if each.name == fault), SOUND)
    world = world_of(seed)
    return seed, violations(world, flight_of(world, planted)), time.process_time() - began_s


def fly_complete(seed: int) -> Result:
    """Fly the complete world of a seed."""
    from benchmarks.worlds.complete import complete_flight_of, complete_world_of

    began_s = time.process_time()
    world = complete_world_of(seed)
    return seed, violations(world, complete_flight_of(world)), time.process_time() - began_s


def main() -> int:
    """Print the violations of each world and their number; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=10)
    parser.add_argument("--processes", type=int)
    parser.add_argument("--faults", action="store_true")
    parser.add_argument("--complete", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.count)
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        if given.faults:
            for fault in (SOUND, *FAULTS):
                results = pool.imap_unordered(partial(fly, fault=fault.name), seeds)
                found = sum(bool(words) for _, words, _ in results)
                click.echo(f"{fault.name:<32} found in {found} of {given.count} worlds")
            return 0
        return _report(pool.imap(fly_complete if given.complete else fly, seeds), given.count)


def _report(results: Iterable[Result], count: int) -> int:
    with_violations, took_s = 0, 0.0
    for seed, found, seconds in results:
        with_violations += bool(found)
        took_s += seconds
        for words in found:
            click.echo(f"{seed}: {words}")
    click.echo(
        f"{count} worlds, {with_violations} with violations; {took_s / count:.2f} s of processor "
        "time a world"
    )
    return 1 if with_violations else 0


if __name__ == "__main__":
    sys.exit(main())
