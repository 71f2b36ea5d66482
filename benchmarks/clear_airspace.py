"""Clears the airspace of five vehicles over links that lose 10 %; one vehicle receives nothing.

    python -m benchmarks.clear_airspace [SEEDS]

Planes and copters of both stacks monitor a fire in wind, with two fields. At a random time an
operator clears the airspace: all vehicles land, or leave a volume. One vehicle receives nothing
from that moment on. The benchmark prints for each run the time until the last vehicle that receives
was commanded and until it has acknowledged, until the alarm about the silent vehicle, the stated,
first predicted and flown times of the last vehicle, the largest error of a first prediction, and
the number of vehicles that were late. Limits: commanded within 2 s, alarm within 10 s, no vehicle
late.

The baseline sends the order ``land`` to each vehicle by hand, one after the other: an operator
needs 4 s for each (select, order, read the reply).
"""

import random
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeGuard

import click

from autopilot_bridge.links.memory_link import MemoryLink
from mission_service.commands import CLEARED, ORDER_NAMES, AnyCommand, ShowClearing, UploadMission
from mission_service.config.scenario import Scenario, load_scenario, scenario_path
from mission_service.core.core import Core
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
    ClearingOrdered,
    CommandFinished,
    OrderGiven,
    UploadFinished,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.replay.verification import verify
from mission_service.simulation.sim import Simulation

FIFTH = """
[[vehicles]]
name = "lark"
stack = "px4"
kind = "copter"
link = "udpin:127.0.0.1:14590"
system_id = 5
airspeed_m_s = 12
home_lat_deg = 36.370784
home_lon_deg = -84.132309
autostart = true
"""
BY_HAND_S = 4.0
LONGEST_S = 2400.0
MAX_COMMANDED_S, MAX_REPORTED_S = 2.0, 10.0
TO_VEHICLE = (UploadMission, *ORDER_NAMES)


@dataclass
class Cleared:
    """The times of one run, in seconds after the request, by vehicle."""

    silent: str
    commanded_s: dict[str, float] = field(default_factory=dict)
    acknowledged_s: dict[str, float] = field(default_factory=dict)
    expected_s: dict[str, float] = field(default_factory=dict)  # predicted at the request
    stated_s: dict[str, float] = field(default_factory=dict)
    out_s: dict[str, float] = field(default_factory=dict)
    reported_s: float | None = None  # the alarm about the silent vehicle

    @property
    def late(self) -> list[str]:
        """The vehicles that receive and were not out by their stated times."""
        return [
            name
            for name, stated_s in self.stated_s.items()
            if name != self.silent and self.out_s.get(name, LONGEST_S) > stated_s
        ]


def five_vehicles(folder: Path, seed: int, *changes: str) -> Scenario:
    """Return the scenario ``team`` with a fifth vehicle, in wind, over links that lose 10 %."""
    path = folder / "five.toml"
    path.write_text(scenario_path("team").read_text(encoding="utf-8") + FIFTH, encoding="utf-8")
    return load_scenario(str(path), (f"seed={seed}", "fly_in_wind=true", "link.loss=0.1", *changes))


class Run:
    """A simulated flight of the five vehicles, in which one receives nothing after ``deafen``."""

    def __init__(self, folder: Path, seed: int, crew_s: float = 0.0) -> None:
        self.scenario = five_vehicles(folder, seed)
        landscape = landscape_of(self.scenario)
        self.path = folder / "journal.jsonl"
        self.journal = Journal(
            self.path, header_of(self.scenario, landscape.digest(), ""), durable=False
        )
        self._orders: list[tuple[int, AnyOperatorEvent]] = []
        self.simulation = Simulation(self.scenario, self.journal, landscape, self._due)

    def _due(self, at_us: int, core: Core) -> list[AnyOperatorEvent]:
        due = [event for since_us, event in self._orders if since_us <= at_us]
        self._orders = [each for each in self._orders if each[0] > at_us]
        return due

    @property
    def now_us(self) -> int:
        """Mission time."""
        return self.simulation.clock.now_us

    def run(self, seconds: float) -> None:
        """Run for a duration."""
        self.simulation.run_until(self.now_us / 1e6 + seconds)

    def deafen(self, name: str) -> None:
        """Lose everything that is sent to a vehicle from now on."""
        rig = next(each for each in self.simulation.rigs if each.gateway.name == name)
        rig._up = MemoryLink(loss=1.0)

    def clear(self, **volume: object) -> None:
        """Request to clear the airspace now."""
        event = ClearingOrdered(self.now_us, "benchmark", "", **volume)  # type: ignore[arg-type]
        self.simulation.service.submit(event, self.simulation.link_us)

    def land_by_hand(self) -> None:
        """Order each vehicle to land, one after the other."""
        for number, vehicle in enumerate(self.scenario.vehicles):
            at_us = self.now_us + round(number * BY_HAND_S * 1e6)
            order = OrderGiven(at_us, "benchmark", "", vehicle.name, "land")
            self._orders.append((at_us, order))

    @property
    def in_force(self) -> bool:
        """Whether the airspace is being cleared."""
        return self.simulation.core.clearing.state.in_force

    def on_ground(self) -> set[str]:
        """Return the vehicles that are disarmed."""
        vehicles = self.simulation.core.vehicles
        return {name for name, each in vehicles.items() if not each.availability.armed}

    def entries(self) -> list[AnyEvent | AnyCommand]:
        """Close the journal, verify its replay, and return its content."""
        self.journal.close()
        difference = verify(self.path).difference
        assert difference is None, difference
        return [entry.content for entry in SegmentReader(self.path)]


