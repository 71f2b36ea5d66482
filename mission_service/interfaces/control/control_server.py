"""The control socket of a live run, ``OUT/control.sock``: JSON lines in, one line back for each.

Only the user that runs the service may open it (mode 0600). An invalid request is answered with the
error and has no effect; an abort is accepted from every client, whatever its content, even if the
limit of clients is reached.
"""

import asyncio
import contextlib
import socket
import stat
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import msgspec

from mission_service.errors import ControlError
from mission_service.runtime.request_handler import Answer, RequestHandler, wrong

MAX_LINE_BYTES = 64 * 1024
MAX_CLIENTS = 16
MAX_WAITING = 64  # beyond MAX_CLIENTS only an abort is accepted; beyond this one is cut
IDLE_S = 60.0
LATE_CLIENT_S = 2.0
MAX_QUEUED = 100  # waiting lines at which reading pauses
FRESH_S = 2.0  # lines sent this long before a client closes are still carried out
LONGEST_PATH_BYTES = 107  # of a Unix-domain socket on Linux


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[socket.socket]:
    """Return the listening socket at ``path``; removed at the end of the context.

    A socket left by a killed run is replaced. Raises ControlError if another run answers there, if
    another kind of file has that name, or if the socket cannot be made.
    """
    _refuse_long(path)
    _clear(path)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # Clients can connect only after ``listen``, when its mode is set.
        listening.bind(str(path))
        path.chmod(0o600)
        listening.listen(MAX_WAITING)
        listening.setblocking(False)
    except OSError as error:
        listening.close()
        raise ControlError(f"{path}: cannot be made: {error.strerror}") from None
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
            f"{path}: the control socket's path has {length} bytes, and at most "
            f"{LONGEST_PATH_BYTES} are possible; choose a shorter --out"
        )


def _clear(path: Path) -> None:
    """Remove the socket that a killed run has left."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise ControlError(f"{path}: cannot be made: {error.strerror}") from None
    if not stat.S_ISSOCK(mode):
        raise ControlError(f"{path}: has the name of the control socket; move it away")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            path.unlink(missing_ok=True)
            return
        except OSError as error:
            raise ControlError(f"{path}: cannot be checked: {error.strerror}") from None
    raise ControlError(f"{path}: another run answers there; end it first, or choose another --out")


async def serve_control(listening: socket.socket, request_handler: RequestHandler) -> None:
    """Answer clients until cancelled. Raises the exception of a request that failed."""
    loop = asyncio.get_running_loop()
    clients = _Clients(request_handler, loop.create_future())
    server = await loop.create_unix_server(lambda: _Client(clients), sock=listening)
    try:
        await clients.failed
    finally:
        server.close()
        for client in list(clients.there):
            client.cut()


class _Clients:
    """Connected clients, in the order of their arrival."""

    def __init__(self, request_handler: RequestHandler, failed: asyncio.Future[None]) -> None:
        self.request_handler = request_handler
        self.failed = failed
        self.there: dict[_Client, None] = {}

    def come(self, client: "_Client") -> bool:
        """Add a client; True if the limit is reached, so that it may only abort."""
        late = len(self.there) >= MAX_CLIENTS
        if len(self.there) >= MAX_WAITING:
            next(each for each in self.there if each.late).cut()
        self.there[client] = None
        return late


class _Client(asyncio.Protocol):
    """One client. A complete line is carried out even if the client has disconnected by then.

    An abort is carried out as soon as it is read, before earlier lines; it needs no newline. Of
    other lines one is handled in each turn of the event loop. Replies are in the order of lines.
    """

    def __init__(self, clients: _Clients) -> None:
        self.late = False
        self._clients = clients
        self._loop = asyncio.get_running_loop()
        self._rest = b""
        self._queued: deque[bytes | Answer] = (
            deque()
        )  # waiting lines, and answers to be sent after them
        self._read_s = 0.0
        self._after_abort = False  # the end of its line may come yet
        self._turn_comes = self._unread = self._ended = self._gone = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Add the client."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self.late = self._clients.come(self)
        self._silence = self._loop.call_later(self._idle_s, self.cut)

    def connection_lost(self, exc: Exception | None) -> None:
        """Disconnected; lines sent within ``FRESH_S`` are still carried out."""
        self._gone = True
        self._silence.cancel()
        self._clients.there.pop(self, None)
        if self._loop.time() - self._read_s > FRESH_S:
            self._queued.clear()
        self._go_on()

    def cut(self) -> None:
        """End the connection at once."""
        self._clients.there.pop(self, None)
        self._transport.abort()

    def data_received(self, data: bytes) -> None:
        """Split received data into lines."""
        self._read_s = self._loop.time()
        if self._after_abort:
            data, self._after_abort = data.removeprefix(b"\n"), False
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._take(line)
        if len(self._rest) > MAX_LINE_BYTES:
            self._take(self._rest)
        elif _is_abort(self._rest):
            self._take(self._rest)
            self._rest, self._after_abort = b"", True
        if len(self._queued) > MAX_QUEUED:
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        """Accept the last line without an end; the connection stays until all is answered."""
        if self._rest:
            self._take(self._rest)
        self._ended = True
        self._go_on()
        return True

    def pause_writing(self) -> None:
        """Return the client does not read its replies."""
        self._unread = True

    def resume_writing(self) -> None:
        """Return the client reads its replies again."""
        self._unread = False
        self._go_on()

    @property
    def _idle_s(self) -> float:
        return LATE_CLIENT_S if self.late else IDLE_S

    def _take(self, line: bytes) -> None:
        if self._ended:
            return
        if len(line) > MAX_LINE_BYTES:
            self._queued.append(wrong(f"a line has at most {MAX_LINE_BYTES} bytes"))
            self._ended = True
        elif _is_abort(line):
            self._queued.append(self._answer(line))
        elif self.late:
            text = f"{MAX_CLIENTS} clients are connected already; only an abort is accepted"
            self._queued.append(wrong(text))
        else:
            self._queued.append(line)
        self._ended = self._ended or self.late
        self._go_on()

    def _go_on(self) -> None:
        if not self._turn_comes and (self._gone or not self._unread):
            self._turn_comes = True
            self._loop.call_soon(self._turn)

    def _turn(self) -> None:
        """Handle and answer one line."""
        self._turn_comes = False
        if self._queued:
            first = self._queued.popleft()
            answer = self._answer(first) if isinstance(first, bytes) else first
            if not self._gone:
                self._transport.write(msgspec.json.encode(answer) + b"\n")
                self._silence.cancel()
                self._silence = self._loop.call_later(self._idle_s, self.cut)
        if self._queued:
            self._go_on()
        elif self._ended:
            self._transport.close()
        elif not self._gone:
            self._transport.resume_reading()

    def _answer(self, line: bytes) -> Answer:
        try:
            return self._clients.request_handler.answer(line)
        except Exception as error:  # raised by serve_control
            if not self._clients.failed.done():
                self._clients.failed.set_exception(error)
            return wrong("internal error of the service; the request may be incomplete")


def _is_abort(line: bytes) -> bool:
    if b"abort" not in line:  # avoids decoding most lines twice
        return False
    try:
        request = msgspec.json.decode(line)
    except (msgspec.DecodeError, RecursionError):
        return False
    return isinstance(request, dict) and request.get("do") == "abort"
