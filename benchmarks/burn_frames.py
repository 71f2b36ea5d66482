"""Fly burns with random operator requests over unreliable links, and check each release.

    python -m benchmarks.burn_frames [RUNS] [FIRST_SEED]

Each run is a simulated small burn, with MAVLink frames to a mock copter. The simulated operators
approve, reject, abort, send wrong hashes, become inactive, report people inside the unit and change
the wind. The link loses frames or fails, the position is lost, or the battery level is low. After
the run the journal and the outputs of the mock's dropper are checked. Each release must belong to a
drop of a plan that an operator at a station approved by its exact hash, with a complete checklist,
and whose approval was still in effect. The drop must be inside the unit, and no mission accepted by
the mock may contain a drop.
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
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.burn.controller import burn_flight
from mission_service.guidance.burn.plan_mission import has_drop
from mission_service.journal.journal_file import Journal, header_of
from mission_service.journal.segments import Chain
from mission_service.simulation.sim import Simulation

LAT, LON = 36.35, -84.16
NORTH_DEG, EAST_DEG = 1.0 / 111_195.0, 1.0 / 89_560.0
SIDE_M = 120.0
ENDS_S = 300.0
RELEASES = (1900.0, 0.0)  # PWM of a servo; command to open a gripper


def place(east_m: float, north_m: float) -> tuple[float, float]:
    """Return lat, lon of a place given in metres from the unit's south-west corner."""
    return LAT + north_m * NORTH_DEG, LON + east_m * EAST_DEG


CORNERS = tuple(place(x, y) for x, y in ((0, 0), (SIDE_M, 0), (SIDE_M, SIDE_M), (0, SIDE_M)))


def small_burn(stack: str, **burn: Any) -> dict[str, Any]:
    """Return the table of a scenario with a burn unit of 120 m by 120 m.

    Its southern edge is lit, and the station ``boss`` is at the vehicle's home.
    """
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
    """Return a small burn with a random stack, link loss and wind."""
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


