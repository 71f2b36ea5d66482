"""Runs uvicorn inside the daemon, which controls tasks, signals and the shutdown.

uvicorn provides the HTTP protocol (h11) and the main loop. This module adds the listening socket,
TLS, timeouts, the connection limits (``access/client_connections.py``) and the shutdown. This
module depends on uvicorn's internals, so pyproject.toml restricts uvicorn's version.
"""

import asyncio
import contextlib
import errno
import logging
import socket
import ssl
from collections.abc import AsyncIterator, Iterator
from functools import partial
from typing import Any

import uvicorn
from h11 import ERROR
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from mission_service.config.service_section import HttpSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.api.access.client_connections import (
    ClientConnection,
    ClientConnections,
    client_at,
)
from mission_service.interfaces.api.access.guard import HEADERS
from mission_service.interfaces.api.responses import error_body

REQUEST_WITHIN_S = 10.0  # time limit for headers, from the first byte or the connection's start
KEEP_ALIVE_S = 30
HANDSHAKE_WITHIN_S = 5.0
NO_ROOM_S = 0.05  # time until the next attempt to accept a connection
STOP_WITHIN_S = 1  # open connections are closed this long after a shutdown begins
MAX_HEADER_BYTES = 16 * 1024
SEND_BUFFER_BYTES = 128 * 1024  # a larger kernel buffer would store outdated states


@contextlib.contextmanager
def bound(section: HttpSection) -> Iterator[socket.socket]:
    """Open a listening socket; if the default port is in use, use a free port.

    Raises MissionServiceError if the address cannot be used.
    """
    try:
        listening = _listening_on(section, section.port)
    except OSError as error:
        why, in_use = error.strerror or str(error), error.errno == errno.EADDRINUSE
        if in_use and section.listen is None:
            listening = _listening_on(section, 0)
        else:
            if in_use:
                why = "the port is in use, perhaps by another service; change it in [service.http]"
            raise MissionServiceError(f"HTTP on {section.address}: {why}") from None
    with listening:
        yield listening


def _listening_on(section: HttpSection, port: int) -> socket.socket:
    """Return a listening socket. Raises OSError."""
    family = socket.AF_INET6 if ":" in section.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        listening.bind((section.host, port))
        listening.listen(128)
        listening.setblocking(False)
    except OSError:
        listening.close()
        raise
    return listening


def url_of(section: HttpSection, listening: socket.socket) -> str:
    """Return the URL for browsers, for example http://127.0.0.1:8765."""
    host = f"[{section.host}]" if ":" in section.host else section.host
    scheme = "http" if section.tls_certificate is None else "https"
    return f"{scheme}://{host}:{listening.getsockname()[1]}"


def tls_of(section: HttpSection) -> ssl.SSLContext | None:
    """Return the context for TLS 1.2 and later, or None if no certificate is configured.

    Raises MissionServiceError for an unusable certificate or key.
    """
    certificate, key = section.tls_certificate, section.tls_key
    if certificate is None or key is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    # Session tickets are written before the request is read. If the client has sent its request and
    # closed the connection, this write fails, and asyncio discards the unread request.
    context.num_tickets = 0
    try:
        # Without a callback, OpenSSL would prompt for a key's password on the terminal.
        context.load_cert_chain(certificate, key, password=_no_password)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise MissionServiceError(
            f"TLS with {certificate} and {key}: {why}; both must be PEM, and the key must match"
        ) from None
    return context


def _no_password() -> str:
    raise ValueError("the key has a password; configure a key without one")


@contextlib.asynccontextmanager
async def serving(
    app: ASGIApp, listening: socket.socket, stopping: asyncio.Event, tls: ssl.SSLContext | None
) -> AsyncIterator[None]:
    """Serve ``app`` within this context; at the end, set ``stopping`` first to end all streams."""
    config = uvicorn.Config(
        app,
        http=Connection,
        ws="none",
        loop="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        timeout_keep_alive=KEEP_ALIVE_S,
        timeout_graceful_shutdown=STOP_WITHIN_S,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
    )
    # uvicorn logs a warning for each request that is not HTTP; these warnings could fill the disk.
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    server = _Server(config, listening, tls)
    running = asyncio.create_task(server.serve())
    try:
        await server.ready.wait()
        yield
    finally:
        stopping.set()
        server.stop.set()
        await running
        for connection in list(server.server_state.connections):
            connection.transport.abort()


