"""Opens the daemon's HTTP interface, and checks the port and files before the run begins."""

import contextlib
import socket
import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mission_service.config.service_section import HttpSection
from mission_service.interfaces.api.access.auth import Tokens, own_token
from mission_service.interfaces.api.app import app_of
from mission_service.interfaces.api.server import bound, serving, tls_of, url_of
from mission_service.runtime.run_context import RunContext


@dataclass(frozen=True)
class HttpListener:
    """The HTTP interface of a run: its listening socket, its TLS context and the valid tokens.

    ``address`` may contain a token, so it must not be logged.
    """

    listening: socket.socket
    tokens: Tokens
    tls: ssl.SSLContext | None
    address: str
    wanted_port: int

    @property
    def other_port_text(self) -> str:
        """A line for the operator if the port is not the configured one, otherwise ``""``."""
        port = self.listening.getsockname()[1]
        if self.wanted_port in (0, port):
            return ""
        return (
            f"port {self.wanted_port} is in use, perhaps by another service: the map is on port "
            f"{port}"
        )

    async def __call__(self, context: RunContext) -> None:
        """Serve until cancelled; the shutdown takes at most two seconds."""
        app = app_of(context, self.tokens)
        context.gauges["stream_clients"] = lambda: app.api.streams.count
        context.gauges["forecast_seconds"] = lambda: context.forecasts.took_s
        async with serving(app.asgi, self.listening, app.api.streams.stopping, self.tls):
            await context.forecasts.follow()


@contextlib.contextmanager
def http_interface(section: HttpSection, out: Path) -> Iterator[HttpListener]:
    """Open the HTTP interface of the run in the folder ``out``. Raises MissionServiceError."""
    tls = tls_of(section)
    with bound(section) as listening:
        address = url_of(section, listening)
        if section.tokens is not None:
            tokens, address = Tokens.of_file(section.tokens), f"{address}/"
        else:
            tokens, address = Tokens.of_run(out), f"{address}/#token={own_token(out)}"
        yield HttpListener(listening, tokens, tls, address, section.port)
