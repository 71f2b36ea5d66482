"""Passes messages from the other processes of a formation to the engine."""

from collections.abc import Callable

from mission_service.peer_messages import AnyMessage
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import MissionClock


class PeerListener:
    """The listener that passes messages from ``peer_exchange`` to the engine of this process."""

    def __init__(self, service: Engine, clock: MissionClock, clock_us: Callable[[], int]) -> None:
        self._service = service
        self._clock = clock
        self._clock_us = clock_us

    @property
    def mission_us(self) -> int:
        """The mission time of this process."""
        return self._clock.now_us

    def passed(self, mission_us: int) -> None:
        """Advance the clock to the mission time of another process."""
        self._clock.others_passed(mission_us, self._clock_us())

    def on_message(self, message: AnyMessage) -> None:
        """Handle a message from a vehicle that another process controls."""
        self.passed(message.at_us)
        self._service.on_peer_message(message, self._clock.now_us, self._clock_us())

    def on_link(self, connected: bool) -> None:
        """Handle a change of the connection to the other processes."""
        self._service.on_peer_link(connected, self._clock.now_us, self._clock_us())

    def announce(self, text: str, warning: bool) -> None:
        """Announce a text to the operators."""
        self._service.announce("formation", text, "warning" if warning else "info")
