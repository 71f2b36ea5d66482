"""Compare ``predictive`` with circling on random fires, by the mean of the largest distance error.

python -m benchmarks.random_fires [FIRST] [COUNT] [--wrong]

With ``--wrong`` the planner receives another fuel in 30 % of the patches and a wind that is wrong
by 30 degrees and 3 m/s (``tests.service.wrong_models``). The errors of this model's forecast
without observations are printed, too.
"""

import argparse
import multiprocessing
from collections.abc import Sequence

import click
import numpy as np
from numpy.typing import NDArray

from firemodel.spread.schemes import SchemeName
from tests.service.random_fires import mean_max_errors
from tests.service.wrong_models import mean_max_errors_wrong

# The schemes of fires with even and with odd numbers.
SCHEMES: tuple[SchemeName, SchemeName] = ("devs8", "anyangle")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors and their ratios for each fire."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=50)
    parser.add_argument("--wrong", action="store_true", help="give the planner a wrong model")
    parser.add_argument("--processes", type=int)
    given = parser.parse_args(arguments)
    names = ("circling", "predictive", *(("model alone",) if given.wrong else ()))
    errors_of = mean_max_errors_wrong if given.wrong else mean_max_errors
    seeds = np.arange(given.first, given.first + given.count)
    every = []
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        for seed, found in zip(seeds, pool.imap(errors_of, seeds.tolist()), strict=True):
            every.append(found)
            shown = "  ".join(f"{n} {e:6.2f}" for n, e in zip(names, found, strict=True))
            click.echo(f"{seed:4d}  {shown}  {found[1] / found[0]:.2f}")
    errors = np.array(every)
    for odd, scheme in enumerate(SCHEMES):
        _show(scheme, seeds[seeds % 2 == odd], errors[seeds % 2 == odd])
    _show("all", seeds, errors)


def _show(kind: str, seeds: NDArray[np.int64], errors: NDArray[np.float64]) -> None:
    """Print the ratios of predictive's errors to the others (fires, columns) on a kind of fire."""
    if not seeds.size:
        return
    ratio = errors[:, 1] / errors[:, 0]
    line = f"{kind}, {seeds.size} fires: mean ratio {ratio.mean():.2f}, worst {ratio.max():.2f} "
    line += f"(fire {seeds[ratio.argmax()]})"
    if errors.shape[1] > 2:
        of_model = errors[:, 1] / errors[:, 2]
        line += f"; to the model alone {of_model.mean():.2f}, worst {of_model.max():.2f}"
    click.echo(line)


if __name__ == "__main__":
    main()
