"""Predicted against flown time of the flight home: mock PX4 and ArduPilot planes and copters.

    python -m benchmarks.time_home [RETURNS] [SEED]

In each simulation a vehicle monitors a fire in a constant wind and is ordered home several times
(default 10) at random moments; near home it is ordered to resume. The predicted time is the
service's estimate at the order. The flown time of a copter ends 5 m from home. That of a plane is
the time from the order until it is 100 m from home, and the time that the last 100 m need at the
speed reached there: planes circle around home. The baseline divides the distance by the airspeed.
The limit of the mean error is 5 %.
"""

import math
import random
import sys
import tempfile
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import click

from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import AnyOperatorEvent, Order, OrderGiven
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.simulation.sim import Simulation

WINDS_M_S = (1.2, 4.0, 8.0, 12.0)
VEHICLES = tuple(product(("px4", "ardupilot"), ("plane", "copter")))
AIRSPEED_M_S = 18.0
NEAR_M, LIMIT = {"plane": 100.0, "copter": 5.0}, 0.05
AWAY_S = (150.0, 400.0)  # flight between two returns
MIN_AWAY_M = 300.0
LONGEST_S = 1200.0  # simulated time for each return


@dataclass
class Returns:
    """The crew that orders the returns of one vehicle, and measures them."""

    wanted: int
    chance: random.Random
    times_s: list[tuple[float, float, float]] = field(default_factory=list)  # with the baseline
    due_s: float = 0.0
    ordered_at_s: float | None = None
    predicted_s: float = 0.0
    baseline_s: float = 0.0

    def due(self, at_us: int, core: Core) -> list[AnyOperatorEvent]:
        """Return the order that is due, and record a return that has ended."""
        at_s = at_us / 1e6
        vehicle = core.vehicles["hawk"]
        fix, found = vehicle.availability.fix, vehicle.energy.estimate
        if fix is None or found is None or len(self.times_s) >= self.wanted:
            return []
        away_m = math.dist((fix.x_m, fix.y_m), vehicle.home_m)
        if self.due_s == 0.0:
            self.due_s = at_s + self.chance.uniform(*AWAY_S)
        if self.ordered_at_s is None:
            if at_s < self.due_s or away_m < MIN_AWAY_M or found.at_s != at_s:
                return []
            self.ordered_at_s, self.predicted_s = at_s, found.time_home_s
            self.baseline_s = away_m / AIRSPEED_M_S
            return [self._order(at_us, "return")]
        plane = vehicle.section.kind == "plane"
        if away_m > NEAR_M[vehicle.section.kind] or fix.at_s != at_s:
            return []
        left_s = away_m / max(math.hypot(fix.east_m_s, fix.north_m_s), 1.0) if plane else 0.0
        flown_s = at_s - self.ordered_at_s + left_s
        self.times_s.append((self.predicted_s, self.baseline_s, flown_s))
        self.ordered_at_s, self.due_s = None, at_s + self.chance.uniform(*AWAY_S)
        return [self._order(at_us, "resume")]

    def _order(self, at_us: int, order: Order) -> AnyOperatorEvent:
        return OrderGiven(at_us, "benchmark", "", "hawk", order, True)


def flown(stack: str, kind: str, wind_m_s: float, returns: int, seed: int) -> Returns:
    """Simulate the returns of one vehicle in one wind."""
    scenario = load_scenario(
        "default",
        (
            *("start_s=3500", "fly_in_wind=true", f"weather.0.wind_speed_m_s={wind_m_s}"),
            "planner.rule=circling",
            *(f"vehicles.0.stack={stack}", f"vehicles.0.kind={kind}", "vehicles.0.autostart=true"),
            *(f"vehicles.0.airspeed_m_s={AIRSPEED_M_S}", "vehicles.0.endurance_s=1000000"),
        ),
    )
    crew, landscape = Returns(returns, random.Random(seed)), landscape_of(scenario)
    with tempfile.TemporaryDirectory() as folder:
        header = header_of(scenario, landscape.digest(), "")
        journal = Journal(Path(folder) / "journal.jsonl", header, durable=False)
        simulation = Simulation(scenario, journal, landscape, crew.due)
        last_us = round((scenario.start_s + returns * LONGEST_S) * 1e6)
        while len(crew.times_s) < returns and simulation.clock.now_us < last_us:
            simulation.step()
        journal.close()
    return crew


def main(returns: int, seed: int) -> None:
    """Print a line for each vehicle and wind; exit with 1 if a mean error exceeds the limit."""
    click.echo("vehicle          wind m/s  returns  flown s  error %  worst %  baseline error %")
    failed = False
    for (stack, kind), wind_m_s in product(VEHICLES, WINDS_M_S):
        times_s = flown(stack, kind, wind_m_s, returns, seed).times_s
        errors = [abs(predicted / real - 1.0) for predicted, _, real in times_s]
        baselines = [abs(baseline / real - 1.0) for _, baseline, real in times_s]
        count = max(len(times_s), 1)
        mean = sum(errors) / count
        failed |= mean > LIMIT or len(times_s) < returns
        click.echo(
            f"{stack + ' ' + kind:16} {wind_m_s:8.1f} {len(times_s):8}"
            f" {sum(real for *_, real in times_s) / count:8.1f} {100 * mean:8.1f}"
            f" {100 * max(errors, default=math.nan):8.1f} {100 * sum(baselines) / count:17.1f}"
        )
    sys.exit(failed)


if __name__ == "__main__":
    arguments = [int(each) for each in sys.argv[1:]]
    main(*(arguments + [10, 0][len(arguments) :]))
