"""Converts operators' requests to events, and the events' results to replies."""

from collections.abc import Awaitable, Callable
from typing import Any, NamedTuple

import msgspec

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from mission_service.commands import CONFIRM, REJECTED
from mission_service.core.request_events import ANYWHERE, STATUS, RequestScope, event_of
from mission_service.errors import MissionServiceError
from mission_service.events import (
    AnyOperatorEvent,
    Corrected,
    Erased,
    FireObserved,
    RasterObserved,
    Redone,
    Undone,
)

Answer = dict[str, Any]
CHANGES_AREA = (Corrected, FireObserved, RasterObserved, Erased, Undone, Redone)
OWN_ERRORS = (MissionServiceError, FireModelError, BridgeError)


class ReportOutcome(NamedTuple):
    """The result of applying a report to the estimate."""

    unused: Exception | None  # why the report was refused
    note: str  # why part of the report has no effect, or empty


# Returns an awaitable for the outcome of a report, or None if the outcome is known immediately.
Outcome = Callable[[AnyOperatorEvent], Awaitable[ReportOutcome] | None]


class RequestHandler:
    """The handler of requests from all interfaces: the control socket, HTTP and MQTT."""

    def __init__(
        self,
        submit: Callable[[AnyOperatorEvent], list[str]],
        status: Callable[[], dict[str, Any]],
        now_us: Callable[[], int],
        scope: RequestScope = ANYWHERE,
        burned_ha: Callable[[], float] | None = None,
        outcome: Outcome | None = None,
    ) -> None:
        """Set the functions that handle events; ``submit`` returns the resulting announcements.

        ``scope`` contains the data for checking requests. ``burned_ha`` returns the burned area,
        and is given if corrections change this area; replies to corrections then contain the area
        before and after. In a live run ``outcome`` waits until a report has been applied.
        """
        self._submit = submit
        self._status = status
        self._now_us = now_us
        self.scope = scope
        self._burned_ha = burned_ha
        self._outcome = outcome

    def ask(self, request: Any, may_approve: bool | None = None) -> Answer:
        """Handle one request and return the reply; no content of a request raises an exception.

        ``may_approve`` states whether the user has the role approve (``request_events.event_of``).
        ``confirm`` in the reply means that the order was not executed, because the order would end
        a mode that the autopilot or the pilot selected. The same request with ``confirmed`` is
        executed.

        In a live run the reply to a report is returned before the report is applied to the estimate
        (unlike in ``ask_or_wait``).
        """
        found = self._submitted(request, may_approve)
        return found if isinstance(found, dict) else self._reply(found)

    def ask_or_wait(
        self, request: Any, may_approve: bool | None = None, role: str = ""
    ) -> Answer | Awaitable[Answer]:
        """Handle one request like ``ask``, but reply to a report after the report is applied.

        ``role`` is the highest role of the user, if the interface identifies users.
        """
        found = self._submitted(request, may_approve, role)
        if isinstance(found, dict):
            return found
        outcome = None if self._outcome is None else self._outcome(found.event)
        return self._reply(found) if outcome is None else self._reply_after(found, outcome)

    async def ask_and_wait(
        self, request: Any, may_approve: bool | None = None, role: str = ""
    ) -> Answer:
        """Return the reply of ``ask_or_wait``."""
        found = self.ask_or_wait(request, may_approve, role)
        return found if isinstance(found, dict) else await found

    async def _reply_after(self, found: "_Submitted", outcome: Awaitable[ReportOutcome]) -> Answer:
        unused, note = await outcome
        if unused is not None:
            return wrong(str(unused))
        return self._reply(
            found._replace(messages=[*found.messages, note] if note else found.messages)
        )

    def _submitted(
        self, request: Any, may_approve: bool | None, role: str = ""
    ) -> "_Submitted | Answer":
        """Submit the event of a request; if the request results in no event, return the reply."""
        if isinstance(request, dict) and request.get("do") == STATUS:
            return {"ok": True, "status": self._status()}
        try:
            event = event_of(request, self._now_us(), self.scope, may_approve, role)
            burned_ha = self._burned_ha if isinstance(event, CHANGES_AREA) else None
            before_ha = None if burned_ha is None else burned_ha()
            return _Submitted(request["do"], event, before_ha, self._submit(event))
        except OWN_ERRORS as error:
            return wrong(str(error))

    def _reply(self, found: "_Submitted") -> Answer:
        if any(line.startswith(REJECTED) for line in found.messages):
            lines = dict.fromkeys(line.removeprefix(REJECTED).strip() for line in found.messages)
            words = "; ".join(lines)
            return wrong(f"{found.do}: {words}")
        event = found.event
        answer: Answer = {"ok": True, "at_s": event.at_us / 1e6, "event": type(event).__name__}
        if found.burned_ha is not None and self._burned_ha is not None:
            answer |= {
                "burned_ha_before": found.burned_ha,
                "burned_ha_after": self._burned_ha(),
            }
        answer["messages"] = found.messages
        if any(line.startswith(CONFIRM) for line in found.messages):
            answer["confirm"] = True
        return answer

    def answer(self, line: bytes) -> Answer | Awaitable[Answer]:
        """Return the reply to one line of JSON, like ``ask_or_wait``."""
        try:
            request = msgspec.json.decode(line)
        except (ValueError, RecursionError) as error:  # ValueError includes UnicodeDecodeError
            return wrong(f"not a line of JSON: {error}")
        return self.ask_or_wait(request)


class _Submitted(NamedTuple):
    """A journalled event, the burned area before the event, and the resulting announcements."""

    do: str
    event: AnyOperatorEvent
    burned_ha: float | None
    messages: list[str]


def wrong(text: str) -> Answer:
    """Return the reply to a refused request, with the reason."""
    return {"ok": False, "error": text}
