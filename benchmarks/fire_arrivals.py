"""Times of the fire's arrival at people, against simulated fires: ``benchmarks.fire_arrivals A B``.

The true fires (seeds A to B) and the camera are those of ``estimate_twins``. At each time of
evaluation, 60 people stand at random places up to 1 km ahead of the true front. For each, the
estimate forecasts the times before which the fire arrives with a probability of 10, 50 and 90 %.
The true fire is simulated until 4 h. The output contains the shares of people that the true fire
reaches before these times (ideally 10, 50, 90 %), the median error of the 50 % time of people that
the true fire and the forecast reach, the same error of the model without observations, and the
share of these people that have an alarm 30 minutes or more before the fire arrives (of those for
whom the fire arrives at least 30 minutes after the forecast).
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import click
import numpy as np
from scipy.ndimage import distance_transform_edt

from benchmarks.estimate_twins import (
    CELL_M,
    HOUR_S,
    Twin,
    model_alone,
    observed,
    seeds_parser,
    twin,
)
from firemodel.arrays import Floats
from firemodel.assimilation.fire_estimate import FireEstimate
from mission_service.fire.forecast import ARRIVAL_STEPS_S
from mission_service.fire_arrival.arrival_times import SHARES

TRUE_UNTIL_S = 4.0 * HOUR_S
PEOPLE, FAR_M = 60, 1000.0
WARNED_S, LIMIT_S = 1800.0, 3600.0  # wanted time before the arrival, limit of an alarm


class Arrival(NamedTuple):
    """Times after a forecast, in s; infinity for no arrival until ``TRUE_UNTIL_S``."""

    true_s: Floats  # (n)
    forecast_s: Floats  # (3, n)
    model_s: Floats  # (n)


def arrivals(
    truth: Twin,
    estimate: FireEstimate,
    model_s: Floats,
    rng: np.random.Generator,
    workers: ThreadPoolExecutor,
) -> Arrival:
    """Return the arrivals at random people ahead of the front."""
    now_s = estimate.time_s
    ahead_m = CELL_M * distance_transform_edt(truth.arrival_s > now_s)
    near = np.flatnonzero((ahead_m > 0.0) & (ahead_m <= FAR_M))
    cells = rng.choice(near, PEOPLE, replace=False)
    forecast = estimate.forecast(TRUE_UNTIL_S, workers.map)
    steps_s = [now_s + each for each in ARRIVAL_STEPS_S if now_s + each <= TRUE_UNTIL_S]
    places = forecast.at_places([np.array([cell]) for cell in cells])
    times_s = places.arrival_quantiles_s(SHARES, steps_s)[:, 0]
    found = [truth.arrival_s.flat[cells], times_s, model_s.flat[cells]]
    true_s, forecast_s, alone_s = (np.where(each > TRUE_UNTIL_S, np.inf, each) for each in found)
    return Arrival(true_s - now_s, forecast_s - now_s, alone_s - now_s)


def line(name: str, found: Arrival) -> str:
    """Return the scores of people as a line."""
    # If neither time is before the end, their order is unknown.
    known = np.isfinite(found.true_s) | np.isfinite(found.forecast_s)
    reached = [
        float(np.mean((found.true_s <= each)[is_known]))
        for each, is_known in zip(found.forecast_s, known, strict=True)
    ]
    both = np.isfinite(found.true_s) & np.isfinite(found.forecast_s[1]) & np.isfinite(found.model_s)
    error_min, alone_min = (
        float(np.median(np.abs(each[both] - found.true_s[both]))) / 60.0
        for each in (found.forecast_s[1], found.model_s)
    )
    late = np.isfinite(found.true_s) & (found.true_s >= WARNED_S)
    # If the forecast does not change, the alarm begins when the 10 % time is within the limit.
    alarm_s = np.where(np.isfinite(found.forecast_s[0]), found.forecast_s[0] - LIMIT_S, np.inf)
    warned = np.mean((found.true_s >= alarm_s + WARNED_S)[late])
    shares = "/".join(f"{each:.2f}" for each in reached)
    return (
        f"{name:>5}  before 10/50/90 %: {shares}; error {error_min:5.1f} min, model alone "
        f"{alone_min:5.1f} min; warned {warned:.2f} of {np.count_nonzero(late)}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the scores of each seed, and of all together."""
    given = seeds_parser(__doc__, 40).parse_args(arguments)
    every = []
    with ThreadPoolExecutor(given.threads) as pool:
        for seed in range(given.first, given.last + 1):
            truth = twin(seed)
            model_s = model_alone(truth, TRUE_UNTIL_S).expected_s()
            rng = np.random.default_rng((55, seed))
            found = [
                arrivals(truth, estimate, model_s, rng, pool)
                for estimate, _ in observed(truth, seed, given.members, pool)
            ]
            every.append(joined(found))
            click.echo(line(str(seed), every[-1]))
    click.echo(line("all", joined(every)))


def joined(found: Sequence[Arrival]) -> Arrival:
    """Return several arrivals as one."""
    return Arrival(*(np.concatenate(each, axis=-1) for each in zip(*found, strict=True)))


if __name__ == "__main__":
    main()
