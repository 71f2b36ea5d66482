"""Errors of single datagrams on a UDP link: the link continues for all other remotes."""

import errno
import os
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.signing import Key, Signing, Timestamps
from autopilot_bridge.links.udp import IGNORED_ERRORS, Udp
from tests.bridge.transport_helpers import clock_us, free_port, run, udp_socket

KEY = Key(bytes(range(32)))
NO_PORT = ("127.0.0.1", 0)
REPORTED = (errno.EPERM, errno.EACCES, errno.EINVAL, errno.EADDRNOTAVAIL, errno.ENOMEM)


def signing() -> Signing:
    return Signing(KEY, Timestamps(lambda: round(time.time() * 1e6)))


def heartbeat(system_id: int) -> bytes:
    px4 = mavlink.MAV_AUTOPILOT_PX4
    message = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, px4, 1, 0, 4, 3)
    return Codec(system_id, 1).encode(message)


def udp_of(connection: Connection) -> Udp:
    udp = connection.ports[0].transport
    assert isinstance(udp, Udp)
    return udp


async def connects(connection: Connection, link: SharedLink, system_id: int, frame: bytes) -> None:
    """Send a heartbeat from a separate socket, and wait until its vehicle is connected."""
    port = int(link.name.rpartition(":")[2])
    with udp_socket() as vehicle:
        vehicle.sendto(frame, ("127.0.0.1", port))
        while link.clients[system_id].stack is None:
            await connection.wait()
        assert vehicle.recv(300)  # the vehicle receives requests


@pytest.mark.parametrize("is_signed", [False, True])
def test_a_datagram_from_port_0_is_dropped_and_a_second_vehicle_is_found(is_signed: bool) -> None:
    async def exchange() -> None:
        link = SharedLink(f"udpin:127.0.0.1:{free_port()}", expects=True, signed=is_signed)
        for system_id in (1, 2):
            link.expect(system_id)
        theirs = signing()
        frames = [heartbeat(1), heartbeat(2)]
        if is_signed:
            frames = [theirs.sign(frame, 0) for frame in frames]
        async with Connection(
            link.name, link, clock_us, signing=signing() if is_signed else None
        ) as connection:
            udp_of(connection).datagram_received(frames[0], NO_PORT)
            udp_of(connection).datagram_received(heartbeat(77), NO_PORT)
            await connects(connection, link, 2, frames[1])
            assert link.clients[1].stack is None
            assert connection.ports[0].lost_datagrams == 0

    run(exchange)


@pytest.mark.parametrize("code", [*REPORTED, *sorted(IGNORED_ERRORS)])
def test_no_error_of_a_datagram_ends_the_link(code: int) -> None:
    async def exchange() -> None:
        link = SharedLink(f"udpin:127.0.0.1:{free_port()}", expects=True)
        link.expect(1)
        async with Connection(link.name, link, clock_us) as connection:
            for _ in range(3):
                udp_of(connection).error_received(OSError(code, os.strerror(code)))
            await connects(connection, link, 1, heartbeat(1))
            port = connection.ports[0]
            expected = (3, os.strerror(code)) if code in REPORTED else (0, "")
            assert (port.lost_datagrams, port.last_error) == expected

    run(exchange)


def test_a_link_to_an_address_without_permission_cannot_be_opened() -> None:
    async def exchange() -> None:
        link = SharedLink("udpout:255.255.255.255:14550")
        async with Connection(link.name, link, clock_us):
            pass

    with pytest.raises(BridgeError, match="cannot send to this address"):
        run(exchange)
