"""Transfers missions through MAVSDK, with the additional steps that real autopilots require.

A mission is checked before its upload, read back after the upload, and started by commanding an
item.
"""

from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any, Literal

from autopilot_bridge.clients.mavsdk_commands import REPLY_TIMEOUT_S, MavsdkCommands
from autopilot_bridge.clients.mavsdk_library import (
    ACCEPTED,
    MAVSDK_IDS,
    library,
    raw_items,
    raw_message,
    upload_result,
)
from autopilot_bridge.clients.mavsdk_system import NO_ANSWER, MavsdkSystem
from autopilot_bridge.items import Items, jumps_moved
from autopilot_bridge.links.codec import Message, item_of
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.plan_id import mission_id_of
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.mission_activation import MissionActivation, Onboard
from autopilot_bridge.vehicle.monitor import VehicleMonitor
from autopilot_bridge.vehicle.transfer_queue import LAST_NAV
from autopilot_bridge.vehicle.transfer_states import StartItem


@dataclass
class Job:
    """A transfer that was requested."""

    transfer_id: int
    action: Literal["upload", "download", "clear"]
    items: Items = ()
    begin: StartItem = "restart"
    holds_first: bool = False


class MavsdkTransfers:
    """Uploads, reads and removes the mission of one vehicle, one transfer at a time."""

    def __init__(
        self,
        system: MavsdkSystem,
        commands: MavsdkCommands,
        monitor: VehicleMonitor,
        target: tuple[int, int],
        clock: Callable[[], int],
    ) -> None:
        self._system = system
        self._commands = commands
        self._monitor = monitor
        self._target = target
        self._clock = clock
        self._begin: MissionActivation | None = None  # the start that is in progress

    def receive(self, message: Message, now_us: int) -> None:
        """Process a message, such as the acknowledgement of a mission start."""
        if self._begin is not None:
            self._begin.receive(message, now_us)

    def stop_start(self, why: str) -> None:
        """Stop the mission start that is in progress, if any: send no further command."""
        if self._begin is not None:
            self._begin.stop_commands(why)

    async def transfer(self, job: Job, stack: Stack) -> TransferResult:
        if job.action == "download":
            read, reason = await self._read()
            if read is None:
                return TransferResult("failed", reason)
            hidden = self._monitor.hidden_items
            return TransferResult(
                "accepted", "read", items=jumps_moved(read[hidden:], -hidden), holds="not known"
            )
        if job.action == "clear" or not job.items:
            return await self._clear(stack)
        return await self._upload(job, stack)

    async def _clear(self, stack: Stack) -> TransferResult:
        idle = not stack.keeps_target or await self._system.until(
            lambda: not self._monitor.in_mission, REPLY_TIMEOUT_S
        )
        if not idle:
            # MAVSDK would truncate the list and report success, and the vehicle would fly on.
            reason = (
                "the vehicle is flying its mission and would continue without it; command a hold "
                "first"
            )
            return TransferResult("rejected", reason, holds="the old one")
        verdict = await self._send_request(self._system.missions.clear_mission())
        read, reason = await self._read()
        if read is None:
            return TransferResult("unknown", f"{verdict}; the read-back failed: {reason}")
        if len(read) > self._monitor.hidden_items:
            return TransferResult("rejected", f"the mission is still on board ({verdict})")
        return ACCEPTED

    async def _upload(self, job: Job, stack: Stack) -> TransferResult:
        bad = next((each for each in check(job.items, stack) if each.kind == "refused"), None)
        if bad is not None:
            return TransferResult("rejected", str(bad), seq=bad.index, holds="the old one")
        monitor, hidden = self._monitor, self._monitor.hidden_items
        first = self._first(job)
        paused = job.holds_first and monitor.in_mission and not stack.atomic_upload
        before, overrides = (
            Onboard(None, monitor.plan_id, monitor.unfit),
            len(self._commands.overrides),
        )
        if paused:
            held, reason = await self._commands.change_mode(
                stack, stack.mission_mode, stack.hold_mode
            )
            if not held:
                words = f"the vehicle did not hold for the upload: {reason}"
                return TransferResult("rejected", words, holds="the old one")
        wire_items = (*job.items[:hidden], *jumps_moved(job.items, hidden))
        verdict = await self._send_request(
            self._system.missions.upload_mission(raw_items(wire_items, first))
        )
        read, reason = await self._read()
        ended = upload_result(stack, hidden, wire_items, verdict, read)
        if read is None:
            ended = replace(ended, reason=f"{ended.reason}; the read-back failed: {reason}")
        if ended.outcome != "accepted":
            return ended
        ended = replace(ended, items=job.items)
        if len(self._commands.overrides) > overrides and stack.keeps_target:
            started = TransferResult("failed", self._commands.overrides[-1])
        else:
            started = await self._start_mission(first, wire_items, before, stack)
        if started.outcome != "accepted":
            words = f"the mission is on board, but the vehicle did not start it: {started.reason}"
            return replace(ended, outcome=started.outcome, reason=words, code=None)
        if paused and len(self._commands.overrides) > overrides:
            words = (
                f"accepted; {self._commands.overrides[-1]}, so the upload left the mode unchanged"
            )
            return replace(ended, reason=words)
        if paused:
            resumed, reason = await self._commands.change_mode(
                stack, stack.hold_mode, stack.mission_mode
            )
            if not resumed:
                words = f"the mission is on board, but the vehicle did not resume it: {reason}"
                return replace(ended, outcome="failed", reason=words, code=None)
        return ended

    def _first(self, job: Job) -> int:
        """Return the sequence number, as transmitted, of the item to fly next."""
        hidden, last = self._monitor.hidden_items, self._monitor.hidden_items + len(job.items) - 1
        if job.begin == "restart":
            return hidden
        seq = self._monitor.current or 0 if job.begin == "keep" else hidden + job.begin
        return min(max(seq, hidden), last)

    async def _start_mission(
        self, seq: int, wire_items: Items, before: Onboard, stack: Stack
    ) -> TransferResult:
        """Start the mission on board; see ``vehicle/mission_activation.py``."""
        address = Address(MAVSDK_IDS, self._target)
        later = range(seq, len(wire_items))
        shown = next((at for at in later if wire_items[at].command <= LAST_NAV), seq)
        begin = self._begin = MissionActivation(
            *(address, seq, shown, len(wire_items), mission_id_of(wire_items, stack)),
            *(before._replace(seq=self._monitor.current), TransferTiming()),
        )
        try:
            messages = begin.start(self._clock())
            while begin.result is None:
                for message in messages:
                    await self._system.call(
                        self._system.direct.send_message(raw_message(message, self._target))
                    )
                await self._system.pause()
                messages = begin.handle_timer(self._clock())
            return begin.result
        finally:
            self._begin = None

    async def _send_request(self, call: Coroutine[Any, Any, Any]) -> str:
        """Send a transfer request, and return the name of MAVSDK's result."""
        try:
            await self._system.call(call)
        except library().missions.MissionRawError as error:
            return str(error.result.name)
        except TimeoutError:
            return NO_ANSWER
        return "SUCCESS"

    async def _read(self) -> tuple[Items | None, str]:
        """Return the transmitted items (None if the download fails), and MAVSDK's result."""
        try:
            read = await self._system.call(self._system.missions.download_mission())
        except library().missions.MissionRawError as error:
            if error.result.name == "NO_MISSION_AVAILABLE":
                return (), "SUCCESS"
            return None, str(error.result.name)
        except TimeoutError:
            return None, NO_ANSWER
        return tuple(item_of(raw) for raw in read), "SUCCESS"
