"""Creates the folder for a command's results, and checks that it is writable."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import chain, count
from pathlib import Path

import click


class Interrupted(click.ClickException):
    """The command was ended by Ctrl-C."""

    exit_code = 130  # 128 plus the number of SIGINT


def output_folder(out: Path) -> Path:
    """Return the folder ``out``, created if missing and checked to be writable.

    Raises MissionServiceError if the folder cannot be created or written to.
    """
    from tempfile import TemporaryFile

    from mission_service.errors import MissionServiceError
    from mission_service.journal.private_files import FOLDER_MODE

    try:
        out.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
    except OSError as error:
        raise MissionServiceError(f"{out}: cannot be created: {error.strerror}") from None
    try:
        with TemporaryFile(dir=out):  # an error occurs now, not after an hour of simulation
            pass
    except OSError as error:
        raise MissionServiceError(f"{out}: cannot be written to: {error.strerror}") from None
    return out


def refuse_run_folder(out: Path, sources: Iterable[Path]) -> None:
    """Raise RequestError if ``out`` is the folder of a run that is one of the sources.

    A source is a log, a journal or the folder of a run. A replay of a log may be repeated in the
    log's folder.
    """
    from mission_service.errors import RequestError
    from mission_service.journal.journal_file import begins_journal
    from mission_service.replay.flights.journal_log import JOURNAL, journal_in
    from mission_service.replay.flights.write_once_journal import is_of_replay

    for source in map(journal_in, sources):
        if out.resolve() != source.parent.resolve():
            continue
        beside = source.parent / JOURNAL
        if begins_journal(source) or (begins_journal(beside) and not is_of_replay(beside)):
            raise RequestError(
                f"{out}: is the folder of the run, and its files could be replaced; choose another "
                "--out"
            )


def new_folder(name: str, created: str, parent: Path = Path("out")) -> Path:
    """Return a new path for the results of a scenario, such as out/default-20261128T224000Z.

    Args:
        name: The name of the scenario.
        created: The date and time in the format of a journal's header, in UTC.
        parent: The folder for all results.

    Returns:
        A path that does not exist yet; if needed, a number is added.
    """
    words = re.sub(r"[^\w.-]+", "-", name).strip(".-") or "scenario"
    time = datetime.fromisoformat(created).strftime("%Y%m%dT%H%M%SZ")
    numbers = chain([""], (f"-{number}" for number in count(2)))
    return next(
        path for number in numbers if not (path := parent / f"{words}-{time}{number}").exists()
    )


@contextmanager
def results_in(out: Path, after_interrupt: str) -> Iterator[Path]:
    """Yield the folder from ``output_folder``; a created folder that stays empty is removed.

    After Ctrl-C the command raises Interrupted with a line that ends in ``after_interrupt``.
    """
    created = [each for each in (out, *out.parents) if not each.exists()]
    try:
        yield output_folder(out)
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; {after_interrupt}") from None
    finally:
        with suppress(OSError):  # a folder that is not empty remains
            for each in created:
                each.rmdir()
