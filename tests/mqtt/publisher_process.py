"""A publisher process that tests kill: ``python -m tests.mqtt.publisher_process PORT``."""

import asyncio
import sys

from tests.mqtt.stage import publishing


async def publish(port: int) -> None:
    async with publishing(port) as stage:
        at_us = 0
        while True:
            at_us += 100_000
            stage.moves(at_us)
            await asyncio.sleep(0.1)


asyncio.run(publish(int(sys.argv[1])))
