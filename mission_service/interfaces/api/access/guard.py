"""Guards all routes: checks the origin, token, rate, size and speed of each request.

The guard is a plain ASGI application, so that it covers all routes. The guard checks host and
origin first, then token, rate and the number of concurrent requests. Clients without a token have a
separate limit. No limit applies to health routes, or to an abort with a valid token. The guard
carries out an abort as soon as the headers of the request have arrived. The guard reads bodies
before it awaits anything else, so that a complete request is carried out even if the client has
closed the connection meanwhile.
"""

import asyncio
import ipaddress
import math
from collections.abc import Callable, Collection
from typing import Any

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mission_service.interfaces.api.access.auth import LONGEST_TOKEN, Tokens, User
from mission_service.interfaces.api.access.client_connections import client_at
from mission_service.interfaces.api.live_stream import MAX_STREAMS, TooSlowError
from mission_service.interfaces.api.responses import (
    MAX_BODY_BYTES,
    MAX_PERIMETER_BYTES,
    ApiError,
    error_body,
)
from mission_service.interfaces.limits import ConcurrencyLimiter, RateLimiter

ABORT = "/api/v1/abort"
UPLOADS = ("/api/v1/fire/perimeter", "/api/v1/fire/observations/geotiff", "/api/v1/photos")
BODY_WITHIN_S = 20.0
PREFIXES_WITH_TOKEN = ("/api/", "/metrics")
HEALTH = ("/healthz", "/readyz")
# Limits on concurrent requests with a token: for requests that read (including live streams), and
# for requests that change something.
MAX_READING, MAX_CHANGING = 64 + MAX_STREAMS, 64
# Limits on concurrent requests from tokens with only the role observe: for all such tokens
# together, and for each token. Observations wait for the estimate; requests of operators must not
# wait for detectors.
MAX_DETECTING, MAX_OF_A_DETECTOR = 24, 4
# Limits on concurrent requests without a token (for the page): for all clients together, and for
# each client.
MAX_ANONYMOUS, MAX_OF_AN_ANONYMOUS = 32, 16
# A client that reads nothing for this long is disconnected, with or without a token.
SEND_WITHIN_S, ANONYMOUS_WITHIN_S = 30.0, 10.0
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "font-src 'self'; media-src 'self' data:; connect-src 'self'; worker-src 'self' blob:; "
    "manifest-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
HEADERS = {
    b"content-security-policy": CSP.encode(),
    b"x-content-type-options": b"nosniff",
    b"x-frame-options": b"DENY",
    b"referrer-policy": b"no-referrer",
    b"cross-origin-resource-policy": b"same-origin",
    b"cross-origin-opener-policy": b"same-origin",
}


