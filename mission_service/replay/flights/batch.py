"""Analyses a logged flight from begin to end, with an open-loop replay if a scenario is given."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from mission_service.journal.journal_file import header_of
from mission_service.replay.flights.flight_logs import Flight, survey
from mission_service.replay.flights.journal_log import JOURNAL, JournalLog
from mission_service.replay.flights.open_loop_replay import OpenLoopReplay, told_in
from mission_service.replay.flights.run_analysis import RunAnalysis, run_analysis
from mission_service.replay.flights.scenario_pairing import Replaying
from mission_service.replay.flights.write_once_journal import WriteOnceJournal, refuse_loss


def story_of(name: str, flight: Flight) -> RunAnalysis:
    """Analyse a flight without a replay; a journal has its own fire."""
    own, found = flight.logs[0], survey(flight)
    whole = len(flight.logs) == 1 and not flight.is_part
    return run_analysis(name, flight, found, own if whole and isinstance(own, JournalLog) else None)


def story_with_fire(name: str, what: Replaying, out: Path | None, created: str) -> RunAnalysis:
    """Analyse a flight with its open-loop replay, whose journal is left in ``out``, if given.

    ``created`` goes into the journal's header. Raises FlightError if ``out`` already contains the
    journal of a run.
    """
    if out is not None:
        return _beside(name, what, out / JOURNAL, created)
    with tempfile.TemporaryDirectory() as folder:
        return _beside(name, what, Path(folder) / JOURNAL, created)


def _beside(name: str, what: Replaying, path: Path, created: str) -> RunAnalysis:
    refuse_loss(path, [log.path for log in what.flight.logs])
    header = header_of(what.scenario, what.landscape.digest(), created)
    journal = WriteOnceJournal(path, header, what.logs)
    complete = False
    try:
        replay = OpenLoopReplay(what, journal)
        for told in told_in(what):
            replay.apply(told)
            replay.service.record.announcements.clear()  # not read here
        complete = True
    finally:
        journal.finish(complete)
    return run_analysis(name, what.flight, what.survey, JournalLog(path), what.mission)


def distinct(names: Sequence[str]) -> list[str]:
    """Return the same names, with numbers appended to equal ones."""
    return [
        name if names.count(name) == 1 else f"{name}-{names[: place + 1].count(name)}"
        for place, name in enumerate(names)
    ]


def called(paths: Sequence[Path]) -> str:
    """Return the name of a run from its files: for a journal the folder's name, else the file's name."""
    return " + ".join(dict.fromkeys(_called(path) for path in paths))


def _called(path: Path) -> str:
    if path.is_dir():
        return path.resolve().name
    return path.resolve().parent.name if path.name == JOURNAL else path.stem
