"""Burns with a crew that does as it likes and links that fail: what reaches the dropper.

    python -m benchmarks.burn_frames [RUNS] [FIRST_SEED]

Each run is a small burn in simulation, over MAVLink frames to a mock copter. Its crew approves,
rejects, aborts, names wrong hashes, leaves, moves people into the unit and turns the wind; the link
loses frames or is cut, the position is lost, the battery runs low. Then the journal and what the
mock's dropper did are read: every release must be of a drop of a plan that a person at a station
had approved by exactly its hash, with a complete list, and that nothing had ended since; it must
have been inside the unit; and no mission that the mock took holds anything that drops.
"""

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import numpy as np
import shapely

from autopilot_bridge.items import MissionItem
from mission_service.commands import (
    ClimbAndHold,
    Drop,
    ProposePlan,
    Return,
    UploadMission,
    WithdrawPlan,
)
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    Aborted,
    AnyOperatorEvent,
    Approved,
    BurnUnitSet,
    ChecklistAnswered,
    IgnitionReported,
    LinkLost,
    OperatorEvent,
    OperatorHeartbeat,
    PersonReported,
    PlanRequested,
    Rejected,
    Resumed,
    WindSet,
)
from mission_service.fire.setup import landscape_of
from mission_service.guidance.burn.controller import burn_flight
from mission_service.guidance.burn.plan_mission import has_drop
from mission_service.journal.journal_file import Journal, header_of
from mission_service.journal.segments import Chain
from mission_service.simulation.sim import Simulation

LAT, LON = 36.35, -84.16
NORTH_DEG, EAST_DEG = 1.0 / 111_195.0, 1.0 / 89_560.0
SIDE_M = 120.0
ENDS_S = 300.0
RELEASES = (1900.0, 0.0)  # servo's PWM; a gripper that opens


def place(east_m: float, north_m: float) -> tuple[float, float]:
    """Lat, lon from the unit's south-western corner."""
    return LAT + north_m * NORTH_DEG, LON + east_m * EAST_DEG


CORNERS = tuple(place(x, y) for x, y in ((0, 0), (SIDE_M, 0), (SIDE_M, SIDE_M), (0, SIDE_M)))


def small_burn(stack: str, **burn: Any) -> dict[str, Any]:
    """A scenario's table: a burn of 120 m by 120 m, its southern edge lit, the boss at home."""
    home = place(-20.0, 60.0)
    table = load_scenario("burn").model_dump()
    table["landscape"] |= {"rows": 100, "cols": 100}
    table["burn"] |= {
        "unit": CORNERS,
        "lit": [{"points": [place(2.0, 1.0), place(SIDE_M - 2.0, 1.0)]}],
        "camera_corrects": False,
        "stations": [{"name": "boss", "lat_deg": home[0], "lon_deg": home[1]}],
        **({"dropper": {"by": "gripper", "number": 1}} if stack == "px4" else {}),
        **burn,
    }
    table["vehicles"] = [
        table["vehicles"][0] | {"stack": stack, "home_lat_deg": home[0], "home_lon_deg": home[1]}
    ]
    return table


def scenario_of(rng: np.random.Generator) -> Scenario:
    """A small burn with either stack, a random link and wind."""
    stack = str(rng.choice(["ardupilot", "px4"]))
    seed, loss = int(rng.integers(1000)), float(rng.choice([0.0, 0.1, 0.3]))
    wind = {
        "wind_speed_m_s": float(rng.uniform(0.5, 5.0)),
        "wind_from_deg": float(rng.uniform(0.0, 360.0)),
    }
    table = small_burn(stack, spheres=int(rng.integers(3, 40)))
    table |= {"deploy_at_s": 5.0, "duration_s": ENDS_S, "seed": seed}
    table["link"] |= {"loss": loss, "duplication": 0.1}
    table["weather"] = [table["weather"][0] | wind]
    return Scenario.model_validate(table)


