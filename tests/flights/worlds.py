"""Flights to replay: a journal of two planes at a fire with corrections, and a plane's .bin."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from mission_service.cli.replay_live import played
from mission_service.events import Corrected
from mission_service.journal.journal_file import header_of
from mission_service.replay.flights.flight_logs import flight_of
from mission_service.replay.flights.playback import Playback
from mission_service.replay.flights.scenario_pairing import ScenarioChoice
from mission_service.replay.flights.write_once_journal import WriteOnceJournal
from mission_service.runtime.play_head import PlayHead, Speed
from tests.api.worlds import scenario_of, world_in

BURNED = ((36.352, -84.162), (36.352, -84.158), (36.355, -84.158), (36.355, -84.162))


def journal_in(folder: Path, seconds: float = 160.0) -> Path:
    """Return the journal of a demo run; half-way an operator draws a burned area."""
    world = world_in(folder, scenario_of())
    begin_s = world.context.scenario.deploy_at_s
    world.fly(begin_s + seconds / 2)
    at_us = round(world.now_s * 1e6)
    event = Corrected(at_us, "anna", "", "burned", "polygon", BURNED, at_us)
    world.context.service.submit(event, world.simulation.link_us)
    world.fly(begin_s + seconds)
    world.context.service.recording.journal.close()
    return folder / "journal.jsonl"


@contextmanager
def player_of(log: Path, out: Path, speed: Speed = "max") -> Iterator[Playback]:
    """Return a player of a log, with its journal in ``out``."""
    what, _ = played(flight_of([str(log)]), ScenarioChoice())
    header = header_of(what.scenario, what.landscape.digest(), "2026-11-22")
    out.mkdir(exist_ok=True)
    journal = WriteOnceJournal(out / "journal.jsonl", header, what.logs)
    player = Playback(what, journal, PlayHead(what.begin_us, what.end_us, speed))
    try:
        yield player
    finally:
        player.close()


def run(player: Playback) -> None:
    """Process all that is due, a few events per turn."""
    turns = count(1)
    while player.turn(0, lambda: next(turns) % 50 == 0):
        pass


def sought(player: Playback, share: float) -> None:
    """Seek to a fraction of the flight."""
    head = player.head
    head.seek(head.begin_us + round(share * (head.end_us - head.begin_us)))
    run(player)
