"""The live stream: what changed, newest first to last, as server-sent events.

A client is owed the newest state of each item, not each state it had: it remembers one number, the
version it has, so it takes the same memory however slowly it reads. While its connection is full
nothing is made for it; when it reads again it gets what is newest then.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

MOST_STREAMS = 32
TOLD_EVERY_S = 10.0  # at the latest: a comment, so that both sides notice a dead connection
# Between two batches for a client, for each stream that is open: all streams together take a few
# per cent of a core, and a single one is told within milliseconds.
PAUSE_S = 0.002
LEAST_PAUSE_S = 0.004
END_WITHIN_S = 0.5  # who reads more slowly is cut off
TOLD_NOTHING = b": \n\n"


class TooSlowError(Exception):
    """Somebody does not read what they asked for."""


class Source(Protocol):
    """Where the news come from."""

    @property
    def version(self) -> int:
        """Of all there is; grows with each change."""

    def frames(self, since: int) -> bytes:
        """All that changed since a version, in the order of its versions; see ``Frames``."""

    async def changed(self, since: int) -> None:
        """Return when ``version`` is larger than ``since``."""


class Streams:
    """All clients of the live stream."""

    def __init__(self, source: Source, now_s: Callable[[], float]) -> None:
        self.source = source
        self.now_s = now_s
        self.count = 0
        self.stopping = asyncio.Event()

    @property
    def full(self) -> bool:
        """Whether there is no place for one more."""
        return self.count >= MOST_STREAMS

    @property
    def pause_s(self) -> float:
        """How long a client waits after a batch."""
        return max(LEAST_PAUSE_S, PAUSE_S * self.count)


class LiveStream(Response):
    """One client's stream."""

    def __init__(self, streams: Streams, since: int, still: Callable[[], bool]) -> None:
        """``still`` is asked every few seconds whether the client may go on."""
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
            await _first_of(self._tell(send), _gone(receive), _set(streams.stopping))
            try:
                async with asyncio.timeout(END_WITHIN_S):
                    await send({"type": "http.response.body", "body": b""})
            except TimeoutError:
                raise TooSlowError from None
        finally:
            streams.count -= 1

    async def _tell(self, send: Send) -> None:
        """Tell what is new until the client may listen no more."""
        streams, source = self._streams, self._streams.source
        told_at_s = asked_at_s = streams.now_s()
        while True:
            try:
                async with asyncio.timeout(told_at_s + TOLD_EVERY_S - streams.now_s()):
                    await source.changed(self._sent)
                version = source.version
                body = source.frames(self._sent)
                self._sent = version
            except TimeoutError:
                body = TOLD_NOTHING
            if streams.now_s() - asked_at_s >= TOLD_EVERY_S:
                asked_at_s = streams.now_s()
                if not self._still():
                    return
            if body:
                await send({"type": "http.response.body", "body": body, "more_body": True})
                told_at_s = streams.now_s()
            await asyncio.sleep(streams.pause_s)


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _set(event: asyncio.Event) -> None:
    await event.wait()


async def _first_of(*ways: Awaitable[None]) -> None:
    """Return when one has ended; the others are cancelled. What it raised is raised."""
    tasks = [asyncio.ensure_future(way) for way in ways]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