class WildCrew:
    """People who do anything, now and then the right thing."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        assert scenario.burn is not None
        self._rng = rng
        self._burn = scenario.burn
        self._next_us = 0
        self._hashes: list[str] = ["0" * 64]
        self.leaves_s = float(rng.choice([math.inf, math.inf, 90.0]))

    def due(self, now_us: int, core: Core) -> list[AnyOperatorEvent]:
        """What they do by now."""
        if now_us < self._next_us:
            return []
        self._next_us = now_us + 2_000_000
        if now_us > self.leaves_s * 1e6:  # a feed without the role approve goes on
            return [WindSet(now_us, "wind feed", "boss", 2.0, 0.0)]
        guidance = burn_flight(core.guidance)
        wanted = guidance.approvals.plan_hash
        if wanted:
            self._hashes.append(wanted)
        who = (now_us, "somebody", "boss")
        events: list[AnyOperatorEvent] = [OperatorHeartbeat(*who)]
        chance = self._rng.random()
        if not guidance.checklist.complete and chance < 0.9:
            events += [ChecklistAnswered(*who, item, True) for item in self._burn.go_items]
        if wanted and guidance.approvals.approval is None and self._rng.random() < 0.8:
            events.append(Approved(*who, wanted))
        if self._rng.random() < 0.05:
            events.append(self._anything(who))
        return events

    def _anything(self, who: tuple[int, str, str]) -> AnyOperatorEvent:
        rng, (at_us, by, _) = self._rng, who
        x, y = (float(value) for value in rng.uniform(0.0, SIDE_M, 2))
        some = str(rng.choice(self._hashes))
        smaller = [place(p, q) for p, q in ((0, 0), (SIDE_M, 0), (SIDE_M, 90), (0, 90))]
        choices: list[AnyOperatorEvent] = [
            Aborted(*who),
            Approved(*who, some),
            Approved(at_us, by, "elsewhere", self._hashes[-1]),
            Rejected(*who, some),
            ChecklistAnswered(*who, str(rng.choice(self._burn.go_items)), False),
            PlanRequested(*who, drop_spacing_m=float(rng.uniform(5.0, 20.0))),
            WindSet(*who, float(rng.uniform(0.0, 8.0)), float(rng.uniform(0.0, 360.0))),
            PersonReported(*who, "visitor", *place(x, y), float(rng.choice([0.0, 30.0]))),
            IgnitionReported(*who, (place(x, y), place(y, x)), at_us),
            BurnUnitSet(*who, tuple(smaller)),
            Resumed(at_us, "service", "", 1.0),
        ]
        return choices[int(rng.integers(len(choices)))]


def fly(seed: int, folder: Path) -> dict[str, int]:
    """One run; raises AssertionError with what was wrong."""
    rng = np.random.default_rng(seed)
    scenario = scenario_of(rng)
    landscape = landscape_of(scenario)
    path = folder / f"{seed}.jsonl"
    journal = Journal(path, header_of(scenario, landscape.digest(), ""), durable=False)
    simulation = Simulation(scenario, journal, landscape, WildCrew(scenario, rng).due)
    (rig,) = simulation.rigs
    trouble_s, trouble = (
        float(rng.uniform(40.0, 160.0)),
        str(rng.choice(["", "link", "gps", "low"])),
    )
    missions: list[tuple[MissionItem, ...]] = []
    steps = 0
    while simulation.clock.now_us < ENDS_S * 1e6 and simulation.link_us < 2.0 * ENDS_S * 1e6:
        simulation.step()
        steps += 1
        if steps % 50:
            continue
        items = tuple(rig.mock.flight.items)
        if not missions or missions[-1] != items:
            missions.append(items)
        if trouble and simulation.link_us > trouble_s * 1e6:
            _make(trouble, rig)
            trouble = ""
    journal.close()
    # A datagram that came twice sets the output twice to the same: one sphere.
    values = [value for _, _, _, value in rig.mock.outputs]
    releases = sum(
        value in RELEASES and before not in RELEASES
        for before, value in zip([None, *values], values, strict=False)
    )
    wrong = [items for items in missions if has_drop(items)]
    assert not wrong, f"seed {seed}: a mission with a drop in it: {wrong[0]}"
    ordered = check(path, scenario, seed)
    assert releases <= ordered, (
        f"seed {seed}: {releases} releases at the dropper, {ordered} drops ordered"
    )
    return {"releases": releases, "ordered": ordered}


def _make(trouble: str, rig: Any) -> None:
    if trouble == "link":
        rig._up._loss = rig._down._loss = 1.0
    elif trouble == "gps":
        rig.mock.positions = False
    else:
        rig.mock.battery_percent = 15.0


def check(path: Path, scenario: Scenario, seed: int, boss: str = "boss") -> int:
    """Read a journal from the beginning: may each drop have been ordered? Returns how many were.

    An oracle of its own: it shares nothing with leader or interlock but the words of the journal.
    """
    burn = scenario.burn
    assert burn is not None
    landscape = landscape_of(scenario)
    plans: dict[str, Any] = {}
    approved: dict[str, str] = {}  # hashes, with the user of their approval
    attended_us: dict[str, int] = {}  # of these, when an approver was last active
    go: set[str] = set()
    done: set[tuple[str, int]] = set()
    people: dict[str, tuple[float, float, float]] = {}
    area = _polygon(burn.unit or (), landscape)
    at_us, ordered = 0, 0
    chain = Chain(path)
    for reader, entry in chain.after(chain.begin):
        what = entry.content
        where = f"seed {seed}, {reader.path.name}, line {entry.line}: "
        if entry.is_event:
            at_us = what.at_us  # type: ignore[union-attr]
        if isinstance(what, OperatorEvent) and what.station == boss:
            for name, by in approved.items():
                if what.may_approve or what.by == by:
                    attended_us[name] = at_us
        match what:
            case ProposePlan():
                plans[what.plan_hash] = what.plan
            case Approved() if what.station == boss and what.plan_hash in plans:
                if go == set(burn.go_items):
                    approved[what.plan_hash] = what.by
                    attended_us[what.plan_hash] = at_us
            case WithdrawPlan() | Rejected():
                approved.pop(what.plan_hash, None)
            case ClimbAndHold() | LinkLost():
                approved.clear()
            case Aborted() | Resumed() | Return():
                approved.clear()
                go.clear()
            case ChecklistAnswered():
                (go.add if what.go else go.discard)(what.item)
                if not what.go:
                    approved.clear()
            case PersonReported():
                people[what.name] = (what.lat_deg, what.lon_deg, what.radius_m)
            case BurnUnitSet():
                area = _polygon(what.points, landscape)
            case UploadMission():
                assert not has_drop(what.items), where + "a drop in a mission"
            case Drop():
                ordered += 1
                _check_drop(what, plans, approved, at_us, where)
                silent_us = at_us - attended_us[what.plan_hash]
                assert silent_us <= burn.approver_timeout_s * 1e6, where + "nobody was there"
                assert (what.plan_hash, what.number) not in done, where + "dropped twice"
                done.add((what.plan_hash, what.number))
                here = shapely.Point(landscape.xy_of_lat_lon(what.lat_deg, what.lon_deg))
                assert area.covers(here), where + "outside the unit"
                for lat, lon, radius_m in people.values():
                    them = shapely.Point(landscape.xy_of_lat_lon(lat, lon))
                    assert radius_m == 0.0 or here.distance(them) > radius_m, where + "on people"
            case _:
                pass
    return ordered


def _check_drop(
    drop: Drop, plans: dict[str, Any], approved: dict[str, str], at_us: int, where: str
) -> None:
    assert drop.plan_hash in plans, where + "of no plan"
    assert drop.plan_hash in approved, where + "of a plan that is not approved"
    plan = plans[drop.plan_hash]
    assert at_us <= plan.valid_until_us, where + "after the plan's time"
    assert 0 <= drop.number < len(plan.drops), where + "of no drop of the plan"


def _polygon(corners: Any, landscape: Any) -> shapely.Polygon:
    return shapely.Polygon([landscape.xy_of_lat_lon(*corner) for corner in corners])


def main() -> None:
    """Fly them all."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    total = {"releases": 0, "ordered": 0}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + runs):
            found = fly(seed, Path(folder))
            total = {key: total[key] + found[key] for key in total}
            click.echo(f"seed {seed}: {found['ordered']} ordered, {found['releases']} fell")
    click.echo(f"{runs} runs: {total['ordered']} drops ordered, none that should not be")


if __name__ == "__main__":
    main()
