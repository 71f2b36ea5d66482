"""A request that arrived completely is carried out, even if the client closes or resets."""

import asyncio
import json
import logging
import socket
import ssl
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from mission_service.config.service_section import HttpSection
from mission_service.events import Aborted, AnyOperatorEvent, OrderGiven
from mission_service.interfaces.api.server import tls_of
from tests.api.worlds import Served, World, listened_to, served
from tests.patience import until

TIMES = 25
WITHIN_S = 30.0
ABORT, HOLD_ALL = "/api/v1/abort", "/api/v1/vehicles/all/hold"


def request_bytes(
    service: Served, port: int, path: str, body: bytes = b"", length: int | None = None
) -> bytes:
    """Return a POST request; ``length`` is the Content-Length, if it differs from the body's."""
    lines = [f"POST {path} HTTP/1.1", f"Host: 127.0.0.1:{port}"]
    lines += [f"Authorization: Bearer {service.tokens['all']}"]
    lines += [f"Content-Length: {len(body) if length is None else length}", "", ""]
    return "\r\n".join(lines).encode() + body


def close(sock: socket.socket) -> None:
    sock.close()


def reset(sock: socket.socket) -> None:
    """Close with RST, so that the kernel may discard data that the other side has not read."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    sock.close()


@pytest.mark.parametrize("leave", [close, reset])
@pytest.mark.parametrize(
    ("path", "body", "length", "kind"),
    [
        (ABORT, b"", None, Aborted),
        (ABORT, b"{}", None, Aborted),
        (ABORT, b'{"by":', 4000, Aborted),  # the rest of the body is never sent
        (HOLD_ALL, b"{}", None, OrderGiven),
        (HOLD_ALL, json.dumps({"by": "x" * 70}).encode(), None, OrderGiven),
    ],
)
def test_what_was_sent_whole_is_done_though_the_client_closes_at_once(
    flying: World,
    caplog: pytest.LogCaptureFixture,
    leave: Callable[[socket.socket], None],
    path: str,
    body: bytes,
    length: int | None,
    kind: type[AnyOperatorEvent],
) -> None:
    before = len(flying.submitted)

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address:
            sent = request_bytes(service, address[1], path, body, length)
            for number in range(TIMES):
                sock = socket.create_connection(address)
                if number % 2:  # the server accepts the connection before the request is sent
                    await asyncio.sleep(0)
                    await asyncio.sleep(0)
                sock.sendall(sent)
                leave(sock)
            await until(lambda: len(flying.submitted) >= before + TIMES)

    with caplog.at_level(logging.WARNING):
        asyncio.run(go())
    assert [type(event) for event in flying.submitted[before:]] == [kind] * TIMES
    assert caplog.text == ""


def test_a_body_in_many_parts_is_read_to_its_end(flying: World) -> None:
    before = len(flying.submitted)
    body = json.dumps({"by": "ann"}).encode() + b" " * 300_000

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address:
            sent = request_bytes(service, address[1], HOLD_ALL, body)
            _, writer = await asyncio.open_connection(*address)
            writer.write(sent)
            await writer.drain()
            writer.close()  # the rest is written first
            await until(lambda: len(flying.submitted) > before)
            await writer.wait_closed()

    asyncio.run(go())
    assert flying.submitted[-1].by == "ann"


def test_an_abort_takes_no_body(flying: World) -> None:
    """It is carried out when its headers have arrived, while the connection stays open."""
    before = len(flying.submitted)

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address:
            reader, writer = await asyncio.open_connection(*address)
            path = f"{ABORT}?by=ann&station=north"
            writer.write(request_bytes(service, address[1], path, b"", 10**9))
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), WITHIN_S)
            assert head.startswith(b"HTTP/1.1 200 ")
            writer.close()

    asyncio.run(go())
    assert flying.submitted[before:] == [Aborted(flying.submitted[-1].at_us, "ann", "north")]


def test_half_an_order_is_no_order(flying: World, caplog: pytest.LogCaptureFixture) -> None:
    before = len(flying.submitted)

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address:
            for _ in range(TIMES):
                sock = socket.create_connection(address)
                sock.sendall(request_bytes(service, address[1], HOLD_ALL, b"{", 2))
                reset(sock)
            sock = socket.create_connection(address)
            sock.sendall(request_bytes(service, address[1], ABORT))
            sock.close()
            await until(lambda: len(flying.submitted) > before)

    with caplog.at_level(logging.WARNING):
        asyncio.run(go())
    assert [type(event) for event in flying.submitted[before:]] == [Aborted]
    assert caplog.text == ""  # a client that disconnects writes no traceback to the log


def test_over_tls_too(flying: World, certificate: tuple[Path, Path]) -> None:
    section = HttpSection(tls_certificate=certificate[0], tls_key=certificate[1])
    before = len(flying.submitted)

    async def go() -> None:
        service = served(flying)
        async with listened_to(service, tls_of(section)) as address:
            context = ssl.create_default_context(cafile=str(certificate[0]))

            def order(path: str, orderly: bool) -> None:
                plain = socket.create_connection(address)
                # Otherwise the kernel holds the request back until the handshake is acknowledged.
                plain.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                sock = context.wrap_socket(plain, server_hostname="127.0.0.1")
                sock.sendall(request_bytes(service, address[1], path, b"{}"))
                if orderly:
                    sock.close()
                else:
                    reset(sock)

            for number in range(TIMES):
                path = ABORT if number % 3 else HOLD_ALL
                await asyncio.to_thread(order, path, number % 2 == 0)
            await until(lambda: len(flying.submitted) >= before + TIMES)

    asyncio.run(go())