class AccessGuard:
    """The ASGI application in front of the routes."""

    def __init__(
        self,
        app: ASGIApp,
        tokens: Tokens,
        hosts: Collection[str],
        now_s: Callable[[], float],
        abort: Callable[[User, bytes], Any],
    ) -> None:
        """Make the guard of ``app``.

        ``abort`` receives the user and the query string, and carries out an abort; it may raise
        ApiError. ``hosts`` are the accepted host names and addresses without ports, including the
        name of a TLS proxy in front of the service. Loopback and the local address of a connection
        are always accepted. ``now_s`` is a monotonic clock.
        """
        self._app = app
        self._tokens = tokens
        self._hosts = {host.lower() for host in (*hosts, "localhost")}
        self._by_proxy = {f"https://{host.lower()}" for host in hosts}
        self._now_s = now_s
        self._abort = abort
        self._readers = ConcurrencyLimiter(MAX_READING, MAX_READING)
        self._changers = ConcurrencyLimiter(MAX_CHANGING, MAX_CHANGING)
        self._detectors = ConcurrencyLimiter(MAX_DETECTING, MAX_OF_A_DETECTOR)
        self._anonymous = ConcurrencyLimiter(MAX_ANONYMOUS, MAX_OF_AN_ANONYMOUS)
        self._reading = RateLimiter(rate_s=100.0, burst=400.0)
        self._changing = RateLimiter(rate_s=10.0, burst=40.0)
        self._failing = RateLimiter(rate_s=1.0, burst=20.0)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":  # no other protocol is served
            return
        bounded = _Bounded(scope, send)
        try:
            client = self._admit(scope)
            if scope["path"] == ABORT and scope["method"] == "POST":
                user, query = scope["state"]["user"], scope["query_string"]
                scope["state"]["aborted"] = self._abort(user, query)
            limiter = self._limiter(scope)
            if limiter is not None and not limiter.acquire(client):
                text = f"too many concurrent requests; {limiter.limits}; try again later"
                raise ApiError(503, text, {"retry-after": "1"})
        except ApiError as error:
            await _refuse(bounded, error)
            return
        try:
            if limiter in (self._changers, self._detectors):
                receive = await _whole(scope, receive)
            await self._app(scope, receive, bounded)
        except _DisconnectedError:
            return
        except ApiError as error:  # an error in the body
            await _refuse(bounded, error)
        except TooSlowError:
            await _cut(scope)
        finally:
            if limiter is not None:
                limiter.release(client)

    def _limiter(self, scope: Scope) -> ConcurrencyLimiter | None:
        """Return the limiter that applies to a request; None for routes without a limit."""
        if scope["path"] == ABORT or scope["path"] in HEALTH:
            return None
        user: User | None = scope["state"]["user"]
        if user is None:
            return self._anonymous
        if _reads(scope):
            return self._readers
        return self._changers if user.may("look") else self._detectors

    def _admit(self, scope: Scope) -> str:
        """Check a request, store the user in the state, and return the client. Raises ApiError."""
        headers = _headers(scope)
        host = self._check_host(headers.get(b"host", []), scope.get("server"))
        _refuse_other_sites(headers, {_origin(scope, host), *self._by_proxy})
        path, client = scope["path"], client_at(scope.get("client"))
        scope.setdefault("state", {})["user"] = None
        if path.startswith(PREFIXES_WITH_TOKEN):
            user = self._user_of(headers.get(b"authorization", []), client)
            scope["state"]["user"] = user
            client = f"token {user.name}"
            scope["state"].get("proven", _nothing)()
        if path != ABORT and path not in HEALTH:
            self._check_rate(self._reading if _reads(scope) else self._changing, client)
            _refuse_long(headers.get(b"content-length", []))
        return client

    def _check_host(self, given: list[bytes], server: object) -> str:
        host = given[0].decode("latin-1").lower() if len(given) == 1 else ""
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        if name not in self._hosts and not _is_own_address(name.strip("[]"), server):
            raise ApiError(403, "wrong Host header: use the service's address or a name in `hosts`")
        return host

    def _user_of(self, given: list[bytes], client: str) -> User:
        scheme = {"www-authenticate": "Bearer"}
        if not given:
            raise ApiError(401, "a token is required: Authorization: Bearer TOKEN", scheme)
        kind, _, token = given[0].decode("latin-1").strip().partition(" ")
        token = token.strip()
        if len(given) == 1 and kind.lower() == "bearer" and len(token) <= LONGEST_TOKEN:
            user = self._tokens.user_of(token)
            if user is not None:
                return user
        self._check_rate(self._failing, client)
        raise ApiError(401, "this token is not valid", scheme)

    def _check_rate(self, limiter: RateLimiter, client: str) -> None:
        wait_s = math.ceil(limiter.consume(client, self._now_s()))
        if wait_s > 0:
            text = f"too many requests; try again in {wait_s} s"
            raise ApiError(429, text, {"retry-after": str(wait_s)})


class _DisconnectedError(Exception):
    """The connection ended before the whole request had arrived."""


