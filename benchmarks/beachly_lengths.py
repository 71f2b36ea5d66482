"""Error of Beachly's corrections by kernel length: ``python -m benchmarks.beachly_lengths``.

The random fires differ from those of the reported experiment and have one participant each. The
last line of the output is the error of this project's Gaussian process.
"""

import click
import numpy as np

from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses.point_observations import Simulation
from mission_service.experiments.beachly.corrections import (
    Floats,
    Method,
    case_of,
    errors_m,
    in_period,
    observations_of_participant,
)
from mission_service.experiments.beachly.truth import random_burn

SEEDS = range(1000, 1010)
LENGTHS_M = (10.0, 15.0, 20.0, 25.0, 40.0, 60.0, 100.0)


def main() -> None:
    """Print the mean front error in the paper's period and its reduction, for each length."""
    burns = [random_burn(seed) for seed in SEEDS]
    cases = [(case_of(burn), observations_of_participant(burn, 0)) for burn in burns]

    def mean_m(method: Method | None) -> float:
        found = [
            errors_m(case, observations, method)[in_period(case.at_s)]
            for case, observations in cases
        ]
        return float(np.nanmean(found))

    uncorrected_m = mean_m(None)
    click.echo(f"no corrections      {uncorrected_m:6.1f} m")
    for length_m in LENGTHS_M:

        def method(
            fire: Simulation, observations: Floats, length_m: float = length_m
        ) -> Simulation:
            return PaperCorrected(fire, observations, length_m)

        left_m = mean_m(method)
        share = 1.0 - left_m / uncorrected_m
        click.echo(f"paper, {length_m:5.0f} m      {left_m:6.1f} m  {share:5.0%}")
    left_m = mean_m(GaussianCorrected)
    click.echo(f"Gaussian process    {left_m:6.1f} m  {1 - left_m / uncorrected_m:5.0%}")


if __name__ == "__main__":
    main()
