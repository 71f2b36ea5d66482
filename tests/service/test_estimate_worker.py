"""The estimate in a thread: the same bits as on the loop, order, refusals, kills, a free loop."""

import asyncio
import random
import threading
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission_service.config.scenario import load_scenario
from mission_service.events import (
    AnyEvent,
    Corrected,
    FireObserved,
    Observed,
    Telemetry,
    Undone,
    WindSet,
)
from mission_service.fire.best_fire import Folded, after
from mission_service.fire.observed_window import in_letters
from mission_service.fire.run_ensemble import WeatherSet
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.journal.snapshot import Known, copied
from mission_service.replay.verification import verify
from tests.api.worlds import World, world_in
from tests.patience import until

SCENARIO = load_scenario("default", ("start_s=1380", "deploy_at_s=1380", "planner.rule=circling"))
Place = tuple[float, float]


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """A flight without simulated fire, 25 minutes after ignition."""
    scenario = SCENARIO.model_copy(update={"simulation": type(SCENARIO.simulation)()})
    found = world_in(tmp_path, scenario)
    found.fly(1500.0)
    yield found
    found.simulation.service.recording.journal.close()


class Held:
    """Holds the computations of the estimate until they are let go."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.let_go = threading.Event()
        self.begun = 0

        def held(*args: Any) -> Folded:
            self.begun += 1
            assert self.let_go.wait(60.0)
            return after(*args)

        monkeypatch.setattr("mission_service.fire.run_estimate.after", held)


def place_of(world: World, row: int, col: int) -> list[float]:
    land = world.context.landscape
    return [float(value) for value in land.lat_lon_of(*land.xy_of(float(row), float(col)))]


def ahead(world: World, cells: int) -> tuple[int, int]:
    """An unburned cell north of the fire."""
    rows, cols = np.nonzero(world.context.estimate.fire.burned())
    return int(rows.min()) - cells, int(cols.mean())


def ask(world: World, do: str, **keys: Any) -> Coroutine[Any, Any, dict[str, Any]]:
    request = {"do": do, "by": "anna", "station": "tower", **keys}
    return world.context.request_handler.ask_and_wait(request)


def spot(world: World, cells: int, **keys: Any) -> Coroutine[Any, Any, dict[str, Any]]:
    """Report a burning place north of the fire."""
    points = [place_of(world, *ahead(world, cells))]
    return ask(world, "observe", state="burning", shape="points", points=points, **keys)


def run(world: World, steps: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run steps while the worker folds the inputs."""

    async def whole() -> None:
        worker = asyncio.create_task(world.worker.fold_inputs())
        await asyncio.sleep(0)
        try:
            await steps()
        finally:
            worker.cancel()
            await asyncio.gather(worker, return_exceptions=True)

    asyncio.run(asyncio.wait_for(whole(), 120.0))


def again(world: World) -> RunEstimate:
    """The estimate after all events of the journal, as a restart has it."""
    found = RunEstimate(world.simulation.service._scenario, world.context.landscape)
    for entry in SegmentReader(world.context.journal_path):
        if entry.is_event:
            found.apply_history(entry.content)  # type: ignore[arg-type]
        else:
            found.on_command(entry.content)  # type: ignore[arg-type]
    return found


def assert_equal(one: RunEstimate, other: RunEstimate, at_s: float) -> None:
    for each in (one, other):
        each.advance(round(at_s * 1e6))
    assert np.array_equal(one.fire.expected_s(), other.fire.expected_s())
    assert inputs_of(one) == inputs_of(other)


def inputs_of(estimate: RunEstimate) -> list[str]:
    """The inputs of the ensemble."""
    inputs = estimate.ensemble._inputs
    return [repr(each.weather.entries if isinstance(each, WeatherSet) else each) for each in inputs]


def seen_burning(at_us: int, place: Place, seen_at_us: int) -> FireObserved:
    return FireObserved(
        at_us, "ann", "tower", "burning", "points", (place,), seen_at_us, 5.0, 0.0, ""
    )


