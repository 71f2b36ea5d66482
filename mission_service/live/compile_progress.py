"""Reports the progress of a compilation that takes more than two seconds."""

import contextlib
import threading
from collections.abc import Callable, Iterator

from firemodel.compiled import compiled_counts

NOTICE_AFTER_S = 2.0
PROGRESS_EVERY_S = 5.0
LOADS = (
    "loading planners and fire model (they are compiled once after an installation or an update); "
    "the links open afterwards"
)


@contextlib.contextmanager
def compile_progress(notice: Callable[[str], None]) -> Iterator[None]:
    """Send lines to ``notice`` from a thread while the body compiles functions.

    The first line is sent after ``NOTICE_AFTER_S``, so that a body that only loads compiled
    functions sends none; then a line with the number of compiled functions is sent every
    ``PROGRESS_EVERY_S``.
    """
    ended = threading.Event()
    reporter = threading.Thread(target=_report, args=(ended, notice), daemon=True)
    reporter.start()
    try:
        yield
    finally:
        ended.set()
        reporter.join()


def _report(ended: threading.Event, notice: Callable[[str], None]) -> None:
    if ended.wait(NOTICE_AFTER_S):
        return
    notice(LOADS)
    while not ended.wait(PROGRESS_EVERY_S):
        ready, known = compiled_counts()
        notice(f"compiled {ready} of about {known} functions")
