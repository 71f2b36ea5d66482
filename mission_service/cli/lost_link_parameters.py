"""Shows and sets the parameters of one autopilot that determine its reaction to a lost link."""

import json
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.link_loss import (
    PHASES,
    Change,
    Wanted,
    changes_for,
    link_loss_of,
    missing,
    parameters_of,
    phase_in_words,
)
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import Connected, ParametersFinished
from autopilot_bridge.vehicle.parameters import ParametersResult
from firemodel.outputs.whole_file import write_whole
from mission_service.cli.mission_transfers import Line, connected, within
from mission_service.errors import MissionServiceError
from mission_service.runtime.clocks import clock_us

Work = Callable[[], Coroutine[Any, Any, dict[str, Any]]]
TIMING = TransferTiming(retries=3)  # an autopilot does not answer for a parameter that it lacks


class OldValues(msgspec.Struct, forbid_unknown_fields=True):
    """The content of the file that ``set`` writes: the values before the change."""

    system_id: int
    stack: str  # such as "px4 plane"
    parameters: dict[str, float]


def show(line: Line, system_id: int | None, station_id: int) -> dict[str, Any]:
    """Return a vehicle's lost-link reaction, and the parameters that determine it."""
    session = _Session(line, system_id, station_id)
    return session.result_of(session.show)


def set_wanted(
    line: Line, system_id: int | None, station_id: int, wanted: Wanted, old: Path
) -> dict[str, Any]:
    """Set the parameters so that the vehicle reacts as ``wanted``, and read them back.

    The values before the change are written to ``old`` before the first parameter is set. Raises
    MissionServiceError if the vehicle is armed, the file exists, or a value is not accepted.
    """
    if old.exists():
        raise MissionServiceError(
            f"{old}: already exists, and may contain the values before an earlier change; restore "
            "them (--restore), or choose another path with -o"
        )
    session = _Session(line, system_id, station_id)
    return session.result_of(partial(session.set_wanted, wanted, old))


def restore(line: Line, system_id: int | None, station_id: int, old: Path) -> dict[str, Any]:
    """Set the parameters to the values in the file ``old``, and read them back."""
    try:
        values = msgspec.json.decode(old.read_bytes(), type=OldValues)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MissionServiceError(f"{old}: cannot be read: {reason}") from None
    system_id = values.system_id if system_id is None else system_id
    session = _Session(line, system_id, station_id)
    return session.result_of(partial(session.restore, values, old))


class _Session:
    """A parameter exchange with one vehicle."""

    def __init__(self, line: Line, system_id: int | None, station_id: int) -> None:
        self._line = line
        self._station_id = station_id
        self._client = NativeClient(target_system=system_id, timing=TIMING)
        self._connection: Connection

    def result_of(self, work: Work) -> dict[str, Any]:
        """Run ``work`` on an open connection, within the line's timeout."""
        with connected(self._client, self._line, self._line.signing_key) as (connection, _):
            self._connection = connection
            return within(self._line, self._client, connection, self._opened(work))

    async def _opened(self, work: Work) -> dict[str, Any]:
        async with self._connection:
            while True:
                await self._connection.wait()
                while (event := self._client.next_event()) is not None:
                    if isinstance(event, Connected):
                        return await work()

    async def show(self) -> dict[str, Any]:
        return self._shown(await self._read())

    async def set_wanted(self, wanted: Wanted, old: Path) -> dict[str, Any]:
        values = await self._read()
        changes = changes_for(self._stack, wanted, values, self._station_id)
        result = self._shown(values)
        if changes:
            system = self._refuse_armed()
            before = {change.name: change.before for change in changes}
            kept = OldValues(system, _name(self._stack), before)
            write_whole(old, json.dumps(msgspec.to_builtins(kept)) + "\n")
            result = await self._set(changes)
            after = link_loss_of(self._stack, result["parameters"], self._station_id)
            if not after.satisfies(wanted):
                raise MissionServiceError(
                    f"{self._line.link}: after the change, the vehicle still "
                    f"{result['reaction']}; restore the old values (--restore {old})"
                )
            result["old_values"] = str(old)
        return {"changed": [str(change) for change in changes], **result}

    async def restore(self, kept: OldValues, old: Path) -> dict[str, Any]:
        values = await self._read()
        system, name = self._client.target_system, _name(self._stack)
        if (kept.system_id, kept.stack) != (system, name):
            raise MissionServiceError(
                f"{old}: contains values of a {kept.stack} with system id {kept.system_id}, "
                f"but {self._line.link} leads to a {name} with system id {system}"
            )
        absent = sorted(set(kept.parameters) - set(values))
        if absent:
            raise MissionServiceError(f"{old}: {', '.join(absent)} could not be read")
        changes = [
            Change(each, values[each], value)
            for each, value in sorted(kept.parameters.items())
            if values[each] != value
        ]
        result = self._shown(values)
        if changes:
            self._refuse_armed()
            result = await self._set(changes)
        return {"changed": [str(change) for change in changes], **result}

    @property
    def _stack(self) -> Stack:
        assert self._client.stack is not None
        return self._client.stack

    def _refuse_armed(self) -> int:
        """Return the vehicle's system id. Raises MissionServiceError for an armed vehicle."""
        if self._client.armed:
            raise MissionServiceError(
                f"{self._line.link}: the vehicle is armed; failsafe parameters are changed only "
                "while it is disarmed"
            )
        assert self._client.target_system is not None
        return self._client.target_system

    async def _read(self) -> dict[str, float]:
        """Return the values of the parameters that the autopilot has."""
        values = {}
        for name in parameters_of(self._stack):
            result = await self._finished(self._client.read_parameter(name, clock_us()))
            values.update({each.name: each.value for each in result.parameters})
        absent = missing(self._stack, values)
        if absent:
            raise MissionServiceError(
                f"{self._line.link}: no reply for {', '.join(absent)}; the firmware may name the "
                "parameters differently, or the link is too slow"
            )
        return values

    async def _set(self, changes: Sequence[Change]) -> dict[str, Any]:
        """Set parameters in order, and return the reaction after reading all values back."""
        for change in changes:
            self._refuse_armed()
            request = self._client.set_parameter(change.name, change.after, clock_us())
            result = await self._finished(request)
            if result.outcome != "accepted":
                raise MissionServiceError(f"{self._line.link}: {change}: {result.reason}")
        values = await self._read()
        for change in changes:
            if values[change.name] != change.after:
                raise MissionServiceError(
                    f"{self._line.link}: {change.name} reads back as {values[change.name]:g} "
                    f"instead of {change.after:g}"
                )
        return self._shown(values)

    async def _finished(self, request_id: int) -> ParametersResult:
        self._connection.flush()
        while True:
            while (event := self._client.next_event()) is not None:
                if isinstance(event, ParametersFinished) and event.request_id == request_id:
                    return event.result
            await self._connection.wait()

    def _shown(self, values: dict[str, float]) -> dict[str, Any]:
        loss = link_loss_of(self._stack, values, self._station_id)
        return {
            "stack": _name(self._stack),
            "reaction": str(loss),
            **{phase: phase_in_words(loss.reactions[phase]) for phase in PHASES},
            "return_height_m": loss.return_height_m,
            "fence": loss.fence,
            "parameters": values,
            "warnings": list(loss.warnings),
        }


def _name(stack: Stack) -> str:
    return f"{stack.name} {stack.kind}"
