"""Many clients without a token do not slow down clients with a token."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from mission_service.events import Aborted
from mission_service.interfaces.api.access import client_connections
from mission_service.interfaces.api.access.client_connections import (
    ClientConnection,
    ClientConnections,
    client_at,
)
from mission_service.interfaces.limits import ConcurrencyLimiter
from tests.api.worlds import Served, World, listened_to, served
from tests.patience import until

CROWD = 200


async def status_line(address: tuple[str, int], head: str, body: bytes = b"") -> bytes:
    """Return the first line of the response to one request on a separate connection."""
    reader, writer = await asyncio.open_connection(*address)
    try:
        lines = [head, f"Host: 127.0.0.1:{address[1]}", f"Content-Length: {len(body)}"]
        writer.write("\r\n".join([*lines, "Connection: close", "", ""]).encode() + body)
        async with asyncio.timeout(30.0):
            return (await reader.readline()).strip()
    finally:
        writer.transport.abort()


def bearing(service: Served, name: str = "all") -> str:
    return f"\r\nAuthorization: Bearer {service.tokens[name]}"


@contextlib.asynccontextmanager
async def crowd(address: tuple[str, int], sent: bytes) -> AsyncIterator[list[socket.socket]]:
    """Open connections that send some bytes and read nothing."""
    opened: list[socket.socket] = []
    loop = asyncio.get_running_loop()
    try:
        for _ in range(CROWD):
            one = socket.socket()
            opened.append(one)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            one.setblocking(False)
            await loop.sock_connect(one, address)
            # The server may already have closed the connection.
            with contextlib.suppress(ConnectionError):
                await loop.sock_sendall(one, sent)
        for _ in range(100):  # all data is read, and waiting connections keep waiting
            await asyncio.sleep(0)
        yield opened
    finally:
        for one in opened:
            one.close()


async def all_get_through(service: Served, address: tuple[str, int], world: World) -> None:
    """Check that requests with a token and the liveness route are answered."""
    before = len(world.submitted)
    assert await status_line(address, "GET /healthz HTTP/1.1") == b"HTTP/1.1 200 OK"
    look = "GET /api/v1/vehicles HTTP/1.1" + bearing(service, "look")
    assert await status_line(address, look) == b"HTTP/1.1 200 OK"
    hold = "POST /api/v1/vehicles/all/hold HTTP/1.1" + bearing(service)
    assert await status_line(address, hold, b"{}") == b"HTTP/1.1 200 OK"
    abort = "POST /api/v1/abort HTTP/1.1" + bearing(service, "look")
    assert await status_line(address, abort) == b"HTTP/1.1 200 OK"
    assert len(world.submitted) == before + 2


def test_a_client_that_reads_no_page_takes_no_place_from_others(
    flying: World, tmp_path: Path
) -> None:
    page = tmp_path / "dist"
    page.mkdir()
    (page / "index.html").write_text("x" * 4_000_000)

    async def go() -> None:
        service = served(flying, page=page)
        async with listened_to(service) as address:
            ask = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{address[1]}\r\n\r\n".encode()
            async with crowd(address, ask):
                await all_get_through(service, address, flying)
                await all_get_through(service, address, flying)

    asyncio.run(go())


def test_idle_connections_half_headers_and_slow_bodies_delay_no_other_client(flying: World) -> None:
    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address, contextlib.AsyncExitStack() as stack:
            host = f"Host: 127.0.0.1:{address[1]}\r\n"
            slow = f"POST /api/v1/wind HTTP/1.1\r\n{host}Content-Length: 99\r\n\r\n" + "{"
            authenticated = slow.replace("\r\n\r\n", bearing(service) + "\r\n\r\n")
            for sent in ("", "GET /healthz HTTP/1.1\r\nHo", slow):
                await stack.enter_async_context(crowd(address, sent.encode()))
            await all_get_through(service, address, flying)
            # An abort is carried out even if clients with a valid token send slow bodies.
            await stack.enter_async_context(crowd(address, authenticated.encode()))
            abort = "POST /api/v1/abort HTTP/1.1" + bearing(service, "look")
            assert await status_line(address, abort) == b"HTTP/1.1 200 OK"
            assert isinstance(flying.submitted[-1], Aborted)
            assert await status_line(address, "GET /healthz HTTP/1.1") == b"HTTP/1.1 200 OK"

    asyncio.run(go())


def test_without_a_file_left_the_oldest_stranger_goes(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Simulate a process that has no file descriptor left for the next connection."""

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address, crowd(address, b"") as opened:
            loop = asyncio.get_running_loop()
            accept, failures = loop.sock_accept, [0]

            async def accept_or_fail(listening: socket.socket) -> tuple[socket.socket, object]:
                if failures[0] < 3:
                    failures[0] += 1
                    raise OSError(24, "Too many open files")
                return await accept(listening)

            monkeypatch.setattr(loop, "sock_accept", accept_or_fail)
            for _ in range(2):  # the pending call has already accepted the first connection
                assert await status_line(address, "GET /healthz HTTP/1.1") == b"HTTP/1.1 200 OK"
            assert failures[0] == 3
            assert sum(_is_cut(one) for one in opened) >= 3

    asyncio.run(go())


