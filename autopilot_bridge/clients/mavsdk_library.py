"""Imports MAVSDK's modules, and converts between MAVSDK's types and those of this package."""

import functools
import json
import logging
from typing import Any, NamedTuple

from autopilot_bridge.items import Items, jumps_moved
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.read_back import same_as_sent
from autopilot_bridge.missions.transfer import Holds, TransferResult
from autopilot_bridge.stacks.stacks import Stack

MAVSDK_IDS = (245, 190)  # system and component ids of MAVSDK's ground stations
ACCEPTED = TransferResult("accepted", "accepted", 0, holds="the new one")


class Library(NamedTuple):
    """The imported MAVSDK modules; the import takes 0.1 s."""

    core: Any
    system: Any
    missions: Any
    direct: Any


@functools.cache
def library() -> Library:
    """Import and return the MAVSDK modules; their log is redirected to Python's logging."""
    import mavsdk
    import mavsdk.asyncio
    import mavsdk.asyncio.plugins.mavlink_direct as direct
    import mavsdk.asyncio.plugins.mission_raw as missions
    from mavsdk.logging import LogLevel, log_subscribe

    def log(level: int, message: str, file: str | None, line: int) -> bool:
        if level >= LogLevel.ERROR:
            logging.getLogger("mavsdk").error("%s", message)
        return True  # with False, MAVSDK would print the line

    log_subscribe(log)
    return Library(mavsdk, mavsdk.asyncio, missions, direct)


def raw_message(message: Message, target: tuple[int, int]) -> Any:
    """Return a message as MAVSDK's raw type."""
    fields = {name: getattr(message, name) for name in message.get_fieldnames()}
    return library().direct.MavlinkMessage(
        message.get_type(), *MAVSDK_IDS, *target, json.dumps(fields)
    )


def raw_items(items: Items, first: int) -> list[Any]:
    """Return items as MAVSDK's raw type; MAVSDK requires that item ``first`` is current."""
    raw_item = library().missions.MissionItem
    return [
        raw_item(
            *(seq, item.frame, item.command, int(seq == first), item.autocontinue),
            *(item.param1, item.param2, item.param3, item.param4),
            x=item.x,
            y=item.y,
            z=item.z,
        )
        for seq, item in enumerate(items)
    ]


def upload_result(
    stack: Stack, hidden: int, sent: Items, verdict: str, read: Items | None
) -> TransferResult:
    """Return the result of an upload, given MAVSDK's ``verdict`` and the items that were ``read``.

    ``read`` is None if the read-back failed. After a TIMEOUT the upload may be complete, because
    only the last reply may have been lost.
    """
    reason = f"MAVSDK: {verdict}"
    may_be_complete = verdict in ("SUCCESS", "TIMEOUT", "PROTOCOL_ERROR", "NO_ANSWER")
    if read is None:
        holds: Holds = "one of both" if stack.atomic_upload else "not known"
        return TransferResult("unknown" if may_be_complete else "rejected", reason, holds=holds)
    pairs = zip(sent[hidden:], read[hidden:], strict=False)
    if len(sent) == len(read) and all(same_as_sent(*pair, stack) for pair in pairs):
        return ACCEPTED
    items = jumps_moved(read[hidden:], -hidden)
    holds = "the old one" if stack.atomic_upload else "a mixture"
    if verdict == "SUCCESS":
        reason = "another mission is on board"
    return TransferResult(
        "failed" if may_be_complete else "rejected", reason, items=items, holds=holds
    )