def events() -> list[AnyEvent]:
    """Images, late images, reports, corrections, undo and wind."""
    land = landscape_of(SCENARIO)

    def place(row: int, col: int) -> Place:
        lat, lon = land.lat_lon_of(*land.xy_of(float(row), float(col)))
        return float(lat), float(lon)

    found: list[AnyEvent] = []
    for at_us in range(11_000_000, 900_000_000, 7_000_000):
        state = np.full((30, 30), ord("u"), dtype=np.uint8)
        state[10:20, 10 : 12 + at_us // 60_000_000] = ord("b")
        found.append(Observed(at_us, "hawk", 20, 30, in_letters(state)))
        by = (at_us, "ann", "tower")
        match at_us // 7_000_000 % 20:
            case 3:
                late_us = at_us - 200_000_000
                found.append(Observed(late_us, "kite", 100, 100, ("bb", "bb")))
            case 7:
                row = 60 + at_us // 50_000_000
                found.append(seen_burning(at_us, place(row, 60), max(at_us - 100_000_000, 0)))
            case 8:  # contradicted by images
                found.append(seen_burning(at_us, place(22, 32), at_us - 50_000_000))
            case 11:
                corners = (place(120, 60), place(120, 70), place(130, 70))
                found.append(Corrected(*by, "burning", "polygon", corners, at_us))
            case 12:
                found.append(WindSet(*by, 5.0, float(at_us // 10_000_000)))
            case 17 | 18:  # the second one is refused
                found.append(Undone(*by))
            case _:
                pass
    return found


def test_the_estimate_does_not_depend_on_when_inputs_are_folded() -> None:
    """Also not reports that are refused while other inputs wait: they are in the journal."""
    land, chance = landscape_of(SCENARIO), random.Random(5)
    live, replayed = (RunEstimate(SCENARIO, land) for _ in range(2))
    live.in_background = True
    most = unused = 0
    for event in events():
        live.apply_report(event)
        live.on_event(event)
        replayed.apply_history(event)
        live.advance(event.at_us)
        most = max(most, len(live._waiting))
        while chance.random() < 0.3 and (work := live.next_work()) is not None:
            found = work()
            unused += found.unused is not None
            live.adopt(found)
    assert most > 5
    assert unused > 1
    live.end_background()
    assert_equal(live, replayed, 1000.0)


def test_the_loop_reads_the_fire_while_a_thread_folds(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = Held(monkeypatch)

    async def steps() -> None:
        before = world.context.estimate.fire.burned_ha
        asked = asyncio.create_task(spot(world, 30))
        await until(lambda: held.begun > 0)
        assert not asked.done()
        assert world.context.request_handler.ask({"do": "status"})["ok"]
        world.context.estimate.advance(world.simulation.clock.now_us)
        assert world.context.estimate.fire.burned_ha == before
        assert world.context.estimate.seen_from(last_fix(world)) is None
        held.let_go.set()
        reply = await asked
        assert reply["ok"], reply
        assert reply["burned_ha_after"] > reply["burned_ha_before"] == pytest.approx(before, abs=2)

    run(world, steps)
    assert held.begun == 1


def last_fix(world: World) -> Telemetry:
    entries = SegmentReader(world.context.journal_path)
    return [each.content for each in entries if isinstance(each.content, Telemetry)][-1]


def test_reports_at_once_are_used_in_their_order_and_replay_to_the_same_fire(
    world: World, tmp_path: Path
) -> None:
    async def steps() -> None:
        line = [place_of(world, *ahead(world, cells)) for cells in (20, 36)]
        asked = [
            spot(world, 30, age_s=600.0),
            ask(world, "wind", speed_m_s=6.0, from_deg=90.0),
            ask(world, "correct", state="unburned", shape="line", points=line),
            ask(world, "undo"),
            ask(world, "undo"),  # refused: nothing to undo
            spot(world, 40, age_s=900.0),
        ]
        replies = await asyncio.gather(*asked)
        assert [reply.get("error") for reply in replies] == [*[None] * 4, "nothing to undo", None]

    run(world, steps)
    assert not world.context.estimate.is_behind
    world.fly(1560.0)
    assert_equal(world.context.estimate, again(world), 1560.0)
    world.simulation.service.recording.journal.close()
    assert verify(tmp_path / "journal.jsonl").difference is None
    windows = [
        entry.content
        for entry in SegmentReader(world.context.journal_path)
        if isinstance(entry.content, Observed) and entry.content.corrects
    ]
    assert len(windows) == 4  # two reports, a correction and its undo reach the planner


def test_a_run_that_is_killed_meanwhile_loses_no_report(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither with a snapshot of that moment nor with the journal."""
    held = Held(monkeypatch)
    saved: list[RunEstimate] = []

    async def steps() -> None:
        place = ahead(world, 30)
        asked = asyncio.create_task(spot(world, 30))
        await until(lambda: held.begun > 0)
        shared = Known(world.simulation.service._scenario, world.context.landscape)
        saved.append(copied({"estimate": world.context.estimate}, shared)["estimate"])
        held.let_go.set()
        assert (await asked)["ok"]
        for found in (saved[0], again(world)):
            found.advance(world.simulation.clock.now_us)
            assert found.fire.burned()[place]
            assert_equal(world.context.estimate, found, world.now_s)

    run(world, steps)


@pytest.mark.defect
def test_a_report_that_cannot_be_used_changes_nothing_and_stops_no_restart(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*args: object, **keywords: object) -> None:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr("mission_service.fire.best_fire.with_observation", broken)
    before = world.context.estimate.fire.burned().copy()

    async def steps() -> None:
        reply = await spot(world, 30)
        assert not reply["ok"]
        assert "ZeroDivisionError: a defect; this is a defect, please report it" in reply["error"]
        assert np.array_equal(world.context.estimate.fire.burned(), before)
        alarms = world.context.state_view.alarms
        assert "ZeroDivisionError: a defect; this is a defect" in alarms["estimate/defect"].text

    run(world, steps)
    assert_equal(world.context.estimate, again(world), world.now_s)


def test_a_refusal_that_no_sender_waits_for_is_announced(world: World) -> None:
    async def steps() -> None:
        handler = world.context.request_handler
        points = [place_of(world, *ahead(world, 30))]
        spots = {"do": "observe", "state": "burning", "shape": "points", "points": points}
        for request in (spots, {"do": "undo"}):
            assert handler.ask({**request, "by": "anna", "station": "mqtt"})["ok"]
        await until(lambda: not world.context.estimate.is_behind)

    before = world.context.state_view.announcement_id
    run(world, steps)
    lines = [line.text for line in world.context.state_view.announcements_after(before)]
    assert "the report from anna is not used: nothing to undo" in lines
