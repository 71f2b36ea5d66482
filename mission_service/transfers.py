"""Missions to and from one autopilot, for the command line: one transfer, then done."""

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from autopilot_bridge.check import adapted, check
from autopilot_bridge.client import VehicleClient
from autopilot_bridge.client_events import Connected, TransferFinished
from autopilot_bridge.connection import Connection
from autopilot_bridge.items import MissionItem, Plan, has_position
from autopilot_bridge.planfile import write_any
from autopilot_bridge.tlog import Tlog
from autopilot_bridge.transfer import TransferResult
from mission_service.daemon import clock_us, wall_us
from mission_service.errors import MissionServiceError

Begin = Callable[[VehicleClient, int], int]


def upload(
    items: tuple[MissionItem, ...], link: str, timeout_s: float, tlog: Path | None = None
) -> dict[str, Any]:
    """Replace the autopilot's mission; the flight is not started.

    Raises MissionServiceError, before anything is sent, for items its autopilot would not fly as
    they are meant.
    """

    def begin(client: VehicleClient, now_us: int) -> int:
        assert client.stack is not None
        fitted = adapted(items, client.stack)
        for problem in check(fitted, client.stack):
            if problem.kind != "changed":
                raise MissionServiceError(str(problem))
        return client.upload(fitted, now_us, check=True, holds_first=True)

    _, result = _run(begin, link, timeout_s, tlog)
    return {"result": result.outcome, "items": len(items), "holds": result.holds}


def download(output: Path, link: str, timeout_s: float, tlog: Path | None = None) -> dict[str, Any]:
    """Write the autopilot's mission to a .plan or QGC WPL file."""
    client, result = _run(VehicleClient.download, link, timeout_s, tlog)
    items = result.items or ()
    first = next((item for item in items if has_position(item.command)), None)
    home = (first.x / 1e7, first.y / 1e7, first.z) if first else None
    write_any(output, Plan(items, home=home), client.stack)
    return {"result": result.outcome, "items": len(items), "file": str(output)}


def clear(link: str, timeout_s: float, tlog: Path | None = None) -> dict[str, Any]:
    """Remove the autopilot's mission."""
    _, result = _run(VehicleClient.clear, link, timeout_s, tlog)
    return {"result": result.outcome}


def _run(
    begin: Begin, link: str, timeout_s: float, tlog_path: Path | None
) -> tuple[VehicleClient, TransferResult]:
    client = VehicleClient(target_system=None)
    try:
        with contextlib.ExitStack() as stack:
            tlog = stack.enter_context(Tlog(tlog_path, wall_us)) if tlog_path else None
            transfer = _transfer(client, begin, link, tlog)
            result = asyncio.run(asyncio.wait_for(transfer, timeout_s))
    except TimeoutError:
        heard = "the transfer did not end" if client.stack else "no autopilot was heard"
        raise MissionServiceError(
            f"{link}: {heard} within {timeout_s:g} s; is it running, and is this its port?"
        ) from None
    if result.outcome != "accepted":
        raise MissionServiceError(f"{link}: {result.outcome}: {result.reason}")
    return client, result


async def _transfer(
    client: VehicleClient, begin: Begin, link: str, tlog: Tlog | None
) -> TransferResult:
    async with Connection(link, client, clock_us, tlog=tlog) as connection:
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
