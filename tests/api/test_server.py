"""The HTTP server in the daemon: port, TLS, shutdown, and slow connections."""

import asyncio
import contextlib
import signal
import socket
import ssl
import time
from pathlib import Path
from typing import Any

import httpx
import pytest

from mission_service.config.service_section import HttpSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.api import server
from mission_service.interfaces.api.access import client_connections, guard
from mission_service.interfaces.api.listener import http_interface
from mission_service.interfaces.api.server import bound, tls_of, url_of
from tests.api.worlds import ANY, World, listened_to, served, stream_of
from tests.patience import PATIENCE_S, until


async def response_of(address: tuple[str, int], *parts: bytes) -> bytes:
    """Return all data that the server sends until it closes the connection."""
    reader, writer = await asyncio.open_connection(*address)
    try:
        for part in parts:
            writer.write(part)
            await asyncio.sleep(0.01)
        async with asyncio.timeout(PATIENCE_S):
            return await reader.read()
    except ConnectionError:
        return b""
    finally:
        writer.close()


def test_a_port_in_use_is_reported_in_one_line() -> None:
    with bound(ANY) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(
                MissionServiceError, match=f"HTTP on 127.0.0.1:{port}: the port is in use"
            ),
            bound(HttpSection(listen=f"127.0.0.1:{port}")),
        ):
            pass
    with bound(HttpSection(listen=f"127.0.0.1:{port}")):  # the port is free again
        pass


def test_a_free_port_replaces_the_default_port_if_it_is_in_use(standing: World) -> None:
    with contextlib.ExitStack() as stack:
        section = HttpSection()
        with contextlib.suppress(MissionServiceError):  # another process may use this port
            stack.enter_context(bound(HttpSection(listen=section.address)))
        found = stack.enter_context(http_interface(section, standing.context.out))
        host, port = found.listening.getsockname()
        assert host == "127.0.0.1"
        assert port != section.port
        assert f":{port}/#token=" in found.address
        words = f"port {section.port} is in use, perhaps by another service: the map is on port"
        assert found.other_port_text == f"{words} {port}"
        anywhere = stack.enter_context(http_interface(ANY, standing.context.out))
        assert anywhere.other_port_text == ""


def test_an_interface_makes_its_token_and_serves_until_cancelled(standing: World) -> None:
    async def go() -> None:
        with http_interface(ANY, standing.context.out) as run_interface:
            assert run_interface.address.startswith("http://127.0.0.1:")
            url, _, token = run_interface.address.partition("#token=")
            running = asyncio.create_task(run_interface(standing.context))
            async with httpx.AsyncClient() as http:
                headers = {"authorization": f"Bearer {token}"}
                answer = await http.get(f"{url}api/v1/state", headers=headers)
            assert answer.json()["by"] == "user"
            running.cancel()
            with pytest.raises(asyncio.CancelledError):
                await running

    standing.context.ring()
    asyncio.run(go())


