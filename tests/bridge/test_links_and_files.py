"""Links, and one exchange over real UDP."""

import asyncio
import contextlib
import socket
import time

import pytest

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.link_address import (
    LinkAddress,
    SerialAddress,
    other_end,
    parse_link,
)
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.links.reconnection import reconnect_wait_s
from autopilot_bridge.missions.transfer import TransferResult
from autopilot_bridge.mock.serving import serve
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import Connected, TransferFinished
from tests.bridge.helpers import line_of, mock_of


def clock_us() -> int:
    return time.monotonic_ns() // 1000


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port: int = sock.getsockname()[1]
        return port


def test_link_strings_are_read() -> None:
    assert parse_link("udpin:0.0.0.0:14550") == LinkAddress("udpin", "0.0.0.0", 14550)
    for kind in ("udpin", "udpout", "tcp", "tcpin"):
        assert parse_link(f"{kind}:host:5760") == LinkAddress(kind, "host", 5760)
    # Udev's device names contain colons.
    by_path = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0"
    assert parse_link(f"serial:{by_path}:57600") == SerialAddress(by_path, 57600)
    assert str(parse_link("serial:/dev/ttyACM0:115200")) == "serial:/dev/ttyACM0:115200"


def test_the_other_end_of_a_link_is_named() -> None:
    assert other_end("udpin:127.0.0.1:14550") == "udpout:127.0.0.1:14550"
    assert other_end("tcpin:127.0.0.1:5760") == "tcp:127.0.0.1:5760"
    assert other_end("tcp:127.0.0.1:5760") == "tcpin:127.0.0.1:5760"
    with pytest.raises(BridgeError, match="no network port"):
        other_end("serial:/dev/ttyACM0:57600")


def test_calls_are_made_at_growing_but_bounded_intervals() -> None:
    waits_s = [reconnect_wait_s(failures) for failures in range(2000)]
    assert waits_s == sorted(waits_s)
    assert waits_s[0] < waits_s[1] < waits_s[2]
    assert 0.0 < waits_s[0] <= 0.5
    assert waits_s[-1] <= 10.0


@pytest.mark.parametrize(
    "text",
    [
        *("udp:1.2.3.4:5", "udpin:14550", "udpout:h:x", "udpin:h:70000", "tcp:h:0", "tcpin:h:²"),
        *("serial:/dev/ttyUSB0", "serial::57600", "serial:/dev/ttyUSB0:fast", "serial:d:0", ""),
    ],
)
def test_a_bad_link_string_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(BridgeError, match="link") as caught:
        parse_link(text)
    assert "\n" not in str(caught.value)


def test_a_memory_link_treats_the_same_traffic_the_same_way() -> None:
    def fate(seed: int) -> list[tuple[int, list[bytes]]]:
        link = MemoryLink(0.3, 50_000, 80_000, 0.2, seed)
        for index in range(200):
            link.send(bytes([index]), index * 10_000)
        return [(now, link.receive(now)) for now in range(0, 3_000_000, 5_000)]

    assert fate(7) == fate(7)
    assert fate(7) != fate(8)


async def upload_over_udp(port: int) -> TransferResult:
    client = NativeClient()
    async with Connection(f"udpin:127.0.0.1:{port}", client, clock_us) as connection:
        while True:
            await connection.wait()
            while (event := client.next_event()) is not None:
                if isinstance(event, Connected):
                    client.upload(line_of(20), clock_us())
                    connection.flush()
                if isinstance(event, TransferFinished):
                    return event.result


async def with_mock(port: int) -> tuple[TransferResult, object]:
    mock = mock_of(stack_named("ardupilot", "plane"))
    task = asyncio.create_task(serve(mock, f"udpout:127.0.0.1:{port}", 5.0, clock_us))
    result = await asyncio.wait_for(upload_over_udp(port), 20.0)
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    return result, tuple(mock.missions.items[1:])


def test_a_mission_is_uploaded_over_real_udp() -> None:
    result, held = asyncio.run(with_mock(free_port()))
    assert result.outcome == "accepted"
    assert held == line_of(20)


def test_a_port_in_use_is_named() -> None:
    async def twice(port: int) -> None:
        link = f"udpin:127.0.0.1:{port}"
        first, second = (Connection(link, NativeClient(), clock_us) for _ in range(2))
        async with first, second:
            pass

    port = free_port()
    with pytest.raises(BridgeError, match=rf"127\.0\.0\.1:{port}.*another program"):
        asyncio.run(twice(port))
