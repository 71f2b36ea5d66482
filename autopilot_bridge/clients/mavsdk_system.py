"""Runs MAVSDK in this process, passes raw bytes to it, and calls its functions."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from autopilot_bridge.clients.mavsdk_library import library

POLL_INTERVAL_S = 0.05
DETECTION_TIMEOUT_S = 10.0
CALL_TIMEOUT_S = 120.0  # longer than the transfer of the longest mission over a slow radio
NO_ANSWER = "NO_ANSWER"  # the result of a call that does not return
CLOSE_TIMEOUT_S = 5.0  # time for active transfers to end when the service stops
Result = TypeVar("Result")


class MavsdkSystem:
    """One vehicle in MAVSDK; ``missions`` and ``direct`` are None before its detection."""

    def __init__(self, system_id: int, clock: Callable[[], int]) -> None:
        self._system_id = system_id
        self._clock = clock
        self._mavsdk: Any = None
        self.missions: Any = None
        self.direct: Any = None
        self._calls: set[asyncio.Task[Any]] = set()

    def open(self, send: Callable[[bytes], None]) -> None:
        """Start MAVSDK; ``send`` is called in the event loop with the bytes to send."""
        core = library().core
        loop = asyncio.get_running_loop()
        station = core.ComponentType.GROUND_STATION
        self._mavsdk = core.Mavsdk(core.Configuration.create_with_component_type(station))
        self._mavsdk.subscribe_raw_bytes_to_be_sent(  # called in one of MAVSDK's threads
            lambda data: loop.call_soon_threadsafe(send, data)
        )
        self._mavsdk.add_any_connection("raw://")

    async def close(self) -> None:
        """Wait for the active calls to end, then stop MAVSDK."""
        # An active call would never return if MAVSDK were destroyed.
        if self._calls:
            await asyncio.wait(self._calls, timeout=CLOSE_TIMEOUT_S)
        if self._calls:
            await self.missions.cancel_mission_upload()
            await self.missions.cancel_mission_download()
            await asyncio.wait(self._calls, timeout=CLOSE_TIMEOUT_S)
        self._mavsdk.destroy()

    def receive_frame(self, frame: bytes) -> None:
        """Pass a received frame to MAVSDK."""
        self._mavsdk.pass_received_raw_bytes(frame)

    async def detected(self) -> bool:
        """Wait for MAVSDK to detect the vehicle, and create the plugins; False after a timeout."""
        modules = library()

        def detect() -> bool:
            for system in self._mavsdk.get_systems() if self.missions is None else ():
                if system.get_system_id() == self._system_id and system.has_autopilot():
                    wrapped = modules.system.System(system)
                    self.direct = modules.direct.MavlinkDirectAsync(wrapped)
                    self.missions = modules.missions.MissionRawAsync(wrapped)
            return self.missions is not None

        return await self.until(detect, DETECTION_TIMEOUT_S)

    async def call(self, call: Coroutine[Any, Any, Result]) -> Result:
        """Return the result of a call to MAVSDK; if the wait is cancelled, the call continues.

        Raises TimeoutError if the call takes longer than all of MAVSDK's own timeouts.
        """
        task = asyncio.ensure_future(call)
        self._calls.add(task)
        task.add_done_callback(self._returned)
        return await asyncio.wait_for(asyncio.shield(task), CALL_TIMEOUT_S)

    def _returned(self, task: asyncio.Task[Any]) -> None:
        self._calls.discard(task)
        # Read the result here, because no task may be waiting for it.
        task.cancelled() or task.exception()

    async def pause(self) -> None:
        """Wait for one polling interval."""
        await asyncio.sleep(POLL_INTERVAL_S)

    async def until(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Wait for ``condition()``, at most ``within_s`` seconds; return whether it became true."""
        ends_us = self._clock() + round(within_s * 1e6)
        while not condition():
            if self._clock() > ends_us:
                return False
            await self.pause()
        return True