def _shut(client: socket.socket) -> None:
    with contextlib.suppress(OSError):  # already closed
        client.shutdown(socket.SHUT_RDWR)


class _Server(uvicorn.Server):
    """A uvicorn server on a given socket, without signal handlers and with a slower main loop."""

    def __init__(
        self, config: uvicorn.Config, listening: socket.socket, tls: ssl.SSLContext | None
    ) -> None:
        super().__init__(config)
        self._listening = listening
        self._tls = tls
        self._connections = ClientConnections()
        self._beginning: set[asyncio.Task[None]] = set()
        self.ready = asyncio.Event()
        self.stop = asyncio.Event()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        self.servers = []
        self._accepting = asyncio.create_task(self._accept())
        self.started = True
        self.ready.set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        for task in (self._accepting, *self._beginning):
            task.cancel()
        await asyncio.gather(self._accepting, *self._beginning, return_exceptions=True)
        await super().shutdown(sockets)

    async def _accept(self) -> None:
        """Accept connections one by one; count each before reading from it."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                client, address = await loop.sock_accept(self._listening)
            except OSError:  # no file descriptor left, or the client has closed the connection
                self._connections.cut_one()
                await asyncio.sleep(NO_ROOM_S)
                continue
            connection = ClientConnection(client_at(address), partial(_shut, client))
            self._connections.add(connection)
            task = asyncio.create_task(self._begin(client, connection))
            self._beginning.add(task)
            task.add_done_callback(self._beginning.discard)

    async def _begin(self, client: socket.socket, connection: ClientConnection) -> None:
        """Attach the protocol to a connection, after the TLS handshake if TLS is configured."""
        loop = asyncio.get_running_loop()
        begun = False

        def protocol() -> asyncio.Protocol:
            return Connection(self._connections, connection, self.config, self.server_state, {})

        try:
            await loop.connect_accepted_socket(
                protocol,
                client,
                ssl=self._tls,
                ssl_handshake_timeout=None if self._tls is None else HANDSHAKE_WITHIN_S,
            )
            begun = True
        except OSError:  # closed during the handshake
            pass
        finally:
            if not begun:
                self._connections.remove(connection)
                client.close()

    async def main_loop(self) -> None:
        while not self.stop.is_set():
            await self.on_tick(0)  # updates the Date header
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self.stop.wait(), 1.0)


class Connection(H11Protocol):
    """One connection, with a time limit for headers.

    ``scope["state"]`` has two functions: ``cut`` closes the connection, and ``proven`` marks the
    connection as having a valid token.
    """

    def __init__(
        self, connections: ClientConnections, connection: ClientConnection, *args: Any
    ) -> None:
        super().__init__(*args)
        self._connections = connections
        self._connection = connection
        self._timeout: asyncio.TimerHandle | None = None
        routes = self.app

        async def app(scope: Scope, receive: Receive, send: Send) -> None:
            prove = partial(self._connections.prove, self._connection)
            scope["state"] = {"cut": self.transport.abort, "proven": prove}
            await routes(scope, receive, send)

        self.app = app

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)  # type: ignore[arg-type]
        self._connection.cut = self.transport.abort
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        self._expect_nothing()
        self._connections.remove(self._connection)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self._timeout is None and self._idle:
            self._expect_request()
        super().data_received(data)
        if not self._idle:
            self._expect_nothing()

    def send_400_response(self, msg: str) -> None:
        """Reply to data that are not HTTP with an error in the common form, and disconnect."""
        if self.conn.our_state is ERROR or (self.cycle and self.cycle.response_started):
            self.transport.close()
            return
        body = error_body("this is not an HTTP request, or its headers are too long")
        lines = [b"HTTP/1.1 400 Bad Request", b"content-type: application/json"]
        lines += [b"content-length: %d" % len(body), b"connection: close"]
        lines += [b"cache-control: no-store", *(b"%b: %b" % each for each in HEADERS.items())]
        self.transport.write(b"\r\n".join([*lines, b"", body]))
        self.transport.close()

    @property
    def _idle(self) -> bool:
        """Return whether no request is being handled."""
        return self.cycle is None or self.cycle.response_complete

    def _expect_request(self) -> None:
        self._timeout = self.loop.call_later(REQUEST_WITHIN_S, self.transport.abort)

    def _expect_nothing(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None
