"""A connection with several links: signatures, copies of a router, the recording."""

import asyncio
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.mavutil import mavlink_connection

from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.signing import Counts, Signing, Timestamps, key_of
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import LinksChanged
from tests.bridge.transport_helpers import clock_us, free_port, run, udp_socket
from tests.patience import until

NOW_US = 1_790_000_000_000_000
KEY = key_of("a passphrase")
HEARTBEAT = mavlink.MAVLink_heartbeat_message(1, 12, 81, 0, 3, 3)


def signing() -> Signing:
    return Signing(KEY, Timestamps(lambda: NOW_US))


def test_a_router_sends_signed_frames_over_both_links(tmp_path: Path) -> None:
    """Each frame is used once, and both links count as working; the recording has both links."""
    path = tmp_path / "flight.tlog"

    async def exchange() -> tuple[Counts, list[int]]:
        ports = (free_port(), free_port())
        links = tuple(f"udpin:127.0.0.1:{port}" for port in ports)
        link, theirs, codec = SharedLink(links, expects=True, signed=True), signing(), Codec(1, 1)
        client = link.expect(1, links=(0, 1))
        with Tlog(path, lambda: NOW_US, pytest.fail) as tlog, udp_socket() as router:
            async with Connection(
                links, link, clock_us, tlog=tlog, signing=signing(), link_id=(7, 9)
            ) as connection:

                def states() -> tuple[str, ...]:
                    changes = []
                    while (event := client.next_event()) is not None:
                        changes += [event] if isinstance(event, LinksChanged) else []
                    return tuple(each.state for each in changes[-1].links) if changes else ()

                def works() -> bool:
                    for number in range(4):
                        frame = theirs.sign(codec.encode(HEARTBEAT), 3)
                        # The first copy of some frames is received over the second link.
                        for port in ports if number else ports[1:]:
                            router.sendto(frame, ("127.0.0.1", port))
                    return states() == ("up", "up")

                await until(works)
                sent = {(await asyncio.to_thread(router.recv, 999))[-13] for _ in range(8)}
                return connection.ports[1].counts, sorted(sent)

    counts, link_ids = run(exchange)
    assert link_ids == [7, 9]
    assert counts.repeated == 0
    log = mavlink_connection(str(path), dialect="ardupilotmega")
    recorded = set()
    while (message := log.recv_match(type="HEARTBEAT")) is not None:
        recorded.add((message.get_srcSystem(), log._link))
    assert recorded == {(1, 0), (1, 1), (255, 0), (255, 1)}


def test_copies_of_signed_frames_bind_no_vehicle_to_their_sender() -> None:
    link = SharedLink(("radio", "lte"), expects=True, signed=True)
    link.expect(1, links=(0, 1))
    frame = Codec(1, 1).encode(HEARTBEAT)
    link.receive_frames("vehicle", [frame], 0, 0)
    link.receive_copies("forger", [frame], 1, 1)
    assert link._sources[1].keys() == {0}
    assert stack_named("px4", "plane") == link.clients[1].stack


def test_a_second_link_that_cannot_be_opened_is_reported_and_the_first_closed() -> None:
    async def exchange() -> None:
        port, used = free_port(), free_port()
        link = SharedLink(("a", "b"))
        with udp_socket() as other:
            used = other.getsockname()[1]
            with pytest.raises(BridgeError, match=str(used)):
                async with Connection(
                    (f"udpin:127.0.0.1:{port}", f"udpin:127.0.0.1:{used}"),
                    link,
                    clock_us,
                    link_id=(0, 1),
                ):
                    pass
        async with Connection(f"udpin:127.0.0.1:{port}", SharedLink("a"), clock_us):
            pass

    run(exchange)
