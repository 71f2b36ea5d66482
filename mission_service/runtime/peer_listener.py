"""What comes of all that other processes of a formation say."""

from collections.abc import Callable

from mission_service.peer_messages import AnyMessage
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import MissionClock


class PeerListener:
    """Hands on to the service here what ``formation_mqtt`` has heard."""

    def __init__(self, service: Engine, clock: MissionClock, clock_us: Callable[[], int]) -> None:
        self._service = service
        self._clock = clock
        self._clock_us = clock_us

    @property
    def mission_us(self) -> int:
        """Mission time here."""
        return self._clock.now_us

    def passed(self, mission_us: int) -> None:
        """Mission time has come so far elsewhere."""
        self._clock.others_passed(mission_us, self._clock_us())

    def hear(self, message: AnyMessage) -> None:
        """A vehicle flown elsewhere has said something."""
        self.passed(message.at_us)
        self._service.hear(message, self._clock.now_us, self._clock_us())

    def contact(self, there: bool) -> None:
        """Others can be talked to, or no longer."""
        self._service.contact(there, self._clock.now_us, self._clock_us())

    def tell(self, text: str, warning: bool) -> None:
        """A line for the user."""
        self._service.announce("formation", text, "warning" if warning else "info")