def _is_cut(opened: socket.socket) -> bool:
    try:
        return opened.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def test_during_a_handshake_too_the_oldest_goes(
    flying: World, certificate: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from mission_service.config.service_section import HttpSection
    from mission_service.interfaces.api.server import tls_of

    monkeypatch.setattr(client_connections, "MAX_OF_AN_ADDRESS", 20)
    section = HttpSection(tls_certificate=certificate[0], tls_key=certificate[1])

    async def go() -> None:
        service = served(flying)
        async with listened_to(service, tls_of(section)) as address, crowd(address, b"") as opened:
            await until(lambda: sum(_is_cut(one) for one in opened) >= CROWD - 20)

    asyncio.run(go())


def test_of_too_many_the_oldest_of_the_busiest_address_goes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(client_connections, "MAX_UNPROVEN", 6)
    monkeypatch.setattr(client_connections, "MAX_OF_AN_ADDRESS", 4)
    monkeypatch.setattr(client_connections, "MAX_PROVEN", 1)
    cut: list[str] = []
    all_of = ClientConnections()

    def come(client: str, name: str) -> ClientConnection:
        caller = ClientConnection(client, lambda: cut.append(name))
        all_of.add(caller)
        return caller

    quiet = come("1.1.1.1", "quiet")
    for number in range(6):
        come("2.2.2.2", f"loud{number}")
    assert cut == ["loud0", "loud1"]
    come("3.3.3.3", "third")
    come("3.3.3.3", "fourth")
    assert cut == ["loud0", "loud1", "loud2"]
    all_of.prove(quiet)
    for number in range(9):
        come("1.1.1.1", f"more{number}")
    assert "quiet" not in cut
    came = 6 + 2 + 9
    assert came - len(cut) == 6  # these connections remain, and the authenticated one
    all_of.cut_one()
    assert came - len(cut) == 5


def test_places_are_counted_by_client() -> None:
    places = ConcurrencyLimiter(3, 2)
    assert [places.acquire(each) for each in "aaabcc"] == [True, True, False, True, False, False]
    places.release("a")
    assert [places.acquire("b"), places.acquire("c")] == [True, False]


def test_a_client_is_an_address_or_a_network() -> None:
    assert client_at(("192.0.2.7", 5)) == "192.0.2.7"
    assert client_at(("2001:db8::1:2", 5, 0, 0)) == client_at(("2001:db8::9", 6, 0, 0))
    assert client_at(("::ffff:192.0.2.7", 5)) == "192.0.2.7"
    assert client_at(None) == client_at(("", 0)) == ""
