"""Compare the expected accuracy with flights: ``benchmarks.expected_accuracy FIRST LAST``.

    python -m benchmarks.expected_accuracy FIRST LAST [--counts 0,1,2,4] [--minutes 60]
        [--takeoff S] [--copters M_S]

``plan --what-if`` computes the expected mean distance between the estimated and the true front.
Here that many aircraft circle the fire of the default scenario in virtual time. Wind, moisture and
spread rate of the simulated fire differ from the estimate's model as in
``benchmarks.flown_estimate``. In the last ten minutes, once a minute, the distance of points of the
true front from the estimated front is measured along the whole front. Persistence is the true front
at takeoff. With ``--copters`` the aircraft are copters of this airspeed.
"""

import argparse
from collections.abc import Sequence

import click
import numpy as np

from benchmarks.flown_estimate import simulation_of, wrong_scenario
from benchmarks.image_files import front_of, mean_distance_m
from firemodel.arrays import Floats
from mission_service.config.scenario import Scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.simulation.expected_accuracy import AVERAGED_S, expected_accuracy

EVERY_S = 60.0
NAMES = ("hawk", "kite", "swift", "merlin", "osprey", "harrier", "falcon", "eagle")


def scenario_for(seed: int, count: int, takeoff_s: float, copters_m_s: float | None) -> Scenario:
    """Return the scenario with a wrong model and ``count`` aircraft (at least one) that circle."""
    found = wrong_scenario(seed, members=2)
    first = found.vehicles[0]
    if copters_m_s is not None:
        first = first.model_copy(update={"kind": "copter", "airspeed_m_s": copters_m_s})
    vehicles = tuple(
        first.model_copy(update={"name": name, "system_id": number + 1}) if number else first
        for number, name in enumerate(NAMES[: max(count, 1)])
    )
    rule = "circling" if count < 2 else "team.circling"
    planner = found.planner.model_copy(update={"rule": rule})
    changed = {"vehicles": vehicles, "planner": planner, "deploy_at_s": takeoff_s}
    return found.model_copy(update=changed)


def flown(scenario: Scenario, count: int, minutes: float) -> Floats:
    """Return the mean distances of the estimate and of persistence (2) in a flight."""
    start_s = scenario.first_flight_s
    end_s = start_s + 60.0 * minutes
    if count == 0:
        late = {"deploy_at_s": end_s + 600.0}
        scenario = scenario.model_copy(update=late)
    with simulation_of(scenario) as flight:
        assert flight.true_fire is not None
        flight.run_until(start_s)
        flight.true_fire.advance(round(start_s * 1e6))
        before = front_of(flight.true_fire.fire)
        errors = []
        for at_s in np.arange(end_s - AVERAGED_S + EVERY_S, end_s + 1.0, EVERY_S):
            flight.run_until(float(at_s))
            now_us = flight.clock.now_us
            flight.service.advance_fire(now_us)
            flight.true_fire.advance(now_us)
            true = front_of(flight.true_fire.fire)
            others = (front_of(flight.estimate.fire), before)
            errors.append([mean_distance_m(true, other) for other in others])
    return np.asarray(np.mean(errors, axis=0))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the expected and the measured mean distances, and their means over the seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--counts", default="0,1,2,4")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--takeoff", type=float, default=2400.0)
    parser.add_argument("--copters", type=float)
    given = parser.parse_args(arguments)
    counts = [int(word) for word in given.counts.split(",")]
    click.echo("mean distance of the front in m; persistence: the front at takeoff")
    click.echo("seed  aircraft  expected  measured  persistence")
    every: dict[int, list[Floats]] = {}
    for seed in range(given.first, given.last + 1):
        scenario = scenario_for(seed, 1, given.takeoff, given.copters)
        landscape, section = landscape_of(scenario), scenario.vehicles[0]
        expected = expected_accuracy(scenario, landscape, section, counts, given.minutes)
        for count, found in zip(counts, expected, strict=True):
            scenario = scenario_for(seed, count, given.takeoff, given.copters)
            row = np.array([found.error_m, *flown(scenario, count, given.minutes)])
            every.setdefault(count, []).append(row)
            click.echo(f"{seed:4}  {count:8}  " + "  ".join(f"{each:8.1f}" for each in row))
    for count, rows in every.items():
        mean = np.mean(rows, axis=0)
        click.echo(f"mean  {count:8}  " + "  ".join(f"{each:8.1f}" for each in mean))


if __name__ == "__main__":
    main()
