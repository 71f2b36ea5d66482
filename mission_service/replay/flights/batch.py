"""Analyses a whole logged flight, with an open-loop replay if a scenario is given."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from mission_service.journal.journal_file import header_of
from mission_service.replay.flights.flight_logs import Flight, survey
from mission_service.replay.flights.journal_log import JOURNAL, JournalLog
from mission_service.replay.flights.open_loop_replay import OpenLoopReplay, entries_of
from mission_service.replay.flights.run_analysis import RunAnalysis, run_analysis
from mission_service.replay.flights.scenario_pairing import Pairing
from mission_service.replay.flights.write_once_journal import WriteOnceJournal, refuse_loss


def analysis_of(name: str, flight: Flight) -> RunAnalysis:
    """Analyse a flight without a replay; the fire of a journal is analysed too."""
    own, found = flight.logs[0], survey(flight)
    whole = len(flight.logs) == 1 and not flight.is_part
    return run_analysis(name, flight, found, own if whole and isinstance(own, JournalLog) else None)


def analysis_with_fire(name: str, pairing: Pairing, out: Path | None, created: str) -> RunAnalysis:
    """Analyse a flight with its open-loop replay; write the replay's journal to ``out`` if given.

    ``created`` is the time in the journal's header. Raises FlightError if ``out`` already contains
    the journal of a run.
    """
    if out is None:
        with tempfile.TemporaryDirectory() as folder:
            return analysis_with_fire(name, pairing, Path(folder), created)
    path = out / JOURNAL
    refuse_loss(path, [log.path for log in pairing.flight.logs])
    header = header_of(pairing.scenario, pairing.landscape.digest(), created)
    journal = WriteOnceJournal(path, header, pairing.logs)
    complete = False
    try:
        replay = OpenLoopReplay(pairing, journal)
        for entry in entries_of(pairing):
            replay.apply(entry)
        complete = True
    finally:
        journal.finish(complete)
    return run_analysis(name, pairing.flight, pairing.survey, JournalLog(path), pairing.mission)


def distinct(names: Sequence[str]) -> list[str]:
    """Return the names, with numbers appended to equal names."""
    return [
        name if names.count(name) == 1 else f"{name}-{names[: place + 1].count(name)}"
        for place, name in enumerate(names)
    ]


def run_name(paths: Sequence[Path]) -> str:
    """Return the name of a run: the names of its logs, or of a journal's folder."""
    return " + ".join(dict.fromkeys(_name_of(path) for path in paths))


def _name_of(path: Path) -> str:
    if path.is_dir():
        return path.resolve().name
    return path.resolve().parent.name if path.name == JOURNAL else path.stem
