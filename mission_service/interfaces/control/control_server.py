"""Serves the control socket of a live run, ``OUT/control.sock``: a reply for each line of JSON.

Only the user that runs the service may open the socket (mode 0600). The reply to an invalid request
contains the error; the request has no effect. The service accepts an abort from every client, with
any content, even if the client limit has been reached.
"""

import asyncio
import contextlib
import socket
import stat
from collections import deque
from collections.abc import Awaitable, Iterator
from pathlib import Path

import msgspec

from mission_service.errors import ControlError
from mission_service.runtime.request_handler import Answer, RequestHandler, wrong

MAX_LINE_BYTES = 64 * 1024
MAX_CLIENTS = 16
MAX_WAITING = 64  # from this number on, the oldest client that may only abort is closed
IDLE_S = 60.0
LATE_CLIENT_S = 2.0
MAX_QUEUED = 100  # queued lines at which reading pauses
FRESH_S = 2.0  # lines that arrived within this time before a disconnection are carried out
LONGEST_PATH_BYTES = 107  # limit for Unix-domain sockets on Linux


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[socket.socket]:
    """Open the listening socket at ``path``, and remove it when the context ends.

    The socket of a killed run is replaced. Raises ControlError if another run uses the socket, if
    ``path`` is another type of file, or if the socket cannot be created.
    """
    _refuse_long(path)
    _clear(path)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # The mode is set before ``listen``, because clients can connect from then on.
        listening.bind(str(path))
        path.chmod(0o600)
        listening.listen(MAX_WAITING)
        listening.setblocking(False)
    except OSError as error:
        listening.close()
        raise ControlError(f"{path}: cannot be created: {error.strerror}") from None
    made = path.stat().st_ino
    try:
        yield listening
    finally:
        listening.close()
        with contextlib.suppress(FileNotFoundError):
            if path.stat().st_ino == made:
                path.unlink()


def _refuse_long(path: Path) -> None:
    length = len(str(path).encode())
    if length > LONGEST_PATH_BYTES:
        raise ControlError(
            f"{path}: the path of the control socket has {length} bytes; the limit is "
            f"{LONGEST_PATH_BYTES}; choose a shorter --out"
        )


