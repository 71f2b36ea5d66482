"""Waits for conditions with generous timeouts, so that results do not depend on the machine."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 600.0  # only a test that hangs waits as long


async def until(what: Callable[[], Any]) -> None:
    """Wait for a condition while the event loop runs; fail if it is never met."""
    end_s = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end_s, "it did not come about"
        await asyncio.sleep(0.002)


def wait_until(what: Callable[[], Any]) -> None:
    """Wait for a condition without an event loop."""
    end_s = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end_s, "it did not come about"
        time.sleep(0.02)
