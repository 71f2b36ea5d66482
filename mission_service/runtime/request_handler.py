"""Converts operators' requests to events, and the events' results to replies."""

from collections.abc import Callable
from typing import Any

import msgspec

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from mission_service.commands import CONFIRM, REJECTED
from mission_service.core.request_events import ANYWHERE, STATUS, RequestScope, event_of
from mission_service.errors import MissionServiceError
from mission_service.events import AnyOperatorEvent, Corrected, Erased, FireObserved, Redone, Undone

Answer = dict[str, Any]
CHANGES_AREA = (Corrected, FireObserved, Erased, Undone, Redone)
OWN_ERRORS = (MissionServiceError, FireModelError, BridgeError)


class RequestHandler:
    """The handler of requests from all interfaces: the control socket, HTTP and MQTT."""

    def __init__(
        self,
        submit: Callable[[AnyOperatorEvent], list[str]],
        status: Callable[[], dict[str, Any]],
        now_us: Callable[[], int],
        scope: RequestScope = ANYWHERE,
        burned_ha: Callable[[], float] | None = None,
    ) -> None:
        """Set the functions that handle events; ``submit`` returns the resulting announcements.

        ``scope`` contains the data for checking requests. ``burned_ha`` returns the burned area if
        corrections change it; replies to corrections then contain the old and the new area.
        """
        self._submit = submit
        self._status = status
        self._now_us = now_us
        self.scope = scope
        self._burned_ha = burned_ha

    def ask(self, request: Any, may_approve: bool | None = None) -> Answer:
        """Handle one request and return the reply; no content of a request raises an exception.

        ``may_approve`` states whether the user has the role approve (``request_events.event_of``).
        ``confirm`` in the reply means that the order was not executed, because it would end a mode
        that the autopilot or the pilot selected. The same request with ``confirmed`` is executed.
        """
        if isinstance(request, dict) and request.get("do") == STATUS:
            return {"ok": True, "status": self._status()}
        try:
            event = event_of(request, self._now_us(), self.scope, may_approve)
            burned_ha = self._burned_ha if isinstance(event, CHANGES_AREA) else None
            before_ha = None if burned_ha is None else burned_ha()
            messages = self._submit(event)
        except OWN_ERRORS as error:
            return wrong(str(error))
        if any(line.startswith(REJECTED) for line in messages):
            lines = dict.fromkeys(line.removeprefix(REJECTED).strip() for line in messages)
            words = "; ".join(lines)
            return wrong(f"{request['do']}: {words}")
        answer: Answer = {"ok": True, "at_s": event.at_us / 1e6, "event": type(event).__name__}
        if burned_ha is not None:
            answer |= {"burned_ha_before": before_ha, "burned_ha_after": burned_ha()}
        answer["messages"] = messages
        if any(line.startswith(CONFIRM) for line in messages):
            answer["confirm"] = True
        return answer

    def answer(self, line: bytes) -> Answer:
        """Return the reply to one line of JSON; no content of a line raises an exception."""
        try:
            request = msgspec.json.decode(line)
        except (msgspec.DecodeError, RecursionError) as error:
            return wrong(f"not a line of JSON: {error}")
        return self.ask(request)


def wrong(text: str) -> Answer:
    """Return the reply to a refused request, with the reason."""
    return {"ok": False, "error": text}
