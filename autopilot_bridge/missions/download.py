"""Downloads and clears missions using the MAVLink mission protocol.

list requested --MISSION_COUNT--> item requested --item--> item requested
item requested --last item--> ended (MISSION_ACK sent)
item requested --no item for a longer time--> list requested
list requested --MISSION_ERROR or _INVALID_SEQUENCE--> list requested (first request with an error)
list requested --the same error after a repeated request--> ended

Every request is repeated on timeout. The first error may belong to the preceding upload: if the
round trip takes more than 1 s, ArduPilot requests items twice and rejects the second copy of the
last item.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message, item_of
from autopilot_bridge.missions.transfer import (
    Address,
    Exchange,
    TransferResult,
    TransferTiming,
    rejected,
)

# Additional retries for each item. With 20 % loss in each direction a request and its reply arrive
# with probability 0.64, so some downloads of fifty items would fail without these retries.
MORE_RETRIES = 2
# PX4 ends a download after 5 s without a message and then ignores requests for its items. The list
# is therefore requested again after the first of these times without an item, and once more after
# the second. On a link that loses frames, items are rarely missing for so long.
BEGINS_AGAIN_AFTER_US = (9_000_000, 15_000_000)
MAY_BE_LATE = (mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_INVALID_SEQUENCE)


class RequestRepeater(Exchange):
    """An exchange that repeats its last request until a reply arrives or no retry is left."""

    def __init__(self, address: Address, timing: TransferTiming) -> None:
        super().__init__(address, timing)
        self._tries = 0
        self._request: Message = None

    def _send_request(self, request: Message, now_us: int) -> list[Message]:
        self._request = request
        self._tries = 0
        self._deadline_us = now_us + self._timing.timeout_us
        return [request]

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the request, or fail after the last retry."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        self._tries += 1
        self._deadline_us = now_us + self._timing.timeout_us
        if self._tries <= MORE_RETRIES * self._timing.retries:
            return [self._request]
        name = self._request.get_type()
        self.result = TransferResult("failed", f"the autopilot did not reply to {name}")
        return []


class MissionDownload(RequestRepeater):
    """The download of a list of items; the result contains the items."""

    def __init__(self, address: Address, timing: TransferTiming) -> None:
        super().__init__(address, timing)
        self._count: int | None = None
        self._items: list[MissionItem] = []
        self._restarts = 0
        self._error_on_try: int | None = None  # the first request that an error followed

    def start(self, now_us: int) -> list[Message]:
        """Request the number of items."""
        return self._send_request(
            mavlink.MAVLink_mission_request_list_message(
                *self._address.target, self._address.mission_type
            ),
            now_us,
        )

    def begin_again(self, now_us: int) -> list[Message]:
        """Request the list again, for example over another link of the vehicle."""
        self._count = self._error_on_try = None
        self._items.clear()
        return self.start(now_us)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the request, begin again, or fail after the last retry."""
        if self._may_have_ended(now_us):
            self._restarts += 1
            return self.begin_again(now_us)
        return super().handle_timer(now_us)

    def _may_have_ended(self, now_us: int) -> bool:
        """Return whether the autopilot may have ended the download, because no item arrives."""
        if self.result is not None or self._count is None or now_us < self._deadline_us:
            return False
        silent_us = (self._tries + 1) * self._timing.timeout_us
        return any(silent_us >= limit_us for limit_us in BEGINS_AGAIN_AFTER_US[self._restarts :])

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a count or an item, and return the next request."""
        kind = message.get_type()
        if kind not in ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"):
            return []
        if not self._address.concerns(message):
            return []
        if kind == "MISSION_ACK":
            self._acknowledged(message.type)
            return []
        if kind == "MISSION_COUNT" and self._count is None:
            self._count = message.count
        elif kind == "MISSION_ITEM_INT" and message.seq == len(self._items) and self._count:
            self._items.append(item_of(message))
        else:
            return []
        return self._next(now_us)

    def _acknowledged(self, code: int) -> None:
        if code == mavlink.MAV_MISSION_ACCEPTED:
            return
        if self._count is None and code in MAY_BE_LATE:
            if self._error_on_try is None:
                self._error_on_try = self._tries
            if self._error_on_try == self._tries:
                return  # the request is repeated on timeout
        self.result = rejected(code, None)

    def _next(self, now_us: int) -> list[Message]:
        if len(self._items) == self._count:
            items = tuple(self._items)
            self.result = TransferResult("accepted", f"{len(items)} items", items=items)
            return [
                mavlink.MAVLink_mission_ack_message(
                    *self._address.target, mavlink.MAV_MISSION_ACCEPTED, self._address.mission_type
                )
            ]
        return self._send_request(
            mavlink.MAVLink_mission_request_int_message(
                *self._address.target, len(self._items), self._address.mission_type
            ),
            now_us,
        )


class MissionClear(RequestRepeater):
    """The removal of the mission on board."""

    def start(self, now_us: int) -> list[Message]:
        """Request the removal."""
        return self._send_request(
            mavlink.MAVLink_mission_clear_all_message(
                *self._address.target, self._address.mission_type
            ),
            now_us,
        )

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process the acknowledgement, which ends the exchange."""
        if message.get_type() == "MISSION_ACK" and self._address.concerns(message):
            if message.type == mavlink.MAV_MISSION_ACCEPTED:
                self.result = TransferResult("accepted", "cleared", message.type)
            else:
                self.result = rejected(message.type, None)
        return []
