"""Defines the interface of all vehicle clients."""

from typing import Protocol

from autopilot_bridge.items import Items
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import ClientEvent
from autopilot_bridge.vehicle.orders import Dropper
from autopilot_bridge.vehicle.transfer_states import StartItem


class VehicleClient(Protocol):
    """The client of one vehicle: ``NativeClient`` or ``MavsdkClient``.

    ``now_us`` is the link's time in microseconds. Each request returns an id, and the event that
    reports the outcome of the request has the same id.
    """

    @property
    def stack(self) -> Stack | None:
        """The autopilot's stack; None until its first HEARTBEAT."""

    def upload(
        self, items: Items, now_us: int, *, begin: StartItem = "restart", holds_first: bool = False
    ) -> int:
        """Replace the mission.

        Args:
            items: The items without ArduPilot's home.
            now_us: Time in microseconds.
            begin: The item to fly next: ``restart`` means the first item, ``keep`` the item with
                the index of the current item, and a number (from 0) the item with that index.
            holds_first: Hold during the upload if the autopilot would otherwise fly a partly
                overwritten list.

        Returns:
            The ``transfer_id`` of TransferFinished.
        """

    def download(self, now_us: int) -> int:
        """Read the mission; the TransferFinished with the returned id contains the items."""

    def clear(self, now_us: int) -> int:
        """Remove the mission, and return the ``transfer_id`` of TransferFinished."""

    def command(self, name: str, now_us: int, *arguments: float | str) -> int:
        """Execute a command from the table in ``vehicle/orders.py``.

        Args:
            name: The command's key in ``ORDERS``, such as "hold" or "orbit".
            now_us: Time in microseconds.
            arguments: The arguments in the order and units of the table's row.

        Returns:
            The ``command_id`` of CommandFinished.

        Raises:
            BridgeError: No autopilot has connected, the stack has no such command, or an argument
                is out of range.
        """

    def read_parameter(self, name: str, now_us: int) -> int:
        """Read a parameter; the ParametersFinished with the returned id contains its value."""

    def drop(self, dropper: Dropper, now_us: int) -> int:
        """Release one object now, without retries, and return the ``drop_id`` of DropFinished."""

    def next_event(self) -> ClientEvent | None:
        """Remove and return the oldest pending event; None if no event is pending."""
