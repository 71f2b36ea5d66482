"""Opens a TCP connection or a serial line again after each loss.

A lost connection is not an error, because the peers of the link have timeouts.
"""

import asyncio
from collections.abc import Awaitable, Callable

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.link_address import LinkAddress, SerialAddress
from autopilot_bridge.links.sockets import look_up, reason_of
from autopilot_bridge.links.streams import Stream
from autopilot_bridge.links.transport import Listener

CONNECT_WITHIN_S = 5.0
FIRST_WAIT_S = 0.25
LONGEST_WAIT_S = 5.0


def reconnect_wait_s(failures: int) -> float:
    """Return the seconds to wait before connecting again, after ``failures`` failed attempts."""
    return float(min(FIRST_WAIT_S * 2 ** min(failures, 16), LONGEST_WAIT_S))


class ReconnectingStream:
    """A client connection that reconnects after every loss."""

    def __init__(
        self,
        connect: Callable[[], Awaitable[Stream]],
        listener: Listener,
        address: LinkAddress | SerialAddress,
    ) -> None:
        self.called = ""  # the link has only one remote
        self._connect = connect
        self._listener = listener
        self._address = address
        self._stream: Stream | None = None
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Start connecting.

        A serial device must exist, and a host name must resolve; a TCP server may start later.
        """
        if isinstance(self._address, LinkAddress):
            await look_up(self._address)
        else:
            try:
                self._stream = await self._connect()
            except OSError as error:
                raise BridgeError(
                    f"link {self._address}: cannot be opened ({reason_of(error)}); check that the "
                    "device is connected, that you have permission to read and write it, and "
                    "that no other program uses it"
                ) from None
        self._task = asyncio.create_task(self._stay_connected())
        self._task.add_done_callback(self._ended)

    async def _stay_connected(self) -> None:
        failures = 0
        while True:
            failures += 1
            try:
                if self._stream is None:
                    async with asyncio.timeout(CONNECT_WITHIN_S):
                        self._stream = await self._connect()
                await self._stream.lost.wait()
                if self._stream.received_frames:
                    failures = 0
            except OSError:  # also TimeoutError: the server does not listen yet
                pass
            self._stream = None
            await asyncio.sleep(reconnect_wait_s(failures))

    def _ended(self, task: "asyncio.Task[None]") -> None:
        error = None if task.cancelled() else task.exception()
        if isinstance(error, Exception):
            self._listener.failed(error)

    def send(self, frames: list[bytes], remote: str = "") -> bool:
        """Send frames if there is a connection, and return whether they were sent."""
        return self._stream is not None and self._stream.send(frames)

    async def close(self) -> None:
        """Disconnect, and stop reconnecting."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        if self._stream is not None:
            await self._stream.close()
