"""Measures uploads over one lossy link and over two, in virtual time.

Usage: python -m benchmarks.two_links [--runs N] [--items N]

Each run uploads a mission item by item to a mock with one or two telemetry ports. The loss is the
same in both directions of a link. Prints a table in Markdown: the share of accepted uploads and the
times of the accepted ones.
"""

import argparse
from statistics import median

import click

from autopilot_bridge.stacks.stacks import Stack, stack_named
from tests.bridge.helpers import SECOND, line_of, mock_of
from tests.bridge.two_links import RADIO, TwoLinks, lines

# For each row: the losses of the links, and after how many seconds the first link is cut.
ROWS: tuple[tuple[tuple[float, ...], float | None], ...] = (
    ((0.0,), None),
    ((0.2,), None),
    ((0.2, 0.2), None),
    ((0.5,), None),
    ((0.5, 0.5), None),
    ((0.5, 0.2), None),
    ((0.5, 0.0), None),
    ((0.2,), 1.0),
    ((0.2, 0.2), 1.0),
)
SETTLES_S = 15.0


def upload(
    stack: Stack, losses: tuple[float, ...], cut_s: float | None, items: int, seed: int
) -> float | None:
    """Upload a mission; return the time in seconds, or None if it was not accepted."""
    pairs = [lines(1000 * seed + 10 * link, loss) for link, loss in enumerate(losses)]
    air = TwoLinks(mock_of(stack), pairs)
    while air.client.stack is None:
        air.run_for(1.0)
    air.run_for(SETTLES_S)
    began_us = air.now_us
    transfer_id = air.client.upload(line_of(items), air.now_us, by_file=False)
    if cut_s is not None:
        air.run_for(cut_s)
        air.cut(RADIO)
    result = air.result_of(transfer_id, 3000.0)
    return (air.now_us - began_us) / SECOND if result.outcome == "accepted" else None


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--items", type=int, default=100)
    given = parser.parse_args()
    click.echo("| stack | loss of the links | first link cut | accepted | median | longest |")
    click.echo("|---|---|---|---|---|---|")
    for name in ("px4", "ardupilot"):
        stack = stack_named(name, "plane")
        for losses, cut_s in ROWS:
            times = [upload(stack, losses, cut_s, given.items, n) for n in range(given.runs)]
            done = [each for each in times if each is not None]
            words = " and ".join(f"{100 * loss:.0f} %" for loss in losses)
            cut = "no" if cut_s is None else f"after {cut_s:g} s"
            spread = f"{median(done):.1f} s | {max(done):.1f} s" if done else "– | –"
            click.echo(f"| {name} | {words} | {cut} | {len(done)} of {len(times)} | {spread} |")


if __name__ == "__main__":
    main()