def test_it_ends_without_waiting_for_streams_and_leaves_signals_alone(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def handlers() -> list[Any]:
        return [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]

    async def go() -> float:
        before, service = handlers(), served(flying)
        async with contextlib.AsyncExitStack() as stack:
            address = await stack.enter_async_context(listened_to(service))
            assert handlers() == before
            reader, writer = await stream_of(service, address)
            all_of_it = asyncio.create_task(reader.read())
            # One connection sends nothing, another sends half a request.
            opened = [await asyncio.open_connection(*address) for _ in range(2)]
            opened[1][1].write(b"GET / HTTP/1.1\r\n")
            began_s = time.monotonic()
            await stack.aclose()
            took_s = time.monotonic() - began_s
        assert (await all_of_it).endswith(b"\r\n0\r\n\r\n")  # the stream ended without an error
        for each in (writer, opened[0][1], opened[1][1]):
            each.close()
        return took_s

    # Waiting for any of these would take longer: a request has this time limit, a stream has none.
    monkeypatch.setattr(server, "REQUEST_WITHIN_S", 2 * PATIENCE_S)
    assert asyncio.run(go()) < PATIENCE_S


def test_a_stream_that_is_not_read_does_not_delay_the_shutdown(
    standing: World, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def go() -> float:
        service = served(standing)
        async with contextlib.AsyncExitStack() as stack:
            address = await stack.enter_async_context(listened_to(service))
            _, writer = await stream_of(service, address, limit=1024)
            writer.transport.pause_reading()  # type: ignore[attr-defined]
            for number in range(60):  # more than the kernel buffers
                standing.context.state_view.announce("hawk", f"{number} " + "x" * 200_000)
            standing.context.ring()
            await until(lambda: service.app.api.streams.count == 1)
            began_s = time.monotonic()
            await stack.aclose()
            took_s = time.monotonic() - began_s
            writer.transport.abort()
        return took_s

    monkeypatch.setattr(guard, "SEND_WITHIN_S", 2 * PATIENCE_S)
    assert asyncio.run(go()) < PATIENCE_S  # otherwise the server would have waited for the reader
    assert caplog.text == ""


def test_what_is_no_http_is_answered_like_all_else(flying: World) -> None:
    async def go() -> None:
        async with listened_to(served(flying)) as address:
            for data in (
                b"GARBAGE\r\n\r\n",
                b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 20 + b"\r\n\r\n",
                b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"y" * 70_000,
                b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
            ):
                answer = await response_of(address, data)
                assert answer.startswith(b"HTTP/1.1 400 "), data[:40]
                assert b"nosniff" in answer
                assert answer.endswith(b"}")
                assert b'{"error":"this is not an HTTP' in answer

    asyncio.run(go())


def test_a_client_with_a_slow_request_is_disconnected(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "REQUEST_WITHIN_S", 1.0)

    async def go() -> None:
        async with listened_to(served(flying)) as address:
            # Nothing was sent: the server closes without a response.
            assert await response_of(address) == b""
            reader, writer = await asyncio.open_connection(*address)
            with contextlib.suppress(ConnectionError):
                async with asyncio.timeout(PATIENCE_S):
                    for letter in b"GET /healthz HTTP/1.1\r\nX-Slow: " + b"y" * 1000:
                        writer.write(bytes([letter]))
                        await writer.drain()
                        await asyncio.sleep(0.005)
                        if reader.at_eof():
                            break
            assert reader.at_eof() or writer.is_closing() or reader.exception() is not None
            writer.close()
            # A client that has sent one request may send another one later.
            reader, writer = await asyncio.open_connection(*address)
            ask = f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{address[1]}\r\n\r\n".encode()
            for _ in range(2):
                writer.write(ask)
                head = await reader.readuntil(b"\r\n\r\n")
                assert head.startswith(b"HTTP/1.1 200")
                await reader.readexactly(26)
                await asyncio.sleep(2 * server.REQUEST_WITHIN_S)
            writer.close()

    asyncio.run(go())


def is_disconnected(opened: tuple[asyncio.StreamReader, asyncio.StreamWriter]) -> bool:
    """Return whether the server has closed a connection."""
    return opened[0].at_eof() or opened[0].exception() is not None


def test_of_too_many_connections_those_without_a_token_go(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_connections, "MAX_OF_AN_ADDRESS", 8)

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address, httpx.AsyncClient() as http:
            url = f"http://127.0.0.1:{address[1]}"
            async with http.stream(
                "GET", f"{url}/api/v1/live", headers=service.headers()
            ) as reading:
                idle = [await asyncio.open_connection(*address) for _ in range(30)]
                await until(lambda: sum(map(bool, map(is_disconnected, idle))) >= 22)
                stop = await http.post(f"{url}/api/v1/abort", headers=service.headers("look"))
                # The service is reachable despite the number of connections.
                assert stop.status_code == 200
                assert reading.status_code == 200
                assert service.app.api.streams.count == 1
            for _, writer in idle:
                writer.close()

    asyncio.run(go())


def test_with_a_certificate_all_is_encrypted(flying: World, certificate: tuple[Path, Path]) -> None:
    section = HttpSection(tls_certificate=certificate[0], tls_key=certificate[1])

    async def go() -> None:
        service = served(flying)
        async with listened_to(service, tls_of(section)) as address:
            url = f"https://127.0.0.1:{address[1]}"
            context = ssl.create_default_context(cafile=str(certificate[0]))
            async with httpx.AsyncClient(verify=context) as http:
                own = {**service.headers(), "origin": url}
                assert (await http.get(f"{url}/api/v1/state", headers=own)).status_code == 200
                plain = {**service.headers(), "origin": url.replace("https", "http")}
                assert (await http.get(f"{url}/api/v1/state", headers=plain)).status_code == 403
            assert b"200" not in await response_of(address, b"GET /healthz HTTP/1.1\r\n\r\n")

    asyncio.run(go())


def test_a_certificate_that_cannot_be_used_is_reported_in_one_line(
    tmp_path: Path, certificate: tuple[Path, Path]
) -> None:
    wrong = tmp_path / "wrong.pem"
    wrong.write_text("no certificate")
    for pair in ((wrong, wrong), (certificate[0], wrong), (certificate[0], tmp_path / "none")):
        section = HttpSection(tls_certificate=pair[0], tls_key=pair[1])
        with pytest.raises(MissionServiceError, match="TLS with") as error:
            tls_of(section)
        assert "\n" not in str(error.value)


def test_addresses_are_written_as_browsers_read_them() -> None:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = listening.getsockname()[1]
        assert url_of(HttpSection(listen="localhost:0"), listening) == f"http://localhost:{port}"
        six = HttpSection(listen="[::1]:0")
        assert url_of(six, listening) == f"http://[::1]:{port}"
