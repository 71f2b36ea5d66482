"""Compare ``predictive`` with circling on random fires, by the mean of the largest distance error.

python -m benchmarks.random_fires [FIRST] [COUNT]
"""

import multiprocessing
import sys

import click
import numpy as np

from tests.service.random_fires import mean_max_errors


def main() -> None:
    """Print the errors and their ratio for each fire."""
    first = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 50
    ratios = []
    with multiprocessing.get_context("spawn").Pool() as pool:
        seeds = range(first, first + count)
        for seed, errors in zip(seeds, pool.imap(mean_max_errors, seeds), strict=True):
            circling, predictive = errors
            ratios.append(predictive / circling)
            click.echo(
                f"{seed:4d}  circling {circling:6.2f}  predictive {predictive:6.2f}  "
                f"{ratios[-1]:.2f}"
            )
    click.echo(
        f"{count} fires: mean ratio {np.mean(ratios):.2f}, worst {max(ratios):.2f} "
        f"(fire {first + int(np.argmax(ratios))})"
    )


if __name__ == "__main__":
    main()