def _clear(path: Path) -> None:
    """Remove the socket of a killed run."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise ControlError(f"{path}: cannot be created: {error.strerror}") from None
    if not stat.S_ISSOCK(mode):
        raise ControlError(f"{path}: is not a socket; move this file to another folder")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            path.unlink(missing_ok=True)
            return
        except OSError as error:
            raise ControlError(f"{path}: cannot be checked: {error.strerror}") from None
    raise ControlError(
        f"{path}: another run uses this socket; stop that run, or choose another --out"
    )


async def serve_control(listening: socket.socket, request_handler: RequestHandler) -> None:
    """Reply to clients until cancelled. Raises the exception of a request that failed."""
    loop = asyncio.get_running_loop()
    clients = _Clients(request_handler, loop.create_future())
    server = await loop.create_unix_server(lambda: _Client(clients), sock=listening)
    try:
        await clients.failed
    finally:
        server.close()
        for client in list(clients.connected):
            client.cut()


class _Clients:
    """The connected clients, in order of connection."""

    def __init__(self, request_handler: RequestHandler, failed: asyncio.Future[None]) -> None:
        self.request_handler = request_handler
        self.failed = failed
        self.connected: dict[_Client, None] = {}

    def add(self, client: "_Client") -> bool:
        """Add a client; return True if the client exceeds the limit and may only abort."""
        late = len(self.connected) >= MAX_CLIENTS
        if len(self.connected) >= MAX_WAITING:
            next(each for each in self.connected if each.late).cut()
        self.connected[client] = None
        return late


class _Client(asyncio.Protocol):
    """One client; its complete lines are carried out even if the client disconnects meanwhile.

    An abort is carried out as soon as it is read, before earlier lines, and needs no newline. Each
    iteration of the event loop handles one other line. Replies are sent in the order of the lines.
    """

    def __init__(self, clients: _Clients) -> None:
        self.late = False
        self._clients = clients
        self._loop = asyncio.get_running_loop()
        self._rest = b""
        # Lines to handle, and finished replies to later lines.
        self._queued: deque[bytes | Answer | Awaitable[Answer]] = deque()
        self._read_s = 0.0
        self._after_abort = False  # the newline after an abort has not arrived
        self._scheduled = self._unread = self._ended = self._disconnected = False
        self._task: asyncio.Task[None] | None = None  # handles the current line

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Add the client."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self.late = self._clients.add(self)
        self._timeout = self._loop.call_later(self._idle_s, self.cut)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the client; carry out the lines that arrived within the last ``FRESH_S``."""
        self._disconnected = True
        self._timeout.cancel()
        self._clients.connected.pop(self, None)
        if self._loop.time() - self._read_s > FRESH_S:
            self._queued.clear()
        self._schedule()

    def cut(self) -> None:
        """End the connection at once."""
        self._clients.connected.pop(self, None)
        self._transport.abort()

    def data_received(self, data: bytes) -> None:
        """Split received data into lines."""
        self._read_s = self._loop.time()
        if self._after_abort:
            data, self._after_abort = data.removeprefix(b"\n"), False
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._accept(line)
        if len(self._rest) > MAX_LINE_BYTES:
            self._accept(self._rest)
        elif _is_abort(self._rest):
            self._accept(self._rest)
            self._rest, self._after_abort = b"", True
        if len(self._queued) > MAX_QUEUED:
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        """Accept a last line without a newline; keep the connection until all replies are sent."""
        if self._rest:
            self._accept(self._rest)
        self._ended = True
        self._schedule()
        return True

    def pause_writing(self) -> None:
        """Stop handling lines: the client does not read its replies."""
        self._unread = True

    def resume_writing(self) -> None:
        """Resume handling lines: the client reads its replies again."""
        self._unread = False
        self._schedule()

    @property
    def _idle_s(self) -> float:
        return LATE_CLIENT_S if self.late else IDLE_S

    def _accept(self, line: bytes) -> None:
        if self._ended:
            return
        if len(line) > MAX_LINE_BYTES:
            self._queued.append(wrong(f"the line has more than {MAX_LINE_BYTES} bytes"))
            self._ended = True
        elif _is_abort(line):
            self._queued.append(self._answer(_as_valid_utf8(line)))
        elif self.late:
            text = f"{MAX_CLIENTS} clients are connected (the limit); only an abort is accepted"
            self._queued.append(wrong(text))
        else:
            self._queued.append(line)
        self._ended = self._ended or self.late
        self._schedule()

    def _schedule(self) -> None:
        if not self._scheduled and (self._disconnected or not self._unread):
            self._scheduled = True
            self._loop.call_soon(self._handle_line)

    def _handle_line(self) -> None:
        """Handle one line; the reply and the next line may have to wait for a thread."""
        first = self._queued.popleft() if self._queued else None
        answer = self._answer(first) if isinstance(first, bytes) else first
        if answer is None or isinstance(answer, dict):
            self._reply(answer)
        else:
            self._task = self._loop.create_task(self._reply_after(answer))

    def _reply(self, answer: Answer | None) -> None:
        """Send the reply to a line, if there is one, and continue with the next line."""
        self._scheduled = False
        if answer is not None and not self._disconnected:
            self._transport.write(msgspec.json.encode(answer) + b"\n")
            self._timeout.cancel()
            self._timeout = self._loop.call_later(self._idle_s, self.cut)
        if self._queued:
            self._schedule()
        elif self._ended:
            self._transport.close()
        elif not self._disconnected:
            self._transport.resume_reading()

    def _answer(self, line: bytes) -> Answer | Awaitable[Answer]:
        try:
            return self._clients.request_handler.answer(line)
        except Exception as error:
            return self._failed(error)

    async def _reply_after(self, waiting: Awaitable[Answer]) -> None:
        try:
            answer = await waiting
        except Exception as error:
            answer = self._failed(error)
        self._reply(answer)

    def _failed(self, error: Exception) -> Answer:
        if not self._clients.failed.done():
            self._clients.failed.set_exception(error)  # serve_control raises it
        return wrong("internal error of the service; the request may be incomplete")


def _is_abort(line: bytes) -> bool:
    if b"abort" not in line:  # avoids decoding most lines twice
        return False
    try:
        request = msgspec.json.decode(_as_valid_utf8(line))
    except (ValueError, RecursionError):  # ValueError includes UnicodeDecodeError
        return False
    return isinstance(request, dict) and request.get("do") == "abort"


def _as_valid_utf8(line: bytes) -> bytes:
    """Return a line with U+FFFD in place of each byte that is not UTF-8, for example in a name."""
    return line.decode(errors="replace").encode()