class RandomOperators:
    """Simulated operators that send valid and invalid requests at random."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        assert scenario.burn is not None
        self._rng = rng
        self._burn = scenario.burn
        self._next_us = 0
        self._hashes: list[str] = ["0" * 64]
        self.leaves_s = float(rng.choice([math.inf, math.inf, 90.0]))

    def due(self, now_us: int, core: Core) -> list[AnyOperatorEvent]:
        """Return the operator events that are due."""
        if now_us < self._next_us:
            return []
        self._next_us = now_us + 2_000_000
        if now_us > self.leaves_s * 1e6:  # the wind feed, which has no role approve, continues
            return [WindSet(now_us, "wind feed", "boss", 2.0, 0.0)]
        guidance = burn_flight(core.guidance)
        plan_hash = guidance.approvals.plan_hash
        if plan_hash:
            self._hashes.append(plan_hash)
        sender = (now_us, "operator", "boss")
        events: list[AnyOperatorEvent] = [OperatorHeartbeat(*sender)]
        chance = self._rng.random()
        if not guidance.checklist.complete and chance < 0.9:
            events += [ChecklistAnswered(*sender, item, True) for item in self._burn.go_items]
        if plan_hash and guidance.approvals.approval is None and self._rng.random() < 0.8:
            events.append(Approved(*sender, plan_hash))
        if self._rng.random() < 0.05:
            events.append(self._random_event(sender))
        return events

    def _random_event(self, sender: tuple[int, str, str]) -> AnyOperatorEvent:
        rng, (at_us, by, _) = self._rng, sender
        x, y = (float(value) for value in rng.uniform(0.0, SIDE_M, 2))
        some = str(rng.choice(self._hashes))
        smaller = [place(p, q) for p, q in ((0, 0), (SIDE_M, 0), (SIDE_M, 90), (0, 90))]
        choices: list[AnyOperatorEvent] = [
            Aborted(*sender),
            Approved(*sender, some),
            Approved(at_us, by, "elsewhere", self._hashes[-1]),
            Rejected(*sender, some),
            ChecklistAnswered(*sender, str(rng.choice(self._burn.go_items)), False),
            PlanRequested(*sender, drop_spacing_m=float(rng.uniform(5.0, 20.0))),
            WindSet(*sender, float(rng.uniform(0.0, 8.0)), float(rng.uniform(0.0, 360.0))),
            PersonReported(*sender, "visitor", *place(x, y), float(rng.choice([0.0, 30.0]))),
            IgnitionReported(*sender, (place(x, y), place(y, x)), at_us),
            BurnUnitSet(*sender, tuple(smaller)),
            Resumed(at_us, "service", "", 1.0),
        ]
        return choices[int(rng.integers(len(choices)))]


def fly(seed: int, folder: Path) -> dict[str, int]:
    """Fly one run and return its numbers of releases and ordered drops.

    Raises AssertionError for a release or an order that is not allowed.
    """
    rng = np.random.default_rng(seed)
    scenario = scenario_of(rng)
    landscape = landscape_of(scenario)
    path = folder / f"{seed}.jsonl"
    journal = Journal(path, header_of(scenario, landscape.digest(), ""), durable=False)
    simulation = Simulation(scenario, journal, landscape, RandomOperators(scenario, rng).due)
    (rig,) = simulation.rigs
    fault_s, fault = float(rng.uniform(40.0, 160.0)), str(rng.choice(["", "link", "gps", "low"]))
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
        if fault and simulation.link_us > fault_s * 1e6:
            _inject(fault, rig)
            fault = ""
    journal.close()
    releases = released([value for _, _, _, value in rig.mock.outputs])
    wrong = [items for items in missions if has_drop(items)]
    assert not wrong, f"seed {seed}: a mission contains a drop: {wrong[0]}"
    ordered = check(path, scenario, seed)
    assert releases <= ordered, (
        f"seed {seed}: {releases} releases at the dropper, {ordered} drops ordered"
    )
    return {"releases": releases, "ordered": ordered}


def released(values: list[float]) -> int:
    """Return the number of releases in the sequence of values of a dropper's output.

    A duplicated datagram sets the output twice to the same value and counts as one release.
    """
    pairs = zip([None, *values], values, strict=False)
    return sum(value in RELEASES and before not in RELEASES for before, value in pairs)


def _inject(fault: str, rig: Any) -> None:
    if fault == "link":
        rig._up._loss = rig._down._loss = 1.0
    elif fault == "gps":
        rig.mock.positions = False
    else:
        rig.mock.battery_percent = 15.0


def check(path: Path, scenario: Scenario, seed: int, boss: str = "boss") -> int:
    """Check that each drop in a journal was allowed; return the number of ordered drops.

    The check is independent of guidance and interlock and uses only the journal.
    """
    burn = scenario.burn
    assert burn is not None
    landscape = landscape_of(scenario)
    plans: dict[str, Any] = {}
    approved: dict[str, str] = {}  # user that approved, by plan hash
    attended_us: dict[str, int] = {}  # time of an approver's last activity, by plan hash
    go: set[str] = set()
    done: set[tuple[str, int]] = set()
    people: dict[str, tuple[float, float, float]] = {}
    area = _polygon(burn.unit or (), landscape)
    at_us, ordered = 0, 0
    chain = Chain(path)
    for reader, entry in chain.after(chain.begin):
        content = entry.content
        where = f"seed {seed}, {reader.path.name}, line {entry.line}: "
        if entry.is_event:
            at_us = content.at_us  # type: ignore[union-attr]
        if isinstance(content, OperatorEvent) and content.station == boss:
            for name, by in approved.items():
                if content.may_approve or content.by == by:
                    attended_us[name] = at_us
        match content:
            case ProposePlan():
                plans[content.plan_hash] = content.plan
            case Approved() if content.station == boss and content.plan_hash in plans:
                if go == set(burn.go_items):
                    approved[content.plan_hash] = content.by
                    attended_us[content.plan_hash] = at_us
            case WithdrawPlan() | Rejected():
                approved.pop(content.plan_hash, None)
            case ClimbAndHold() | LinkLost():
                approved.clear()
            case Aborted() | Resumed() | Return():
                approved.clear()
                go.clear()
            case ChecklistAnswered():
                (go.add if content.go else go.discard)(content.item)
                if not content.go:
                    approved.clear()
            case PersonReported():
                people[content.name] = (content.lat_deg, content.lon_deg, content.radius_m)
            case BurnUnitSet():
                area = _polygon(content.points, landscape)
            case UploadMission():
                assert not has_drop(content.items), where + "a drop in a mission"
            case Drop():
                ordered += 1
                _check_drop(content, plans, approved, at_us, where)
                inactive_us = at_us - attended_us[content.plan_hash]
                assert inactive_us <= burn.approver_timeout_s * 1e6, (
                    where + "no approver was active"
                )
                assert (content.plan_hash, content.number) not in done, where + "dropped twice"
                done.add((content.plan_hash, content.number))
                drop = shapely.Point(landscape.xy_of_lat_lon(content.lat_deg, content.lon_deg))
                assert area.covers(drop), where + "outside the unit"
                for lat, lon, radius_m in people.values():
                    person = shapely.Point(landscape.xy_of_lat_lon(lat, lon))
                    assert radius_m == 0.0 or drop.distance(person) > radius_m, where + "on people"
            case _:
                pass
    return ordered


def _check_drop(
    drop: Drop, plans: dict[str, Any], approved: dict[str, str], at_us: int, where: str
) -> None:
    assert drop.plan_hash in plans, where + "unknown plan"
    assert drop.plan_hash in approved, where + "plan is not approved"
    plan = plans[drop.plan_hash]
    assert at_us <= plan.valid_until_us, where + "plan has expired"
    assert 0 <= drop.number < len(plan.drops), where + "plan has no such drop"


def _polygon(corners: Any, landscape: Any) -> shapely.Polygon:
    return shapely.Polygon([landscape.xy_of_lat_lon(*corner) for corner in corners])


def main() -> None:
    """Fly all runs and print the number of drops in each."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    total = {"releases": 0, "ordered": 0}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + runs):
            found = fly(seed, Path(folder))
            total = {key: total[key] + found[key] for key in total}
            click.echo(f"seed {seed}: {found['ordered']} ordered, {found['releases']} released")
    click.echo(f"{runs} runs: {total['ordered']} drops ordered, all of them allowed")


if __name__ == "__main__":
    main()
