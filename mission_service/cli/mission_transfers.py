"""Transfers missions to and from one autopilot, for the command line."""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.items import Items, Plan, has_position
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.signing import Signing
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.missions.check import adapted, check
from autopilot_bridge.missions.plan_file import WPL_SUFFIXES, write_any
from autopilot_bridge.missions.transfer import MISSION_TYPES, Kind, TransferResult
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import Connected, TransferFinished
from mission_service.errors import MissionServiceError
from mission_service.runtime.clocks import clock_us, wall_us
from mission_service.runtime.link_signing import COMMAND_LINK_ID, key_missing, refusal, signings

Result = TypeVar("Result")
Request = Callable[[NativeClient, int], int]  # starts a transfer; the int is the time in us
# The fence is sent before the mission, because PX4 checks a mission against the fence on board.
KINDS: tuple[Kind, ...] = ("fence", "rally", "mission")


@dataclass(frozen=True, slots=True)
class Line:
    """A link to an autopilot; ``signing_key`` is the key's source, ``warn`` prints a warning."""

    link: str
    timeout_s: float
    tlog: Path | None = None
    signing_key: str | None = None
    warn: Callable[[str], None] = lambda text: None


def upload(plan: Plan, line: Line) -> dict[str, Any]:
    """Replace the autopilot's mission, and its fence or rally points if the plan contains any.

    The flight is not started. Raises MissionServiceError, before anything is sent, for items that
    the autopilot would not fly as planned.
    """

    def requests(stack: Stack) -> list[Request]:
        parts = _parts_for(plan, stack)
        for kind, items in parts.items():
            for problem in check(items, stack, MISSION_TYPES[kind]):
                if problem.kind != "changed":
                    raise MissionServiceError(f"{kind}: {problem}")
        return [_upload_of(kind, items) for kind, items in parts.items()]

    _, results = _run(requests, line)
    counts = {"items": len(plan.mission), "fence": len(plan.fence), "rally": len(plan.rally)}
    return {"result": results[-1].outcome, **counts, "holds": results[-1].holds}


def _parts_for(plan: Plan, stack: Stack) -> dict[Kind, Items]:
    """Return the parts of a plan in upload order, with the mission adapted to the stack."""
    parts: dict[Kind, Items] = {
        "fence": plan.fence,
        "rally": plan.rally,
        "mission": adapted(plan.mission, stack),
    }
    return {kind: items for kind, items in parts.items() if items or kind == "mission"}


def _upload_of(kind: Kind, items: Items) -> Request:
    return lambda client, now_us: client.upload(items, now_us, kind, check=True, holds_first=True)


def download(output: Path, line: Line) -> dict[str, Any]:
    """Download mission, fence and rally points to a .plan file, or the mission to a WPL file."""
    kinds = KINDS[-1:] if output.suffix.lower() in WPL_SUFFIXES else KINDS
    client, results = _run(
        lambda _: [partial(NativeClient.download, kind=kind) for kind in kinds], line
    )
    read = {kind: result.items or () for kind, result in zip(kinds, results, strict=True)}
    items = read["mission"]
    first = next((item for item in items if has_position(item.command)), None)
    home = (first.x / 1e7, first.y / 1e7, first.z) if first else None
    plan = Plan(items, read.get("fence", ()), read.get("rally", ()), home)
    write_any(output, plan, client.stack)
    counts = {"items": len(items), "fence": len(plan.fence), "rally": len(plan.rally)}
    return {"result": results[-1].outcome, **counts, "file": str(output)}


def clear(line: Line, everything: bool = False) -> dict[str, Any]:
    """Remove the autopilot's mission and, with ``everything``, its fence and rally points."""
    kinds = KINDS if everything else KINDS[-1:]
    _, results = _run(lambda _: [partial(NativeClient.clear, kind=kind) for kind in kinds], line)
    return {"result": results[-1].outcome}


def _run(
    requests: Callable[[Stack], list[Request]], line: Line
) -> tuple[NativeClient, list[TransferResult]]:
    """Run transfers, one after the other, with the first autopilot found on the link.

    Raises MissionServiceError if the autopilot does not accept all transfers.
    """
    client = NativeClient(target_system=None)
    with connected(client, line, line.signing_key) as (connection, _):
        results = within(line, client, connection, _transfers(client, requests, line, connection))
    return client, results


@contextlib.contextmanager
def connected(
    client: NativeClient, line: Line, signing_key: str | None, *others: str | None
) -> Iterator[tuple[Connection, dict[str | None, Signing]]]:
    """Prepare a connection with frames signed with ``signing_key``, and a ``Signing`` for each key.

    The caller opens the connection. On exit, the .tlog and the signing timestamp file are closed.
    """
    with contextlib.ExitStack() as stack:
        tlog = stack.enter_context(Tlog(line.tlog, wall_us, line.warn)) if line.tlog else None
        signing_of = stack.enter_context(signings((signing_key, *others), wall_us, line.warn))
        signing = signing_of.get(signing_key)
        yield (
            Connection(line.link, client, clock_us, 1.0, tlog, signing, COMMAND_LINK_ID),
            signing_of,
        )


def within(
    line: Line, client: NativeClient, connection: Connection, work: Coroutine[Any, Any, Result]
) -> Result:
    """Run ``work`` within the line's timeout and return its result.

    Raises MissionServiceError when the timeout has passed.
    """
    try:
        return asyncio.run(asyncio.wait_for(work, line.timeout_s))
    except TimeoutError:
        raise MissionServiceError(_timeout_error(line, client, connection)) from None


def _timeout_error(line: Line, client: NativeClient, connection: Connection) -> str:
    """Return the error message for a transfer that has timed out."""
    refused = refusal(connection.ports[0].counts, line.link)
    if client.stack is None and refused:
        return f"{line.link}: no autopilot was accepted within {line.timeout_s:g} s: {refused}"
    problem = "the transfer did not end" if client.stack else "no autopilot was found"
    remedy = "check that the autopilot is running and that this is its port"
    if connection.ports[0].receives_signed:
        remedy = key_missing(line.link)
    return f"{line.link}: {problem} within {line.timeout_s:g} s; {remedy}"


async def _transfers(
    client: NativeClient,
    requests: Callable[[Stack], list[Request]],
    line: Line,
    connection: Connection,
) -> list[TransferResult]:
    waiting: list[Request] = []
    results: list[TransferResult] = []
    async with connection:
        while True:
            await connection.wait()
            while (event := client.next_event()) is not None:
                match event:
                    case Connected():
                        waiting = requests(event.stack)
                    case TransferFinished() if event.result.outcome != "accepted":
                        result = event.result
                        words = f"{event.kind} {event.action} {result.outcome}: {result.reason}"
                        raise MissionServiceError(f"{line.link}: {words}")
                    case TransferFinished():
                        results.append(event.result)
                        if not waiting:
                            return results
                    case _:
                        continue
                waiting.pop(0)(client, clock_us())
                connection.flush()
