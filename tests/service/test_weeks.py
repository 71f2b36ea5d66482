"""The memory of a service does not grow with time: containers have the same size later.

``benchmarks.weeks`` measures the memory of the real daemon. Here objects are counted in virtual
time, with limits so small that they are reached within minutes.
"""

import random
import types
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
import shapely

from benchmarks.load_scenario import FIRE, Load, scenario_text
from mission_service.config.scenario import flying, load_run
from mission_service.core.core import Core
from mission_service.events import (
    AnyOperatorEvent,
    Corrected,
    Erased,
    MissionRequested,
    OrderGiven,
    Redone,
    Undone,
    WindSet,
)
from mission_service.fire import corrected_fire, run_ensemble
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.runtime import run_statistics, track
from mission_service.runtime.alarms import notices
from mission_service.simulation.sim import Simulation

START_S = 12 * 3600.0  # a slow fire, large enough for two vehicles
EVERY_S = 30.0
SAMPLES = 6  # samples in each half
VEHICLES = 2
# Smaller numbers of elements, characters and coordinates are ignored.
FEW = 12


def contents(root: object, left_out: list[object]) -> Counter[str]:
    """Return the numbers of elements in all containers that are reachable from an object.

    Keys are the class and attribute that contain a container, with ``[]`` for each level below.
    """
    found: Counter[str] = Counter()
    seen, waiting = {id(each) for each in left_out}, [("root", root)]
    while waiting:
        where, thing = waiting.pop()
        if isinstance(thing, str | bytes):
            found[where] += len(thing)
            continue
        if id(thing) in seen or isinstance(thing, type | types.FunctionType | types.ModuleType):
            continue
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            found[where] += thing.size
        elif isinstance(thing, shapely.Geometry):
            found[where] += int(shapely.get_num_coordinates(thing))
        elif isinstance(thing, dict):
            found[where] += len(thing)
            waiting += [(f"{where}[]", each) for pair in thing.items() for each in pair]
        elif isinstance(thing, list | tuple | set | frozenset | deque):
            found[where] += len(thing)
            waiting += [(f"{where}[]", each) for each in thing]
        elif isinstance(thing, types.MethodType):
            waiting.append((where, thing.__self__))
        else:
            kind = type(thing).__name__
            waiting += [(f"{kind}.{name}", value) for name, value in attributes(thing)]
    return found


def attributes(thing: object) -> Iterator[tuple[str, Any]]:
    """Yield attributes from ``__dict__``, slots and msgspec's fields."""
    names = set(getattr(thing, "__dict__", ()))
    for kind in type(thing).__mro__:
        slots = vars(kind).get("__slots__", ())
        names.update((slots,) if isinstance(slots, str) else slots)
    if isinstance(thing, msgspec.Struct):
        names.update(thing.__struct_fields__)
    for name in sorted(names):
        if hasattr(thing, name):
            yield name, getattr(thing, name)


class People:
    """An operator who draws, erases, undoes, holds or sets the wind every ten seconds."""

    def __init__(self) -> None:
        self._rng = random.Random(3)
        self._due_us = round((START_S + 120.0) * 1e6)
        self.count = 0

    def due(self, now_us: int, core: Core) -> list[AnyOperatorEvent]:
        if now_us < self._due_us:
            return []
        self._due_us = now_us + 10_000_000
        self.count += 1
        rng, ann = self._rng, (now_us, "ann", "desk")
        north, east = rng.uniform(-0.004, 0.004), rng.uniform(-0.004, 0.004)
        vehicle = f"uas{rng.randrange(1, VEHICLES + 1)}"
        match self.count % 12:
            case 0:
                return [Undone(*ann)]
            case 1:
                return [Redone(*ann)]
            case 2:
                return [Erased(*ann, FIRE[0] + north, FIRE[1] + east, 100.0)]
            case 3 | 4:
                return [WindSet(*ann, rng.uniform(0.0, 0.3), rng.uniform(0.0, 360.0))]
            case 5:
                return [OrderGiven(*ann, vehicle, "hold"), OrderGiven(*ann, vehicle, "resume")]
            case 6:
                return [MissionRequested(*ann, vehicle)]
            case _:
                place = (FIRE[0] + north, FIRE[1] + east)
                state: Literal["burned", "unburned"] = rng.choice(("burned", "unburned"))
                return [Corrected(*ann, state, "point", (place,), now_us)]


def grown(samples: list[Counter[str]]) -> list[str]:
    """Return the keys whose counts in the last quarter all exceed the maximum of the first half."""
    half, quarter = samples[: len(samples) // 2], samples[-len(samples) // 4 :]
    found = []
    for key in samples[-1]:
        before, after = max(each[key] for each in half), min(each[key] for each in quarter)
        if after > before + FEW and after > 1.1 * before:
            found.append(f"{key}: {before} -> {after}")
    return found


@pytest.mark.long
def test_what_a_service_holds_does_not_grow_with_what_has_passed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notices, "MAX_ANNOUNCEMENTS", 10)
    monkeypatch.setattr(notices, "MAX_RECORDS", 10)
    monkeypatch.setattr(run_statistics, "MAX_REVERSALS", 1)
    monkeypatch.setattr(run_statistics, "MAX_REASONS", 3)
    monkeypatch.setattr(track, "MAX_POINTS", 64)
    monkeypatch.setattr(corrected_fire, "MAX_STEPS", 6)
    monkeypatch.setattr(run_ensemble, "INPUTS_PER_MARK", 6)
    path = tmp_path / "weeks.toml"
    load = Load(VEHICLES, cells=120, start_s=START_S, end_s=1e8, wind_speed_m_s=0, dead_1h_pct=6)
    path.write_text(scenario_text(load), "utf-8")
    scenario = flying(load_run(str(path), ())[0])
    landscape = landscape_of(scenario)
    header = header_of(scenario, landscape.digest(), "")
    journal = Journal(tmp_path / "journal.jsonl", header, durable=False)
    people = People()
    simulation = Simulation(scenario, journal, landscape, people.due)
    shown = simulation.service.state_view
    for rig in simulation.rigs:
        if rig.mock.stack.name == "px4":  # the missions have no landing
            rig.mock.parameters.change("MIS_TKO_LAND_REQ", 0.0)
    simulation.run_until(START_S + 240.0)
    samples, counts = [], []
    for number in range(1, 2 * SAMPLES + 1):
        simulation.run_until(START_S + 240.0 + number * EVERY_S)
        service = simulation.service
        clients = [rig.client for rig in simulation.rigs]
        samples.append(contents([service, clients], [scenario, landscape, header]))
        uploads = sum(each.uploads_accepted for each in shown.vehicles.values())
        decisions = sum(each.decisions for each in shown.vehicles.values())
        counts.append((shown.telemetry_count, decisions, uploads, people.count))
    journal.close()
    first, half, last = counts[0], counts[SAMPLES - 1], counts[-1]
    assert all(a < b < c for a, b, c in zip(first, half, last, strict=True)), "all of it went on"
    assert not grown(samples), "\n".join(grown(samples))
