"""Errors of the estimate in flights, with a wrong model: ``benchmarks.flown_estimate FIRST LAST``.

One plane circles the fire of the default scenario in virtual time. Wind, moisture and spread rate
of the simulated fire differ from those that the estimate receives (standard deviations: 30 % and 30
degrees, 25 %, 30 %). Every half hour, the estimate and the forecasts of its ensemble for 30 and 60
minutes are compared with the simulated fire. The error is the area that differs, divided by the
area of the simulated fire. The forecast area contains the cells that have burned with a probability
of at least one half. Persistence is the estimated area at the start of the forecast; the model
alone has no observations.
"""

import argparse
import asyncio
import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click
import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import SimulatedFireSection, SimulationSection
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.fire.forecast import Forecasts
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.simulation.sim import Simulation

TIMES_S = (7200.0, 9000.0, 10800.0)
AHEAD_S = (0.0, 1800.0, 3600.0)
CHANGES = ("deploy_at_s=2400", "planner.rule=circling", "duration_s=20000")


def wrong_inputs(seed: int) -> SimulationSection:
    """Return a simulated fire that differs from the estimate's model."""
    rng = np.random.default_rng((4242, seed))
    section = SimulatedFireSection(
        wind_factor=math.exp(rng.normal(0.0, 0.3)),
        wind_turn_deg=float(rng.normal(0.0, 30.0)),
        moisture_factor=math.exp(rng.normal(0.0, 0.25)),
        spread_factor=math.exp(rng.normal(0.0, 0.3)),
    )
    return SimulationSection(fire=section)


def wrong_scenario(seed: int, members: int) -> Scenario:
    """Return the default scenario with a simulated fire that differs from the estimate's model."""
    found = load_scenario("default", (*CHANGES, f"estimate.members={members}"))
    return found.model_copy(update={"simulation": wrong_inputs(seed)})


def error(area: Mask, true: Mask) -> float:
    """Return the area that differs, divided by the true area."""
    return float(np.count_nonzero(area ^ true) / np.count_nonzero(true))


@contextmanager
def simulation_of(scenario: Scenario, landscape: Landscape | None = None) -> Iterator[Simulation]:
    """Yield a simulation that has not begun, with its journal in a temporary folder."""
    landscape = landscape or landscape_of(scenario)
    with tempfile.TemporaryDirectory() as folder:
        header = header_of(scenario, landscape.digest(), "")
        journal = Journal(Path(folder) / "journal.jsonl", header, durable=False)
        yield Simulation(scenario, journal, landscape)
        journal.close()


def run(seed: int, members: int) -> Floats:
    """Return the mean errors (lengths, methods: estimate, persistence, model) of a flight."""
    scenario = wrong_scenario(seed, members)
    with simulation_of(scenario) as flight:
        return asyncio.run(_flown(flight, scenario))


async def _flown(flight: Simulation, scenario: Scenario) -> Floats:
    model = fire_of(scenario, flight.estimate.landscape)
    forecasts = Forecasts(lambda: flight.estimate, lambda: flight.clock.now_us)
    assert flight.cameras is not None
    errors = []
    for at_s in TIMES_S:
        flight.run_until(at_s)
        flight.service.advance_fire(flight.clock.now_us)
        now_s, seen = flight.estimate.fire.time_s, flight.estimate.fire.burned()
        true, free = flight.cameras.fire.fire.copy(), model.copy()
        row = []
        for ahead_s in AHEAD_S:
            for fire in (true, free):
                fire.advance(now_s + ahead_s)
            area = seen
            if ahead_s:
                area = await forecasts.probability(now_s + ahead_s) >= 0.5
            row.append([error(each, true.burned()) for each in (area, seen, free.burned())])
        errors.append(row)
    forecasts.close()
    return np.asarray(np.mean(errors, axis=0))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of each seed, and their means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--members", type=int, default=24)
    given = parser.parse_args(arguments)
    click.echo("seed  error now/+30/+60 min: estimate, persistence, model alone")
    every = []
    for seed in range(given.first, given.last + 1):
        every.append(run(seed, given.members))
        click.echo(_line(f"{seed:4}", every[-1]))
    click.echo(_line("mean", np.mean(every, axis=0)))


def _line(name: str, errors: Floats) -> str:
    parts = ("/".join(f"{value:.3f}" for value in errors[:, column]) for column in range(3))
    return f"{name}  {'  '.join(parts)}"


if __name__ == "__main__":
    main()
