"""Processes received Cursor on Target events: reports about the fire, and positions of people.

A report is converted to the same request as a report over HTTP or MQTT. TAK does not identify its
users, so the request has no role and can never approve.
"""

import asyncio
from typing import TYPE_CHECKING

from mission_service.config.service_section import CotSection
from mission_service.interfaces.cot.fire_reports import name_of
from mission_service.interfaces.cot.people_positions import person_in
from mission_service.interfaces.cot.received_events import CotEvent, CotEventError, parse_event
from mission_service.interfaces.cot.report_filter import (
    RETRY_S,
    Accepted,
    ReportFilter,
    Verdict,
)
from mission_service.interfaces.limits import RateLimiter
from mission_service.runtime.clocks import clock_us, wall_us

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

ABOUT = "cot"  # the source of announcements
EVENTS_A_SECOND, EVENTS_AT_ONCE = 500.0, 1000.0  # above this, the connection is read more slowly
LINES_A_SECOND, LINES_AT_ONCE = 0.1, 20.0
ALL = ""
MAX_BAD_EVENTS = 1000


class EventReceiver:
    """The receiver of one run; it outlives lost connections."""

    def __init__(self, context: "RunContext", settings: CotSection, site: str) -> None:
        self._context = context
        self._settings, self._own = settings, f"{site}."
        self._filter: ReportFilter | None = None
        if settings.reports is not None and context.scenario.burn_flown is None:
            self._filter = ReportFilter(
                settings.reports,
                lambda digest: context.state_view.statistics.sources.has_report(digest),
            )
        self._events = RateLimiter(EVENTS_A_SECOND, EVENTS_AT_ONCE)
        self._lines = RateLimiter(LINES_A_SECOND, LINES_AT_ONCE)
        self._suppressed = 0
        self._bad_events: set[str] = set()  # beginnings of the texts that were announced

    async def receive(self, data: bytes) -> None:
        """Process one event, after a pause if too many events arrive."""
        wait_s = self._events.consume(ALL, clock_us() / 1e6)
        await asyncio.sleep(wait_s)  # other tasks run between two events
        if wait_s:
            self._events.consume(ALL, clock_us() / 1e6)
        try:
            event = parse_event(data)
            if event is not None and not event.uid.startswith(self._own):
                self._process(event)
        except CotEventError as error:
            self.on_unreadable(str(error))

    def _process(self, event: CotEvent) -> None:
        """Process an event from another sender. Raises CotEventError if the event is not usable."""
        if self._settings.people is not None:
            person = person_in(event, self._settings.people, wall_us())
            if person is not None:
                self._context.people.update_position(person)
        if self._filter is not None:
            now_s = clock_us() / 1e6
            self._handle(self._filter.receive(event, now_s, wall_us()), now_s)

    def handle_timer(self) -> None:
        """Refuse reports that have waited too long; called regularly."""
        if self._filter is not None:
            now_s = clock_us() / 1e6
            self._handle(self._filter.handle_timer(now_s), now_s)

    def on_unreadable(self, text: str) -> None:
        """Announce why an event is not used, once for each different text before the colon."""
        kind = text.partition(":")[0]
        if kind not in self._bad_events and len(self._bad_events) < MAX_BAD_EVENTS:
            self._bad_events.add(kind)
            self._announce(text, clock_us() / 1e6)

    def _handle(self, verdicts: list[Verdict], now_s: float) -> None:
        for verdict in verdicts:
            if isinstance(verdict, Accepted):
                self._submit(verdict, now_s)
            else:
                self._announce(f"{name_of(verdict.report)}: {verdict.problem}", now_s)

    def _submit(self, accepted: Accepted, now_s: float) -> None:
        """Submit a request; the run makes further announcements about the resulting event."""
        assert self._filter is not None
        answer = self._context.request_handler.ask(accepted.request, may_approve=False)
        if answer["ok"]:
            self._filter.add_accepted(accepted.report)
        else:
            retry_s = now_s + RETRY_S
            self._handle(self._filter.refuse(accepted.report, answer["error"], retry_s), now_s)

    def _announce(self, text: str, now_s: float) -> None:
        if self._lines.consume(ALL, now_s):
            self._suppressed += 1
            return
        more = f" ({self._suppressed} more lines omitted)" if self._suppressed else ""
        self._suppressed = 0
        self._context.service.announce(ABOUT, f"a TAK report is not used: {text}{more}")
        self._context.ring()
