"""Waiting for what must happen: how fast a machine is decides no outcome."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 600.0  # only a test that hangs waits as long


async def until(what: Callable[[], Any]) -> None:
    """Wait until something is so, while the event loop goes on; fails when it never is."""
    end_s = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end_s, "it did not come about"
        await asyncio.sleep(0.002)


def wait_until(what: Callable[[], Any]) -> None:
    """The same without an event loop."""
    end_s = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end_s, "it did not come about"
        time.sleep(0.02)
