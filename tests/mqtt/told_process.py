"""A publisher in a process of its own, to be killed: ``python -m tests.mqtt.told_process PORT``."""

import asyncio
import sys

from tests.mqtt.stage import telling


async def tell(port: int) -> None:
    async with telling(port) as stage:
        at_us = 0
        while True:
            at_us += 100_000
            stage.moves(at_us)
            await asyncio.sleep(0.1)


asyncio.run(tell(int(sys.argv[1])))
