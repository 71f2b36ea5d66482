"""Applies the inputs of the estimate in a thread, so that the event loop is not blocked.

Inputs are applied one after another. Each input is journalled before it is applied. If the run is
killed between these two steps, the resumed run applies the input.
"""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

from mission_service.errors import RefusedEventError
from mission_service.events import AnyOperatorEvent
from mission_service.runtime.engine import Engine
from mission_service.runtime.request_handler import ReportOutcome

LOOK_EVERY_S = 0.1  # interval between checks for images; a report is applied at once


class EstimateWorker:
    """The task that applies the inputs of the estimate, and returns the outcomes of reports."""

    def __init__(self, service: Engine, now_us: Callable[[], int], flush: Callable[[], None]):
        """Set the clock of the links, and the function that sends the resulting frames."""
        self._service, self._now_us, self._flush = service, now_us, flush
        self._outcomes: dict[int, asyncio.Future[ReportOutcome]] = {}  # by the report's id
        self._bell = asyncio.Event()

    async def fold_inputs(self) -> None:
        """Apply inputs until cancelled; afterwards, reads apply the remaining inputs."""
        estimate = self._service.estimate
        estimate.in_background = True
        try:
            while True:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._bell.wait(), LOOK_EVERY_S)
                self._bell.clear()
                while estimate.is_behind:
                    await self._fold_next()
        finally:
            estimate.end_background()
            for each in self._outcomes.values():
                each.cancel()

    async def _fold_next(self) -> None:
        work = self._service.estimate.next_work()
        assert work is not None
        try:
            found = await asyncio.to_thread(work)
        except Exception as error:
            self._service.defect = RefusedEventError(
                f"the estimate cannot use an image: {type(error).__name__}: {error}; this is a "
                "defect, please report it"
            )
            raise self._service.defect from error
        report = self._service.adopt(found)
        while self._service.deliver_next(self._now_us()):
            self._flush()
            await asyncio.sleep(0)
        if report is None:
            return
        unused = None if found.unused is None else self._service.unused(report, found.unused)
        outcome = self._outcomes.pop(id(report), None)
        if outcome is not None:
            outcome.set_result(ReportOutcome(unused, found.change.note))
        elif unused is not None:  # a report over MQTT does not wait for the outcome
            self._service.announce("service", f"the report from {report.by} is not used: {unused}")

    def outcome(self, report: AnyOperatorEvent) -> Awaitable[ReportOutcome] | None:
        """Return an awaitable for a submitted report's outcome; None if none is pending."""
        if not self._service.estimate.waits_for(report):
            return None
        found = self._outcomes.setdefault(id(report), asyncio.get_running_loop().create_future())
        self._bell.set()
        return asyncio.shield(found)
