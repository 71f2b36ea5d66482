"""The connection of a process to an MQTT broker.

A lost connection is made again, at intervals that grow to ``MAX_WAIT_S``. Every wait for the
broker has a time limit here. The users of the connection keep no queue that grows without a broker.
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

MIN_WAIT_S, MAX_WAIT_S = 0.25, 2.0  # before the next attempt to reach the broker
KEEPALIVE_S = 5  # a broker that is silent for twice as long is lost
ANSWER_S = 3.0  # limit for an answer of the broker
TAKE_S = 15.0  # limit for publishing: longer than the detection of a lost broker
STEADY_S = 5.0  # only a longer connection resets the interval between attempts
RECEIVE_BYTES = 32_768  # a larger buffer would only hold old messages
REFUSED = {
    132: "it does not support MQTT 5",
    133: "it rejects this client identifier",
    134: "user or password is wrong",
    135: "user or password is wrong, or this user may not connect",
    138: "it has banned this client",
}


@dataclass(frozen=True, slots=True)
class BrokerAccess:
    """Credentials for a broker, and the TLS settings that verify the broker."""

    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: ssl.SSLContext | None = field(default=None, repr=False)


OPEN = BrokerAccess()


def tls_of(
    authority: Path | None = None, certificate: Path | None = None, key: Path | None = None
) -> ssl.SSLContext:
    """TLS that trusts ``authority``, or else the machine's authorities; checks host names.

    ``certificate`` and ``key`` authenticate the client. Raises MissionServiceError.
    """
    try:
        context = ssl.create_default_context(cafile=authority)
    except OSError as error:  # ssl.SSLError is one
        raise MissionServiceError(f"{authority}: no certificates to trust: {_why(error)}") from None
    if certificate is not None:
        try:
            # Without a password, OpenSSL would prompt for a passphrase on the terminal.
            context.load_cert_chain(certificate, key, password=lambda: b"")
        except OSError as error:
            text = f"{certificate}, {key or 'no key file'}: no certificate and key: {_why(error)}"
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
    """A client that is not connected yet. Messages that it receives go into ``inbox``.

    With ``max_bytes`` it uses MQTT 5, and the broker sends it no larger packet. Earlier versions
    have no such limit, and a packet is in memory as a whole.
    """
    limit = None
    if max_bytes is not None:
        limit = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        limit.MaximumPacketSize = max_bytes
    five = max_bytes is not None
    return aiomqtt.Client(
        broker.host,
        broker.port,
        username=access.user,
        password=access.password,
        tls_context=access.tls,
        protocol=aiomqtt.ProtocolVersion.V5 if five else aiomqtt.ProtocolVersion.V311,
        properties=limit,
        will=will,
        logger=logger,
        keepalive=KEEPALIVE_S,
        timeout=ANSWER_S,
        queue_type=lambda maxsize: inbox,  # type: ignore[arg-type]  # any callable does
        socket_options=((socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES),),
    )


async def keep_connected(
    make: Callable[[logging.Logger], aiomqtt.Client],
    use: Callable[[aiomqtt.Client], Awaitable[None]],
    lost: Callable[[str], None],
) -> None:
    """Connect and ``use`` one client after another, until cancelled.

    ``lost`` is called with the reason of every attempt and connection that failed. The reason
    contains the last line that the client logged, which is not printed.
    """
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(_all_but_known)
    wait_s, ends, task = MIN_WAIT_S, False, asyncio.current_task()
    while not ends:
        began_s, last_words = loop.time(), LastClientError()
        try:
            async with make(last_words.logger) as client:
                began_s = loop.time()
                try:
                    await use(client)
                except asyncio.CancelledError:
                    ends = True  # even if disconnecting fails
                    raise
        except (aiomqtt.MqttError, OSError) as error:  # OSError: from disconnecting over TLS
            lost(in_words(error, last_words.text))
            # asyncio.wait_for (3.11) drops a cancellation that meets the end of an attempt.
            ends = ends or (task is not None and task.cancelling() > 0)
        if not ends:
            wait_s = MIN_WAIT_S if loop.time() - began_s > STEADY_S else wait_s
            await asyncio.sleep(wait_s)
        wait_s = min(2.0 * wait_s, MAX_WAIT_S)
    raise asyncio.CancelledError


def in_words(error: aiomqtt.MqttError | OSError, last_words: str = "") -> str:
    """The reason of a failed connection as text; never contains a password."""
    code = error.rc if isinstance(error, aiomqtt.MqttCodeError) else None
    if isinstance(code, ReasonCode) and code.value in REFUSED:
        return REFUSED[code.value]
    cause = error.__cause__
    words = [str(error), last_words, "" if cause is None else str(cause)]
    return "; ".join(dict.fromkeys(filter(None, words)))


class LastClientError(logging.Handler):
    """Keeps the last error that a client logged; aiomqtt itself only reports a missing answer."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.text = ""
        self.logger = logging.Logger("mqtt", logging.ERROR)
        self.logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the text of the record."""
        self.text = record.getMessage()


async def together(*peer_messaging: Coroutine[Any, Any, None]) -> None:
    """Run coroutines until one ends, then cancel the others; raises the exception of the first."""
    tasks = {asyncio.create_task(talk) for talk in peer_messaging}
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        await _end(tasks)
    for task in ended:
        task.result()


def _all_but_known(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Handle exceptions of the loop; drop two of aiomqtt that need no report.

    aiomqtt may register a writer for a socket that is just being closed (EBADF). It may also keep
    the reason of a lost connection in a future that is not awaited; that reason is reported
    elsewhere.
    """
    error = context.get("exception")
    closed = isinstance(error, OSError) and error.errno == errno.EBADF
    if not closed and not (error is not None and _is_clients(error)):
        loop.default_exception_handler(context)


def _is_clients(error: BaseException) -> bool:
    """Whether an exception comes from aiomqtt or paho."""
    frames = traceback.walk_tb(error.__traceback__)
    passed = {str(frame.f_globals.get("__name__")).partition(".")[0] for frame, _ in frames}
    return isinstance(error, aiomqtt.MqttError) or not passed.isdisjoint(("aiomqtt", "paho"))


async def _end(tasks: set[asyncio.Task[None]]) -> None:
    """Cancel tasks until they end: before Python 3.12 ``wait_for`` may swallow a cancellation."""
    left = tasks
    while left:
        for task in left:
            task.cancel()
        _, left = await asyncio.wait(left, timeout=0.1)
    for task in tasks:
        if not task.cancelled():
            task.exception()  # marks it as retrieved; the caller raises one