async def _whole(scope: Scope, receive: Receive) -> Receive:
    """Read a whole body; return a ``receive`` that passes the body to the routes as one message.

    Raises ApiError 413 for a body that is too long, ApiError 408 for a body that does not arrive in
    time, and _DisconnectedError.
    """
    max_bytes = MAX_PERIMETER_BYTES if scope["path"] in UPLOADS else MAX_BODY_BYTES
    body, more = bytearray(), True
    try:
        async with asyncio.timeout(BODY_WITHIN_S):
            while more:
                message = await receive()
                if message["type"] != "http.request":
                    raise _DisconnectedError
                body += message.get("body", b"")
                more = message.get("more_body", False)
                if len(body) > max_bytes:
                    raise ApiError(413, f"the body has more than {max_bytes} bytes")
    except TimeoutError:
        raise ApiError(408, f"the body did not arrive within {BODY_WITHIN_S:g} s") from None
    unread = [{"type": "http.request", "body": bytes(body), "more_body": False}]

    async def receive_whole() -> Message:
        return unread.pop() if unread else await receive()

    return receive_whole


class _Bounded:
    """A ``send`` that adds common headers and raises TooSlowError if a client reads too slowly."""

    def __init__(self, scope: Scope, send: Send) -> None:
        self._send = send
        self._path = scope["path"]
        self._scope = scope

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *self._headers(message)]}
        try:
            anonymous = self._scope.get("state", {}).get("user") is None
            async with asyncio.timeout(ANONYMOUS_WITHIN_S if anonymous else SEND_WITHIN_S):
                await self._send(message)
        except TimeoutError:
            raise TooSlowError from None

    def _headers(self, message: Message) -> list[tuple[bytes, bytes]]:
        present = {name.lower() for name, _ in message.get("headers", [])}
        private = self._path.startswith(PREFIXES_WITH_TOKEN)
        headers = {**HEADERS, b"cache-control": b"no-store" if private else b"no-cache"}
        return [header for header in headers.items() if header[0] not in present]


def _reads(scope: Scope) -> bool:
    return scope["method"] in ("GET", "HEAD")


def _nothing() -> None:
    """Do nothing: the default callback for servers without ``proven`` and ``cut``."""


def _headers(scope: Scope) -> dict[bytes, list[bytes]]:
    found: dict[bytes, list[bytes]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.lower(), []).append(value)
    return found


def _is_own_address(name: str, server: object) -> bool:
    """Return whether a host is loopback or the connection's local address (``server``)."""
    try:
        address = ipaddress.ip_address(name)
        own = ipaddress.ip_address(server[0] if isinstance(server, tuple) else "")
    except ValueError:
        return False
    return address.is_loopback or address == own


def _origin(scope: Scope, host: str) -> str:
    return f"{scope.get('scheme', 'http')}://{host}"


def _refuse_other_sites(headers: dict[bytes, list[bytes]], own: Collection[str]) -> None:
    """Refuse requests from pages of other sites, based on the headers that browsers send."""
    for origin in headers.get(b"origin", []):
        if origin.decode("latin-1").lower() not in own:
            raise ApiError(403, "pages from other origins may not use the service")
    for site in headers.get(b"sec-fetch-site", []):
        if site.lower() not in (b"same-origin", b"none"):
            raise ApiError(403, "pages from other sites may not use the service")


def _refuse_long(given: list[bytes]) -> None:
    for length in given:
        if length.isdigit() and int(length) > MAX_PERIMETER_BYTES:
            raise ApiError(413, f"the body has more than {MAX_PERIMETER_BYTES} bytes")


async def _refuse(send: Send, error: ApiError) -> None:
    body = error_body(str(error))
    headers: list[tuple[bytes, bytes]] = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
        *((name.encode(), value.encode()) for name, value in (error.headers or {}).items()),
    ]
    try:
        await send({"type": "http.response.start", "status": error.status, "headers": headers})
        await send({"type": "http.response.body", "body": body})
    except TooSlowError:  # the client has not read earlier responses of this connection
        return


async def _cut(scope: dict[str, Any] | Scope) -> None:
    """Close a connection even if its buffer is not empty, if the server supports that."""
    scope.get("state", {}).get("cut", _nothing)()
    await asyncio.sleep(0)  # lets the server process the end of the connection
