"""A flight in virtual time that a thread serves, so that the page shows the same state anywhere."""

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import NamedTuple

from mission_service.interfaces.api.app import PAGE
from tests.api.worlds import Served, World, listened_to, served
from tests.patience import PATIENCE_S


class Site(NamedTuple):
    """A flight that a thread serves; only ``fly`` may change it."""

    world: World
    service: Served
    address: str
    loop: asyncio.AbstractEventLoop

    def fly(self, seconds: float) -> None:
        """Continue the flight, in the thread that serves it."""
        done: Future[None] = asyncio.run_coroutine_threadsafe(self._fly(seconds), self.loop)
        done.result(timeout=PATIENCE_S)

    async def _fly(self, seconds: float) -> None:
        self.world.fly(self.world.now_s + seconds)


@contextmanager
def site_of(world: World) -> Iterator[Site]:
    """Serve a flight in a thread."""
    service = served(world, page=PAGE)
    ready: Future[Site] = Future()

    async def serve() -> None:
        async with listened_to(service) as (host, port):
            loop = asyncio.get_running_loop()
            ready.set_result(Site(world, service, f"http://{host}:{port}", loop))
            await service.app.api.streams.stopping.wait()
        service.app.api.context.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    found = ready.result(timeout=PATIENCE_S)
    try:
        yield found
    finally:
        found.loop.call_soon_threadsafe(service.app.api.streams.stopping.set)
        thread.join(timeout=PATIENCE_S)
