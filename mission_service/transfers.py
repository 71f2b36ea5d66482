"""Missions to and from one autopilot, for the command line: one transfer, then done."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from autopilot_bridge.client import VehicleClient
from autopilot_bridge.client_events import Connected, TransferFinished
from autopilot_bridge.connection import Connection
from autopilot_bridge.items import MissionItem, Plan, has_position
from autopilot_bridge.planfile import write_any
from autopilot_bridge.transfer import TransferResult
from mission_service.daemon import clock_us
from mission_service.errors import MissionServiceError

Begin = Callable[[VehicleClient, int], int]


def upload(items: tuple[MissionItem, ...], link: str, timeout_s: float) -> dict[str, Any]:
    """Replace the autopilot's mission; the flight is not started."""
    _, result = _run(lambda client, now_us: client.upload(items, now_us), link, timeout_s)
    return {"result": result.outcome, "items": len(items)}


def download(output: Path, link: str, timeout_s: float) -> dict[str, Any]:
    """Write the autopilot's mission to a .plan or QGC WPL file."""
    client, result = _run(VehicleClient.download, link, timeout_s)
    items = result.items or ()
    first = next((item for item in items if has_position(item.command)), None)
    home = (first.x / 1e7, first.y / 1e7, first.z) if first else None
    write_any(output, Plan(items, home=home), client.stack)
    return {"result": result.outcome, "items": len(items), "file": str(output)}


def clear(link: str, timeout_s: float) -> dict[str, Any]:
    """Remove the autopilot's mission."""
    _, result = _run(VehicleClient.clear, link, timeout_s)
    return {"result": result.outcome}


def _run(begin: Begin, link: str, timeout_s: float) -> tuple[VehicleClient, TransferResult]:
    client = VehicleClient(target_system=None)
    try:
        result = asyncio.run(asyncio.wait_for(_transfer(client, begin, link), timeout_s))
    except TimeoutError:
        heard = "the transfer did not end" if client.stack else "no autopilot was heard"
        raise MissionServiceError(
            f"{link}: {heard} within {timeout_s:g} s; is it running, and is this its port?"
        ) from None
    if result.outcome != "accepted":
        raise MissionServiceError(f"{link}: {result.outcome}: {result.reason}")
    return client, result


async def _transfer(client: VehicleClient, begin: Begin, link: str) -> TransferResult:
    async with Connection(link, client, clock_us) as connection:
        while True:
            await connection.wait()
            while (event := client.next_event()) is not None:
                match event:
                    case Connected():
                        begin(client, clock_us())
                        connection.flush()
                    case TransferFinished():
                        return event.result
                    case _:
                        pass
