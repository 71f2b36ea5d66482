"""Streams changed states as server-sent events, in the order of their changes.

A client receives the newest state of each item, but not every intermediate state. For each client
the service stores only the last version sent, so slow clients need no more memory than fast
clients. While a connection is blocked, nothing is encoded for this client. Afterwards the client
receives the states that are the newest at that time.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

MAX_STREAMS = 32
# After this time without a change, a comment is sent, so that both sides detect a dead connection.
SENT_EVERY_S = 10.0
# The pause between two batches for a client is this time multiplied by the number of open streams,
# but at least MIN_PAUSE_S. All streams together use a few per cent of a core, and a single stream
# delivers changes within milliseconds.
PAUSE_S = 0.002
MIN_PAUSE_S = 0.004
END_WITHIN_S = 0.5  # a client that reads more slowly is disconnected
NOTHING_SENT = b": \n\n"


class TooSlowError(Exception):
    """A client does not read its response in time."""


class Source(Protocol):
    """The source of the stream's events (``Frames``)."""

    @property
    def version(self) -> int:
        """Return the version of the whole state, which grows with each change."""

    def frames(self, since: int) -> bytes:
        """Return the events for all changes since a version, in order of version."""

    async def changed(self, since: int) -> None:
        """Wait until ``version`` is larger than ``since``."""


class Streams:
    """The open live streams; ``now_s`` is a monotonic clock."""

    def __init__(self, source: Source, now_s: Callable[[], float]) -> None:
        self.source = source
        self.now_s = now_s
        self.count = 0
        self.stopping = asyncio.Event()

    @property
    def full(self) -> bool:
        """Return whether ``MAX_STREAMS`` streams are open."""
        return self.count >= MAX_STREAMS

    @property
    def pause_s(self) -> float:
        """Return the pause in seconds between two batches for a client."""
        return max(MIN_PAUSE_S, PAUSE_S * self.count)


class LiveStream(Response):
    """The live stream of one client."""

    def __init__(self, streams: Streams, since: int, still: Callable[[], bool]) -> None:
        """Make a stream of the changes since a version.

        ``still`` is called every few seconds; the stream ends when it returns False.
        """
        super().__init__()
        self._streams = streams
        self._sent = since if since <= streams.source.version else 0
        self._still = still

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        streams = self._streams
        streams.count += 1
        try:
            headers = [(b"content-type", b"text/event-stream; charset=utf-8")]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await _first_of(
                self._send_changes(send), _disconnected(receive), _set(streams.stopping)
            )
            try:
                async with asyncio.timeout(END_WITHIN_S):
                    await send({"type": "http.response.body", "body": b""})
            except TimeoutError:
                raise TooSlowError from None
        finally:
            streams.count -= 1

    async def _send_changes(self, send: Send) -> None:
        """Send changes until the client's token is no longer valid."""
        streams, source = self._streams, self._streams.source
        sent_at_s = checked_at_s = streams.now_s()
        while True:
            try:
                async with asyncio.timeout(sent_at_s + SENT_EVERY_S - streams.now_s()):
                    await source.changed(self._sent)
                version = source.version
                body = source.frames(self._sent)
                self._sent = version
            except TimeoutError:
                body = NOTHING_SENT
            if streams.now_s() - checked_at_s >= SENT_EVERY_S:
                checked_at_s = streams.now_s()
                if not self._still():
                    return
            if body:
                await send({"type": "http.response.body", "body": body, "more_body": True})
                sent_at_s = streams.now_s()
            await asyncio.sleep(streams.pause_s)


async def _disconnected(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _set(event: asyncio.Event) -> None:
    await event.wait()


async def _first_of(*awaitables: Awaitable[None]) -> None:
    """Wait until one awaitable ends, cancel the others, and raise its exception, if any."""
    tasks = [asyncio.ensure_future(each) for each in awaitables]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
