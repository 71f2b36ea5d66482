"""Keeps the connection of a process to an MQTT broker.

After the loss of a connection, the client reconnects, at intervals that grow to ``MAX_WAIT_S``.
Every wait for the broker has a time limit. The modules that use the connection keep no queue that
grows while the broker is unreachable.
"""

import asyncio
import errno
import logging
import socket
import ssl
import traceback
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from mission_service.config.mqtt_names import Broker
from mission_service.errors import MissionServiceError

MIN_WAIT_S, MAX_WAIT_S = 0.25, 2.0  # waiting time before the next attempt to connect
KEEPALIVE_S = 5  # the connection counts as lost after twice this time without a packet
ANSWER_S = 3.0  # time limit for a response from the broker
TAKE_S = 15.0  # time limit for publishing: longer than the detection of a lost broker
STEADY_S = 5.0  # only a longer connection resets the interval between attempts
RECEIVE_BYTES = 32_768  # a larger socket buffer would only store outdated messages
REFUSED = {
    132: "it does not support MQTT 5",
    133: "it rejects this client identifier",
    134: "user or password is wrong",
    135: "user or password is wrong, or this user may not connect",
    138: "it has banned this client",
}


@dataclass(frozen=True, slots=True)
class BrokerAccess:
    """The credentials for a broker, and the TLS settings that verify the broker."""

    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: ssl.SSLContext | None = field(default=None, repr=False)


OPEN = BrokerAccess()


def tls_of(
    authority: Path | None = None, certificate: Path | None = None, key: Path | None = None
) -> ssl.SSLContext:
    """Return a TLS context that trusts ``authority``, by default the system's authorities.

    The context verifies host names. ``certificate`` and ``key`` authenticate the client. Raises
    MissionServiceError.
    """
    try:
        context = ssl.create_default_context(cafile=authority)
    except OSError as error:  # ssl.SSLError is an OSError
        raise MissionServiceError(f"{authority}: cannot be loaded: {_why(error)}") from None
    if certificate is not None:
        try:
            # Without a password, OpenSSL would prompt for a passphrase on the terminal.
            context.load_cert_chain(certificate, key, password=lambda: b"")
        except OSError as error:
            files = f"{certificate}, {key or 'no key file'}"
            text = f"{files}: the certificate and key cannot be loaded: {_why(error)}"
            raise MissionServiceError(text) from None
    return context


def _why(error: OSError) -> str:
    return error.strerror or str(error)


def client_to(
    broker: Broker,
    access: BrokerAccess = OPEN,
    *,
    logger: logging.Logger,
    inbox: asyncio.Queue[aiomqtt.Message],
    will: aiomqtt.Will | None = None,
    max_bytes: int | None = None,
) -> aiomqtt.Client:
    """Return an unconnected client that puts received messages in ``inbox``.

    With ``max_bytes`` the client uses MQTT 5, and the broker sends no larger packets. Earlier
    versions of MQTT have no such limit, and the client holds each packet in memory as a whole.
    """
    version, properties = aiomqtt.ProtocolVersion.V311, None
    if max_bytes is not None:
        version = aiomqtt.ProtocolVersion.V5
        properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        properties.MaximumPacketSize = max_bytes
    return aiomqtt.Client(
        broker.host,
        broker.port,
        username=access.user,
        password=access.password,
        tls_context=access.tls,
        protocol=version,
        properties=properties,
        will=will,
        logger=logger,
        keepalive=KEEPALIVE_S,
        timeout=ANSWER_S,
        queue_type=lambda maxsize: inbox,  # type: ignore[arg-type]  # any callable works
        socket_options=((socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES),),
    )


async def keep_connected(
    make: Callable[[logging.Logger], aiomqtt.Client],
    use: Callable[[aiomqtt.Client], Awaitable[None]],
    lost: Callable[[str], None],
) -> None:
    """Run ``use`` on a connected client until cancelled; after each failure use a new client.

    Args:
        make: returns a client that logs to the given logger.
        use: exchanges messages until the connection fails.
        lost: is called with the cause of each failed attempt and each lost connection. The cause
            includes the last error that the client logged; that error is not printed.
    """
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(_handle_loop_exception)
    wait_s, ends, task = MIN_WAIT_S, False, asyncio.current_task()
    while not ends:
        began_s, last_error = loop.time(), LastClientError()
        try:
            async with make(last_error.logger) as client:
                began_s = loop.time()
                try:
                    await use(client)
                except asyncio.CancelledError:
                    ends = True  # set first, because disconnecting may fail
                    raise
        except (aiomqtt.MqttError, OSError) as error:  # disconnecting over TLS may raise OSError
            lost(cause_of(error, last_error.text))
            # asyncio.wait_for (3.11) drops a cancellation that arrives as an attempt ends.
            ends = ends or (task is not None and task.cancelling() > 0)
        if not ends:
            wait_s = MIN_WAIT_S if loop.time() - began_s > STEADY_S else wait_s
            await asyncio.sleep(wait_s)
        wait_s = min(2.0 * wait_s, MAX_WAIT_S)
    raise asyncio.CancelledError


def cause_of(error: aiomqtt.MqttError | OSError, logged: str) -> str:
    """Return the cause of a failed connection as text, without passwords."""
    code = error.rc if isinstance(error, aiomqtt.MqttCodeError) else None
    if isinstance(code, ReasonCode) and code.value in REFUSED:
        return REFUSED[code.value]
    texts = (str(error), logged, str(error.__cause__ or ""))
    return "; ".join(dict.fromkeys(filter(None, texts)))


class LastClientError(logging.Handler):
    """A logging handler that stores the last error of a client.

    Without this handler, the cause is lost: the exceptions of aiomqtt only report a missing
    response.
    """

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.text = ""
        self.logger = logging.Logger("mqtt", logging.ERROR)
        self.logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Store the text of the record."""
        self.text = record.getMessage()


async def together(*coroutines: Coroutine[Any, Any, None]) -> None:
    """Run coroutines until one ends, cancel the others, then raise the first one's exception."""
    tasks = {asyncio.create_task(coroutine) for coroutine in coroutines}
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        await _end(tasks)
    for task in ended:
        task.result()


def _handle_loop_exception(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Pass exceptions to the loop's default handler, except two kinds that aiomqtt causes.

    aiomqtt may register a writer for a socket that is being closed (EBADF). aiomqtt may also store
    the cause of a lost connection in a future that is not awaited; ``keep_connected`` reports that
    cause.
    """
    error = context.get("exception")
    closed = isinstance(error, OSError) and error.errno == errno.EBADF
    if not closed and not (error is not None and _from_client(error)):
        loop.default_exception_handler(context)


def _from_client(error: BaseException) -> bool:
    """Return whether aiomqtt or paho raised an exception."""
    frames = traceback.walk_tb(error.__traceback__)
    packages = {str(frame.f_globals.get("__name__")).partition(".")[0] for frame, _ in frames}
    return isinstance(error, aiomqtt.MqttError) or not packages.isdisjoint(("aiomqtt", "paho"))


async def _end(tasks: set[asyncio.Task[None]]) -> None:
    """Cancel tasks until they end: ``wait_for`` before Python 3.12 may lose a cancellation."""
    running = tasks
    while running:
        for task in running:
            task.cancel()
        _, running = await asyncio.wait(running, timeout=0.1)
    for task in tasks:
        if not task.cancelled():
            task.exception()  # marks the exception as retrieved; ``together`` raises the first
