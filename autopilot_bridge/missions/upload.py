"""Uploads a mission (MAVLink mission protocol, "Upload a Mission to the Vehicle").

- idle --start--> counted --request--> sending --last item sent--> sending
- counted: MISSION_COUNT is repeated on timeout
- sending: items are sent on request. If the autopilot accepts early items, a few are sent before
  they are requested. A repeated request means that a message was lost; from then on each item is
  sent only on request
- any --MISSION_ACK--> ended
- counted --MISSION_ERROR--> counted: MISSION_COUNT is repeated; ended after the last retry
- sending --MISSION_ERROR--> sending; ended after a timeout. The error may be the reply to a
  duplicate (PX4: of MISSION_COUNT, or of an item of the previous transfer; ArduPilot: of the last
  item), or PX4 may still be busy with the previous transfer; in these cases the transfer continues
  or has succeeded
- sending, all sent, no MISSION_ACK --MISSION_CURRENT with the plan's id--> ended: the plan is on
  board
- any --cancel--> cancelling --OPERATION_CANCELLED or timeout--> ended
- cancelling: no further item is sent; PX4 ends the transfer at once, ArduPilot after 8 s
- counted or sending --another link of the vehicle--> counted: the upload begins again. PX4 rejects
  it until the transfer over the first link has timed out (5 s)
"""

from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message, item_message
from autopilot_bridge.missions.transfer import (
    Address,
    Exchange,
    TransferResult,
    TransferTiming,
    rejected,
)

# After a change of the link, rejections by a busy autopilot are ignored for this time.
BUSY_FOR_US = 8_000_000
BUSY = (mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_DENIED)
# Fields of MISSION_CURRENT with the plan's id, by MAV_MISSION_TYPE.
IDS = ("mission_id", "fence_id", "rally_points_id")


