"""One process for each vehicle: three agents with a real broker; processes are killed."""

import asyncio
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from benchmarks.formation_processes import Stage, formation, map_of
from benchmarks.mosquitto import MOSQUITTO
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.formation.members import first_fire
from mission_service.replay.verification import verify

NAMES, SPEEDUP = ("heron", "stork", "crane"), 10.0
TRIES = 10


def later_than(stage: Stage, names: Iterable[str], at_us: int) -> Callable[[], bool]:
    """Return whether all of these have sent a state since then."""
    return lambda: all(name in stage.states and stage.states[name].at_us > at_us for name in names)


def maps_agree(folder: Path) -> bool:
    """Return whether all have the same map, apart from observations of the last seconds.

    Without its history, the process that returned late would lack many cells.
    """
    last = [sorted(folder.glob(f"{name}-*"))[-1] / "journal.jsonl" for name in NAMES]
    heron, *others = map(map_of, last)
    scenario = load_scenario(str(folder / "scenario.toml"))
    grown = int(heron.sum()) - len(first_fire(scenario, landscape_of(scenario)))
    return grown > 50 and all((heron != other).sum() < 0.2 * grown for other in others)


@pytest.mark.skipif(MOSQUITTO is None, reason="no mosquitto: apt-get install mosquitto")
@pytest.mark.long
def test_agents_and_broker_are_killed_and_come_back(tmp_path: Path) -> None:
    async def fly() -> None:
        async with formation(tmp_path, len(NAMES), SPEEDUP) as stage:
            first, killed, third = NAMES
            await stage.passes(60.0)
            stage.kill(killed)
            await stage.passes(30.0)
            assert {state.sender for state in stage.present()} == {first, third}

            # It adopts the others' time. The last message of the killed process may arrive late.
            await stage.take_over(killed)

            stage.broker.kill()
            await asyncio.sleep(40.0 / SPEEDUP)
            stage.states.clear()
            at_us = stage.now_us
            stage.broker.start()
            # They have flown on in the meantime.
            on = later_than(stage, NAMES, at_us + 20_000_000)
            await stage.until(on, 30.0, "all send again")
            await stage.passes(40.0)
            for _ in range(TRIES):  # on a loaded machine messages arrive late
                if maps_agree(tmp_path):
                    return
                await stage.passes(20.0)
            raise AssertionError("the maps differ")

    asyncio.run(fly())
    for log in tmp_path.glob("*.log"):
        assert "Traceback" not in log.read_text(encoding="utf-8"), log
    assert "no broker at" in (tmp_path / "heron.log").read_text(encoding="utf-8")
    journals = sorted(tmp_path.glob("*/journal.jsonl"))
    assert len(journals) == len(NAMES) + 1
    result = verify(journals[-1])  # sent and received messages are reproduced, too
    assert result.difference is None
