"""Near misses with another aircraft, flown with each resolution on a mock autopilot.

A vehicle monitors a fire. At random times an aircraft appears that would pass within 100 m beside
and 50 m above or below the place where the vehicle is then, in 40 to 80 s, at 40 to 80 m/s, level
or with the climb rate ``--climb``. The same encounter is flown with each resolution. The columns
are the smallest distance (median, worst), the share of encounters without well clear (2000 ft and
250 ft), and the share of near mid-air collisions (500 ft and 100 ft).
"""

import json
import os
import random
import statistics
import tempfile
from collections.abc import Callable
from dataclasses import astuple, replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from autopilot_bridge.links.codec import Codec
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.ground_distance import M_PER_DEG
from mission_service.journal.journal_file import Journal, header_of
from mission_service.simulation.sim import Simulation
from tests.service.intruders import ADSB_COMPONENT, Intruder, Passed, add_distance

RESOLUTIONS = ("none", "hold", "descend", "return")
BETWEEN_S, AFTER_S = 20.0, 60.0
NMAC_M, NMAC_UP_M = 500.0 * 0.3048, 100.0 * 0.3048


def in_child(run: Callable[[], Any]) -> Any:
    """Run a function in a copy of this process, and return its result (JSON)."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(write, json.dumps(run()).encode())
        finally:
            os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    return json.loads(text)


def place_in(sim: Simulation, in_s: float) -> tuple[float, float, float]:
    """Return the position of the vehicle after ``in_s`` without other aircraft."""
    sim.run_until(sim.clock.now_us / 1e6 + in_s)
    fix = sim.service.state_view.telemetry[sim.rigs[0].gateway.name]
    return fix.lat_deg, fix.lon_deg, fix.altitude_amsl_m


def intruder_to(
    place: tuple[float, float, float],
    now_s: float,
    in_s: float,
    rng: random.Random,
    climb_m_s: float,
) -> Intruder:
    """Return an aircraft that passes near a place after ``in_s``."""
    found = Intruder(now_s + in_s, *place, rng.uniform(0.0, 360.0), rng.uniform(40.0, 80.0))
    offset_deg = [rng.uniform(-100.0, 100.0) / M_PER_DEG for _ in range(2)]
    return replace(
        found,
        lat_deg=place[0] + offset_deg[0],
        lon_deg=place[1] + offset_deg[1],
        altitude_m=place[2] + rng.uniform(-50.0, 50.0),
        climb_m_s=climb_m_s,
    )


def flown(sim: Simulation, intruder: Intruder, resolution: str, seconds: int) -> list[float]:
    """Fly an encounter with a resolution; return the fields of ``Passed`` and 1 for an NMAC."""
    aircraft = sim.core._other_aircraft
    assert aircraft is not None
    aircraft._section = aircraft._section.model_copy(update={"resolution": resolution})
    codec, passed, nmac = Codec(sim.rigs[0].mock.system_id, ADSB_COMPONENT), Passed(), False
    for _ in range(seconds):
        at_s = sim.clock.now_us / 1e6
        sim.rigs[0].client.receive_data(intruder.report(at_s, codec), sim.link_us)
        for step in range(1, 5):
            sim.run_until(at_s + step / 4.0)
            now = Passed()
            add_distance(now, sim, intruder)
            nmac |= now.horizontal_m < NMAC_M and _up_m(sim, intruder) < NMAC_UP_M
            passed.distance_m = min(passed.distance_m, now.distance_m)
            passed.horizontal_m = min(passed.horizontal_m, now.horizontal_m)
            passed.violated_s += now.violated_s / 4.0
    return [*astuple(passed), float(nmac)]


def _up_m(sim: Simulation, intruder: Intruder) -> float:
    fix = sim.service.state_view.telemetry[sim.rigs[0].gateway.name]
    return abs(intruder.place(fix.at_us / 1e6)[2] - fix.altitude_amsl_m)


@click.command(help=__doc__)
@click.argument("encounters", type=int, default=100)
@click.argument("seed", type=int, default=0)
@click.option("--kind", type=click.Choice(["plane", "copter"]), default="plane")
@click.option("--stack", type=click.Choice(["px4", "ardupilot"]), default="px4")
@click.option("--climb", type=float, default=0.0, help="Climb rate of the aircraft in m/s.")
def main(encounters: int, seed: int, kind: str, stack: str, climb: float) -> None:
    """Fly the encounters and print the table."""
    changes = (
        *(f"vehicles.0.kind={kind}", f"vehicles.0.stack={stack}", "surveillance.range_m=20000"),
        *("vehicles.0.airspeed_m_s=14", "planner.rule=islam_hu_damped", f"seed={seed}"),
    )
    scenario = load_scenario("demo", changes)
    scenario = scenario.model_copy(
        update={"vehicles": scenario.vehicles[:1], "duration_s": 1e6, "clock": "autopilot"}
    )
    landscape, rng = landscape_of(scenario), random.Random(seed)
    results: dict[str, list[list[float]]] = {each: [] for each in RESOLUTIONS}
    with tempfile.TemporaryDirectory() as folder:
        header = header_of(scenario, landscape.digest(), "")
        sim = Simulation(
            scenario, Journal(Path(folder) / "journal.jsonl", header, durable=False), landscape
        )
        sim.run_until(sim.clock.now_us / 1e6 + 240.0)
        for _ in range(encounters):
            sim.run_until(sim.clock.now_us / 1e6 + BETWEEN_S)
            in_s = rng.uniform(40.0, 80.0)
            place = in_child(partial(place_in, sim, in_s))
            intruder = intruder_to(place, sim.clock.now_us / 1e6, in_s, rng, climb)
            for each in RESOLUTIONS:
                seconds = round(in_s + AFTER_S)
                run = partial(flown, sim, intruder, each, seconds)
                results[each].append(in_child(run))
    click.echo(f"{encounters} encounters of a {stack} {kind}, seed {seed}, climb {climb:g} m/s")
    click.echo("resolution  distance m: median   worst   not well clear   near collision")
    for each, rows in results.items():
        distances = [row[0] for row in rows]
        lost, near = (
            100.0 * statistics.mean(row[column] > 0.0 for row in rows) for column in (2, 3)
        )
        click.echo(
            f"{each:<10} {statistics.median(distances):19.0f} {min(distances):7.0f}"
            f"{lost:15.0f} % {near:14.0f} %"
        )


if __name__ == "__main__":
    main()
