"""Inputs that limit the forecasts of an estimate: ``python -m benchmarks.estimate_bounds 700 705``.

The fires are those of ``estimate_twins``. At each time of that benchmark a single fire starts from
the true burned area and burns on with some of the true inputs. The remaining error shows which
input is worth estimating. An error is the area that differs from the true area after 30 or 60
minutes, divided by the true area.
"""

import argparse
from collections.abc import Sequence

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.estimate_twins import (
    AHEAD_S,
    EVALUATED_S,
    FUELS,
    HELD_FROM_S,
    HELD_HALF_DEG,
    UNBURNABLE,
    Inputs,
    Twin,
    continued,
    drawn,
    sector,
    twin,
)
from firemodel.arrays import Floats, Mask
from firemodel.physics.weather import WeatherStream

ALIKE = np.ones(len(FUELS))
Case = tuple[WeatherStream, NDArray[np.int16], Floats, bool]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of each fire, and their means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    given = parser.parse_args(arguments)
    every = []
    for seed in range(given.first, given.last + 1):
        every.append(errors(twin(seed)))
        click.echo(f"seed {seed}")
        _show(every[-1])
    click.echo("mean")
    _show({name: np.mean([each[name] for each in every], axis=0) for name in every[0]})


def _show(found: dict[str, Floats]) -> None:
    for name, (after_30, after_60) in found.items():
        click.echo(f"  {name:40} +30 min {after_30:.3f}  +60 min {after_60:.3f}")


def errors(truth: Twin) -> dict[str, Floats]:
    """Return the mean errors (after 30 and 60 min) of a fire for each set of true inputs."""
    cases = cases_of(drawn(truth.seeds))
    found = {"persistence": np.mean([_change(truth, at_s) for at_s in EVALUATED_S], axis=0)}
    for name, case in cases.items():
        found[name] = np.mean([_error(truth, at_s, case) for at_s in EVALUATED_S], axis=0)
    return found


def cases_of(inputs: Inputs) -> dict[str, Case]:
    """Return weather, fuels (y, x), rates by fuel and whether the held sector is given."""
    reported, actual = inputs.reported, inputs.actual
    believed, rates = inputs.believed, inputs.factors
    return {
        "nothing": (reported, believed, ALIKE, False),
        "held sector": (reported, believed, ALIKE, True),
        "weather": (actual, believed, ALIKE, False),
        "weather, rates": (actual, believed, rates, False),
        "weather, rates, held sector": (actual, believed, rates, True),
        "weather, rates, fuel map": (actual, inputs.true, rates, False),
        "fuel map, held sector": (reported, inputs.true, ALIKE, True),
        "weather, rates, fuel map, held sector": (actual, inputs.true, rates, True),
    }


def _change(truth: Twin, at_s: float) -> list[float]:
    return _differences(truth, truth.arrival_s <= at_s, truth.arrival_s <= at_s, at_s)


def _error(truth: Twin, at_s: float, case: Case) -> list[float]:
    weather, codes, rates, held_given = case
    arrival_s = truth.arrival_s
    if held_given:
        before = arrival_s <= HELD_FROM_S
        held = sector(before, drawn(truth.seeds).held_deg, HELD_HALF_DEG)
        codes = np.where(held & (arrival_s > at_s), UNBURNABLE, codes)
    fire = continued(arrival_s, at_s, weather, codes, rates)
    fire.advance(at_s + AHEAD_S[-1])
    after_30, after_60 = (fire.arrival_time_s <= at_s + ahead_s for ahead_s in AHEAD_S[1:])
    return _differences(truth, after_30, after_60, at_s)


def _differences(truth: Twin, after_30: Mask, after_60: Mask, at_s: float) -> list[float]:
    true = [truth.arrival_s <= at_s + ahead_s for ahead_s in AHEAD_S[1:]]
    pairs = zip((after_30, after_60), true, strict=True)
    return [np.count_nonzero(found ^ burned) / np.count_nonzero(burned) for found, burned in pairs]


if __name__ == "__main__":
    main()
