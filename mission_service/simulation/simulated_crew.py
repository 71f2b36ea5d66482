"""Simulates a crew that answers GO, is always present and approves each plan; not for live runs."""

from collections.abc import Sequence

from mission_service.config.sections import BurnSection
from mission_service.core.core import Core
from mission_service.events import AnyOperatorEvent, Approved, ChecklistAnswered, OperatorHeartbeat

NAME = "simulated crew"


class SimulatedCrew:
    """A crew that approves each plan ``thinks_s`` after it is proposed.

    ``script`` contains further operator events, in time order.
    """

    def __init__(
        self, burn: BurnSection, thinks_s: float = 5.0, script: Sequence[AnyOperatorEvent] = ()
    ) -> None:
        self._station = burn.stations[0].name
        self._items = burn.go_items
        self._delay_us = round(thinks_s * 1e6)
        self._heartbeat_us = round(burn.approver_timeout_s * 1e6 / 3)
        self._script = list(script)
        self._present_us = 0
        self._considered, self._since_us = "", 0
        self._answers_us = 0

    def due(self, now_us: int, core: Core) -> list[AnyOperatorEvent]:
        """Return the crew's events that are due at mission time ``now_us``."""
        awaited = core.guidance.awaited()
        events: list[AnyOperatorEvent] = []
        while self._script and self._script[0].at_us <= now_us:
            events.append(self._script.pop(0))
        if now_us >= self._present_us:
            self._present_us = now_us + self._heartbeat_us
            events.append(OperatorHeartbeat(now_us, NAME, self._station))
        if awaited.answers and now_us >= self._answers_us:
            self._answers_us = now_us + self._delay_us
            events += [
                ChecklistAnswered(now_us, NAME, self._station, item, True) for item in self._items
            ]
        return [*events, *self._approves(now_us, awaited.plan_hash)]

    def _approves(self, now_us: int, plan_hash: str) -> list[AnyOperatorEvent]:
        if not plan_hash:
            return []
        if plan_hash != self._considered:
            self._considered, self._since_us = plan_hash, now_us
        if now_us - self._since_us < self._delay_us:
            return []
        self._since_us = now_us  # an approval without effect is repeated after ``thinks_s``
        return [Approved(now_us, NAME, self._station, plan_hash)]
