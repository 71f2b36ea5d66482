"""Contains what all mission transfers use: timing, results, and matching of messages."""

from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message

Outcome = Literal["accepted", "rejected", "unknown", "failed", "superseded", "cancelled"]
# The mission that is on board after a transfer; the words are fixed, so that programs can compare
# them.
Holds = Literal["the new one", "the old one", "a mixture", "one of both", "not known"]
Kind = Literal["mission", "fence", "rally"]
MISSION_TYPES: dict[Kind, int] = {
    "mission": mavlink.MAV_MISSION_TYPE_MISSION,
    "fence": mavlink.MAV_MISSION_TYPE_FENCE,
    "rally": mavlink.MAV_MISSION_TYPE_RALLY,
}

REASONS = {
    mavlink.MAV_MISSION_ERROR: "the autopilot reports an error",
    mavlink.MAV_MISSION_UNSUPPORTED_FRAME: "the frame is not supported",
    mavlink.MAV_MISSION_UNSUPPORTED: "the command is not supported",
    mavlink.MAV_MISSION_NO_SPACE: "the mission is too long for the autopilot",
    mavlink.MAV_MISSION_INVALID: "a parameter is not valid",
    mavlink.MAV_MISSION_INVALID_PARAM5_X: "the latitude is not valid",
    mavlink.MAV_MISSION_INVALID_PARAM6_Y: "the longitude is not valid",
    mavlink.MAV_MISSION_INVALID_PARAM7: "the altitude is not valid",
    mavlink.MAV_MISSION_INVALID_SEQUENCE: "an item was out of sequence",
    mavlink.MAV_MISSION_DENIED: "the autopilot is busy with another ground station",
    mavlink.MAV_MISSION_OPERATION_CANCELLED: "the autopilot cancelled the transfer",
}


@dataclass(frozen=True, slots=True)
class TransferTiming:
    """The timeout for a reply, and the number of retries."""

    timeout_us: int = 1_500_000
    retries: int = 5


@dataclass(frozen=True, slots=True)
class Address:
    """The two ends of a transfer, and the type of the list that is transferred."""

    own: tuple[int, int]
    target: tuple[int, int]
    mission_type: int = 0

    def concerns(self, message: Message) -> bool:
        """Return whether the target sent a message about this type of list to this station."""
        return (
            (message.get_srcSystem(), message.get_srcComponent()) == self.target
            and is_for(message, self.own)
            and message.mission_type == self.mission_type
        )


def is_for(message: Message, own: tuple[int, int]) -> bool:
    """Return whether a message is for this station or for all stations."""
    system, component = own
    return message.target_system in (system, 0) and message.target_component in (component, 0)


@dataclass(frozen=True, slots=True)
class TransferResult:
    """The result of a transfer.

    ``rejected``: the autopilot rejected the transfer; ``code`` is its MAV_MISSION_RESULT, and
    ``seq`` is the last item that the autopilot requested. ``unknown``: all items were sent, but no
    final reply arrived. ``failed``: the transfer was aborted. ``cancelled``: the transfer was
    cancelled on request. ``holds`` states which mission is now on board, and ``items`` contains the
    items of this mission if they were read.
    """

    outcome: Outcome
    reason: str
    code: int | None = None
    seq: int | None = None
    items: tuple[MissionItem, ...] | None = None
    holds: Holds = "not known"


def rejected(code: int, seq: int | None) -> TransferResult:
    """Return the result of a transfer that a MISSION_ACK with an error code has ended."""
    words = REASONS.get(code, "the autopilot rejected the transfer")
    where = "" if seq is None else f" at item {seq}"
    return TransferResult("rejected", f"{words}{where} (MAV_MISSION_RESULT {code})", code, seq)


class Exchange:
    """One part of a transfer; ``result`` is set when this part has ended."""

    def __init__(self, address: Address, timing: TransferTiming) -> None:
        self.result: TransferResult | None = None
        self._address = address
        self._timing = timing
        self._deadline_us = 0

    def cancel(self, cancels_after_us: int, now_us: int) -> list[Message]:
        """End the exchange; no further message is sent."""
        self.result = TransferResult("cancelled", "cancelled")
        return []

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call."""
        return self._deadline_us

    def _is_from_target(self, message: Message) -> bool:
        return (message.get_srcSystem(), message.get_srcComponent()) == self._address.target
