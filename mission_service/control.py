"""The control socket of a live run, ``OUT/control.sock``: JSON lines in, one line back for each.

Only the user who runs the service may open it (mode 0600). A request that cannot be understood is
answered with what is wrong with it, and nothing is done; an abort is taken from anybody, whatever
else it says, and even when all places are taken.
"""

import asyncio
import contextlib
import socket
import stat
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import msgspec

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from mission_service.commands import CONFIRM
from mission_service.errors import ControlError, MissionServiceError
from mission_service.events import CrewEvent
from mission_service.requests import KNOWN, event_of

MOST_LINE_BYTES = 64 * 1024
MOST_CLIENTS = 16
MOST_WAITING = 64  # beyond MOST_CLIENTS only an abort is taken
IDLE_S = 60.0
LATE_CLIENT_S = 2.0
LONGEST_PATH_BYTES = 107  # of a Unix-domain socket on Linux

Answer = dict[str, Any]
KNOWN_ERRORS = (MissionServiceError, FireModelError, BridgeError)


class Desk:
    """Where requests of people become events: the socket's, or those of another interface."""

    def __init__(
        self,
        tell: Callable[[CrewEvent], list[str]],
        status: Callable[[], dict[str, Any]],
        now_us: Callable[[], int],
        stations: Collection[str],
        items: Collection[str],
        on_map: Callable[[float, float], bool],
        vehicles: Collection[str] | None = None,
        words: Collection[str] = KNOWN,
    ) -> None:
        """``tell`` handles an event, and returns what was said in answer to it.

        ``words`` are what may be asked for in this scenario (``requests.py``).
        """
        self._tell = tell
        self._status = status
        self._now_us = now_us
        self._stations = stations
        self._items = items
        self._on_map = on_map
        self._vehicles = vehicles
        self._words = words

    def ask(self, request: Any) -> Answer:
        """The answer to one request; never raises for anything that it may say.

        ``confirm`` in it: a vehicle was not ordered, since that would end what its autopilot or
        pilot has chosen; the same request with ``confirmed`` does.
        """
        if isinstance(request, dict) and request.get("do") == "status":
            return {"ok": True, "status": self._status()}
        try:
            event = event_of(
                request,
                self._now_us(),
                self._stations,
                self._items,
                self._on_map,
                self._vehicles,
                self._words,
            )
            said = self._tell(event)
        except KNOWN_ERRORS as error:
            return wrong(str(error))
        answer = {
            "ok": True,
            "at_s": event.at_us / 1e6,
            "event": type(event).__name__,
            "said": said,
        }
        if any(line.startswith(CONFIRM) for line in said):
            answer["confirm"] = True
        return answer

    def answer(self, line: bytes) -> Answer:
        """The answer to one line; never raises for anything that a line may say."""
        try:
            request = msgspec.json.decode(line)
        except (msgspec.DecodeError, RecursionError) as error:
            return wrong(f"not a line of JSON: {error}")
        return self.ask(request)


def wrong(text: str) -> Answer:
    """An answer that says why nothing was done."""
    return {"ok": False, "error": text}


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[socket.socket]:
    """The socket at ``path``, listened to by us alone; removed at the end.

    One that a killed run has left is replaced. Raises ControlError if a run answers there, if
    something else has that name, or if it cannot be made.
    """
    _refuse_long(path)
    _clear(path)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # Nobody can connect before it listens, and by then its mode is set.
        listening.bind(str(path))
        path.chmod(0o600)
        listening.listen(MOST_WAITING)
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
    """Remove what a killed run has left."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise ControlError(f"{path}: cannot be made: {error.strerror}") from None
    if not stat.S_ISSOCK(mode):
        raise ControlError(f"{path}: is in the way of the control socket; move it away")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            path.unlink(missing_ok=True)
            return
        except OSError as error:
            raise ControlError(f"{path}: cannot be looked at: {error.strerror}") from None
    raise ControlError(f"{path}: another run answers there; end it first, or choose another --out")


async def serve_control(listening: socket.socket, desk: Desk) -> None:
    """Answer clients until cancelled. A defect in an answer ends the program."""
    clients = 0

    async def served(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal clients
        clients += 1
        try:
            if clients <= MOST_WAITING:
                # A connection that breaks or stays silent is the client's own affair.
                with contextlib.suppress(ConnectionError, TimeoutError):
                    await _serve(reader, writer, desk, late=clients > MOST_CLIENTS)
        finally:
            clients -= 1
            writer.close()

    async with asyncio.TaskGroup() as group:

        def come(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            group.create_task(served(reader, writer))

        server = await asyncio.start_unix_server(come, sock=listening, limit=MOST_LINE_BYTES)
        try:
            await asyncio.Event().wait()
        finally:
            server.close()


async def _serve(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, desk: Desk, late: bool
) -> None:
    """Answer one client line by line; a late one once, and only to an abort."""
    while True:
        async with asyncio.timeout(LATE_CLIENT_S if late else IDLE_S):
            try:
                line = await reader.readline()
            except ValueError:  # asyncio's word for a line beyond the limit
                line = None
        if line == b"":
            return
        if line is None:
            answer = wrong(f"a line has at most {MOST_LINE_BYTES} bytes")
        elif late and not _is_abort(line):
            answer = wrong(f"{MOST_CLIENTS} clients are connected already; only abort is taken")
        else:
            answer = desk.answer(line)
        writer.write(msgspec.json.encode(answer) + b"\n")
        async with asyncio.timeout(IDLE_S):
            await writer.drain()
        if late or line is None:
            return


def _is_abort(line: bytes) -> bool:
    try:
        request = msgspec.json.decode(line)
    except (msgspec.DecodeError, RecursionError):
        return False
    return isinstance(request, dict) and request.get("do") == "abort"
