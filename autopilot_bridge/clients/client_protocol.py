"""What a vehicle's client does, whichever way it speaks with the autopilot."""

from typing import Protocol

from autopilot_bridge.items import Items
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import ClientEvent
from autopilot_bridge.vehicle.orders import Dropper
from autopilot_bridge.vehicle.transfer_states import StartItem


class VehicleClient(Protocol):
    """One vehicle: ``NativeClient``, or ``MavsdkClient``. What comes of it are its events."""

    @property
    def stack(self) -> Stack | None:
        """The autopilot, once it was heard."""

    def upload(
        self, items: Items, now_us: int, *, begin: StartItem = "restart", holds_first: bool = False
    ) -> int:
        """Replace the mission; TransferFinished with the id tells how it went."""

    def download(self, now_us: int) -> int:
        """Read the mission."""

    def clear(self, now_us: int) -> int:
        """Remove the mission."""

    def command(self, name: str, now_us: int, *arguments: float | str) -> int:
        """Carry out a command of ``orders.ORDERS``; CommandFinished has the outcome."""

    def drop(self, dropper: Dropper, now_us: int) -> int:
        """Let go of one thing now; DropFinished with the id tells how it went."""

    def next_event(self) -> ClientEvent | None:
        """The oldest event not handed out yet."""
