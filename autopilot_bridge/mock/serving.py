"""The mock on a link of any kind: simulation time runs ``speedup`` times as fast as the clock."""

from collections.abc import Callable

from autopilot_bridge.links.connection import Connection, Peer
from autopilot_bridge.links.signing import Key, Signing
from autopilot_bridge.mock.mock_group import MockGroup
from autopilot_bridge.mock.signing_server import SigningServer


async def serve(
    mock: Peer,
    link: str,
    speedup: float,
    clock: Callable[[], int],
    opened: Callable[[], None] = lambda: None,
    signing: Signing | None = None,
    learns: Callable[[Key], Signing] | None = None,
) -> None:
    """Fly a mock or a fleet on a link until cancelled. ``clock`` gives real microseconds.

    ``opened`` is called when the link is open. With ``learns``, a fleet signs with the keys it is
    told; it makes the signing for one.
    """
    began_us = clock()

    def simulation_us() -> int:
        return int((clock() - began_us) * speedup)

    peer = mock
    if learns is not None and isinstance(mock, MockGroup):
        peer = SigningServer(
            mock, lambda key: connection.go_on_with(None if key is None else learns(key))
        )
    connection = Connection(link, peer, simulation_us, rate=speedup, signing=signing)
    async with connection:
        opened()
        while True:
            await connection.wait()