def times_of(entries: list[AnyEvent | AnyCommand], silent: str) -> Cleared:
    """Return the times of the first request in a journal."""
    found, began_us, at_us = Cleared(silent), None, 0
    for entry in entries:
        at_us = getattr(entry, "at_us", at_us)
        if isinstance(entry, ClearingOrdered):
            began_us = at_us
        if began_us is None:
            continue
        since_s = (at_us - began_us) / 1e6
        if isinstance(entry, TO_VEHICLE):
            found.commanded_s.setdefault(entry.vehicle, since_s)
        elif _is_answer(entry):
            found.acknowledged_s.setdefault(entry.vehicle, since_s)
        elif isinstance(entry, ShowClearing):
            for row in entry.vehicles:
                name = row.vehicle
                if row.expected_us is not None and name not in found.expected_s:
                    found.expected_s[name] = (row.expected_us - began_us) / 1e6
                if row.out_by_us is not None:
                    found.stated_s.setdefault(name, (row.out_by_us - began_us) / 1e6)
                if row.phase in CLEARED:
                    found.out_s.setdefault(name, since_s)
                if name == silent and row.phase == "not reached" and found.reported_s is None:
                    found.reported_s = since_s
    return found


def _is_answer(entry: AnyEvent | AnyCommand) -> TypeGuard[CommandFinished | UploadFinished]:
    if isinstance(entry, CommandFinished):
        return entry.accepted
    return isinstance(entry, UploadFinished) and entry.outcome == "accepted"


def square(lat_deg: float, lon_deg: float, half_deg: float) -> tuple[tuple[float, float], ...]:
    """Return the corners of a square, in degrees."""
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return tuple((lat_deg + a * half_deg, lon_deg + 1.24 * b * half_deg) for a, b in signs)


def cleared(seed: int, lands: bool) -> Cleared:
    """Return the times of one run."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        run = Run(Path(folder), seed)
        run.run(100.0 + chance.uniform(200.0, 500.0))
        silent = chance.choice([each.name for each in run.scenario.vehicles])
        run.deafen(silent)
        if lands:
            run.clear()
        else:
            corners = square(36.364232, -84.140907, 0.012)
            run.clear(volume="smoke jumpers", corners=corners)
        others = {each.name for each in run.scenario.vehicles} - {silent}
        until_us = run.now_us + round(LONGEST_S * 1e6)
        while run.now_us < until_us and not _all_out(run, others):
            run.run(5.0)
        return times_of(run.entries(), silent)


def _all_out(run: Run, names: set[str]) -> bool:
    vehicles = run.simulation.core.clearing.state.vehicles
    return all(vehicles[name].phase in CLEARED for name in names if name in vehicles)


def by_hand(seed: int) -> tuple[float, float]:
    """Return the seconds until the last vehicle was commanded and until the last has landed."""
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        run = Run(Path(folder), seed)
        run.run(100.0 + chance.uniform(200.0, 500.0))
        silent = chance.choice([each.name for each in run.scenario.vehicles])
        run.deafen(silent)
        began_us = run.now_us
        run.land_by_hand()
        others = {each.name for each in run.scenario.vehicles} - {silent}
        while run.now_us < began_us + LONGEST_S * 1e6 and not others <= run.on_ground():
            run.run(5.0)
        run.journal.close()
        commanded_s = BY_HAND_S * (len(run.scenario.vehicles) - 1)
        return commanded_s, (run.now_us - began_us) / 1e6


def main(seeds: int) -> None:
    """Print a line for each run; exit with 1 if a limit is exceeded."""
    failed = False
    click.echo("run        silent  commanded  acknowledged  alarm  predicted  stated  flown  late")
    for seed in range(seeds):
        for lands in (True, False):
            found = cleared(seed, lands)
            others = [name for name in found.stated_s if name != found.silent]
            commanded_s = max(found.commanded_s.get(name, LONGEST_S) for name in others)
            failed |= commanded_s > MAX_COMMANDED_S or bool(found.late)
            if lands:
                failed |= found.reported_s is None or found.reported_s > MAX_REPORTED_S
            click.echo(
                f"{seed} {'land' if lands else 'volume':8} {found.silent:6}"
                f" {commanded_s:8.2f} s"
                f" {max(found.acknowledged_s.get(name, LONGEST_S) for name in others):10.1f} s"
                f" {-1.0 if found.reported_s is None else found.reported_s:6.1f}"
                f" {max(found.expected_s[name] for name in others):8.0f} s"
                f" {max(found.stated_s[name] for name in others):6.0f}"
                f" {max(found.out_s.get(name, LONGEST_S) for name in others):6.0f}"
                f"  {', '.join(found.late) or 'none'}"
            )
            for name in others:
                click.echo(
                    f"    {name:6} predicted {found.expected_s[name]:6.0f} s,"
                    f" stated {found.stated_s[name]:6.0f} s,"
                    f" out {found.out_s.get(name, LONGEST_S):6.0f} s"
                )
        commanded_s, landed_s = by_hand(seed)
        click.echo(f"{seed} by hand: commanded {commanded_s:.1f} s, on the ground {landed_s:.0f} s")
    sys.exit(failed)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)
