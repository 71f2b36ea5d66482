"""The mock on a link of any kind: simulation time runs ``speedup`` times as fast as the clock."""

from collections.abc import Callable

from autopilot_bridge.connection import Connection, Peer


async def serve(
    mock: Peer,
    link: str,
    speedup: float,
    clock: Callable[[], int],
    opened: Callable[[], None] = lambda: None,
) -> None:
    """Fly a mock or a fleet on a link until cancelled. ``clock`` gives real microseconds.

    ``opened`` is called when the link is open.
    """
    began_us = clock()

    def simulation_us() -> int:
        return int((clock() - began_us) * speedup)

    async with Connection(link, mock, simulation_us, rate=speedup) as connection:
        opened()
        while True:
            await connection.wait()