class MissionUpload(Exchange):
    """The upload of a list; ``result`` is set when the upload has ended."""

    def __init__(
        self,
        address: Address,
        items: tuple[MissionItem, ...],
        first: int,
        timing: TransferTiming,
        ahead: int = 0,
        plan_id: int | None = None,
    ) -> None:
        """Create the upload of ``items``; ``first`` is the index of the first item to fly.

        The items are sent unchanged, up to ``ahead`` of them before they are requested. ``plan_id``
        is the expected id of the plan (see ``plan_id.py``). If the acknowledgement is lost, a
        report of this id proves that the upload has succeeded.
        """
        super().__init__(address, timing)
        self.items = items
        self.touched = False  # True if the upload may have changed the mission on board
        self._first = first
        self._state: Literal["counted", "sending", "cancelling"] = "counted"
        self._tries = 0
        self._requested_seq: int | None = None
        self._sent = -1  # the last item sent
        self._ahead = ahead
        self._plan_id = plan_id
        self._reported_id: int | None = None  # id in MISSION_CURRENT since all items were sent
        self._all_sent = False
        self._possible_refusal: TransferResult | None = None  # maybe the reply to a duplicate
        self._busy_until_us = 0

    def start(self, now_us: int) -> list[Message]:
        """Send MISSION_COUNT."""
        self._deadline_us = now_us + self._timing.timeout_us
        return [self._count()]

    def begin_again(self, now_us: int) -> list[Message]:
        """Begin again over another link of the vehicle; a cancellation continues."""
        if self._state == "cancelling":
            return []
        self._state, self._tries, self._requested_seq, self._sent = "counted", 0, None, -1
        self._reported_id = self._possible_refusal = None
        self._all_sent = False
        self._ahead = 0  # late requests over the first link may arrive
        self._busy_until_us = now_us + BUSY_FOR_US
        return self.start(now_us)

    def _count(self) -> Message:
        return mavlink.MAVLink_mission_count_message(
            *self._address.target, len(self.items), self._address.mission_type
        )

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a message from the autopilot, and return the replies."""
        kind = message.get_type()
        if kind == "MISSION_CURRENT" and self._all_sent:
            if self._is_from_target(message):
                self._reported_id = getattr(message, IDS[self._address.mission_type])
            return []
        if kind not in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"):
            return []
        if not self._address.concerns(message):
            return []
        if kind == "MISSION_ACK":
            self._acknowledged(message.type, now_us)
            return []
        return self._requested(message.seq, now_us)

    def _requested(self, seq: int, now_us: int) -> list[Message]:
        self.touched = True
        if not 0 <= seq < len(self.items) or self._state == "cancelling":
            return []
        self._state = "sending"
        self._tries = 0
        self._possible_refusal = None
        before = -1 if self._requested_seq is None else self._requested_seq
        if not before < seq <= self._sent + 1:  # requested again
            self._ahead = 0
            self._sent = seq - 1
        self._requested_seq = seq
        self._deadline_us = now_us + self._timing.timeout_us
        first, self._sent = self._sent + 1, max(self._sent, min(seq + self._ahead, self._last))
        self._all_sent |= self._sent == self._last
        return [self._item(number) for number in range(first, self._sent + 1)]

    @property
    def _last(self) -> int:
        return len(self.items) - 1

    def _item(self, seq: int) -> Message:
        current = 1 if seq == self._first else 0
        item, mission_type = self.items[seq], self._address.mission_type
        return item_message(self._address.target, seq, item, current, mission_type)

    def cancel(self, cancels_after_us: int, now_us: int) -> list[Message]:
        """Send a cancellation; the upload ends at once if ``cancels_after_us`` is 0."""
        if not cancels_after_us:
            self.result = TransferResult("cancelled", "cancelled")
        # ArduPilot cuts its list when it receives MISSION_COUNT; its requests may be lost.
        self.touched |= cancels_after_us > 0
        self._state = "cancelling"
        self._deadline_us = now_us + cancels_after_us + self._timing.timeout_us
        code = mavlink.MAV_MISSION_OPERATION_CANCELLED
        return [
            mavlink.MAVLink_mission_ack_message(
                *self._address.target, code, self._address.mission_type
            )
        ]

    def _acknowledged(self, code: int, now_us: int) -> None:
        if code == mavlink.MAV_MISSION_INVALID_SEQUENCE:
            return  # ArduPilot's reply to a duplicate; the transfer continues
        if self._state == "counted" and code in BUSY and now_us < self._busy_until_us:
            return  # MISSION_COUNT is repeated on timeout
        if self._state == "cancelling" and code == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            self.result = TransferResult("cancelled", "cancelled", code, self._requested_seq)
            return
        if code == mavlink.MAV_MISSION_ERROR and self._state != "cancelling":
            self._possible_refusal = rejected(code, self._requested_seq)
            self._deadline_us = now_us + self._timing.timeout_us
        elif code != mavlink.MAV_MISSION_ACCEPTED:
            self.result = rejected(code, self._requested_seq)
        elif self._all_sent or not self.items:
            self.result = TransferResult("accepted", "accepted", code, items=self.items)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat MISSION_COUNT, continue to wait, or fail after the last retry."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        if self._state == "cancelling":
            self.result = TransferResult(
                "cancelled", "cancelled; the autopilot has stopped replying"
            )
            return []
        may_repeat = self._state == "counted" and self._tries < self._timing.retries
        if self._possible_refusal is not None and not may_repeat:
            self.touched |= self._tries > 0  # a reply to a repeated MISSION_COUNT may be lost
            self.result = self._possible_refusal
            return []
        if self._all_sent and self._plan_id and self._reported_id == self._plan_id:
            words = (
                "accepted: the acknowledgement was lost, but the autopilot reports the plan's id"
            )
            self.result = TransferResult("accepted", words, items=self.items)
            return []
        self._tries += 1
        self._deadline_us = now_us + self._timing.timeout_us
        if self._tries <= self._timing.retries:
            return [self._count()] if self._state == "counted" else []
        self.touched = True  # a lost MISSION_COUNT and a lost reply to it are indistinguishable
        seq = self._requested_seq
        if self._all_sent:
            reason = "all items were sent, but no acknowledgement arrived"
            self.result = TransferResult("unknown", reason)
        elif self._state == "counted":
            reason = "the autopilot did not reply to MISSION_COUNT"
            self.result = TransferResult("failed", reason)
        else:
            reason = f"the autopilot stopped requesting items after item {seq}"
            self.result = TransferResult("failed", reason, seq=seq)
        return []
