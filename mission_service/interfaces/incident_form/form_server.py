"""Serves the page for a new incident on loopback, until its scenario has been saved."""

import contextlib
import hmac
import json
import logging
import shutil
import socket
import threading
import webbrowser
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import msgspec

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from mission_service.errors import MissionServiceError, in_words
from mission_service.interfaces.api.access.guard import HEADERS
from mission_service.interfaces.incident_form.form_options import FILE_NAME, Form, options_of
from mission_service.interfaces.loopback_server import LOOPBACK, LoopbackServer
from mission_service.interfaces.web.build import PAGE

log = logging.getLogger(__name__)
FORM_PAGE = PAGE.with_name("incident.html")
MAX_FORM_BYTES = 256 * 1024
MAX_FILE_BYTES = 4 * 1024**3
PART_BYTES = 1024**2
SILENT_S = 60.0  # a client that sends nothing for this long is disconnected

Create = Callable[[list[str]], dict[str, Any]]


@contextlib.contextmanager
def uploads_of(file: Path) -> Iterator[Path]:
    """Make the folder for the uploads of a scenario file, ``NAME-files`` beside it.

    The folder is removed at the end if the scenario file has not been written, or if the folder is
    empty.

    Args:
        file: The future scenario file.

    Returns:
        A context manager, which yields the folder.

    Raises:
        MissionServiceError: The folder exists.
    """
    folder = file.with_name(f"{file.stem}-files")
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise MissionServiceError(
            f"{folder}: already exists; choose another name for the scenario, or delete the folder "
            "if it is left over from a form"
        ) from None
    except OSError as error:
        raise MissionServiceError(f"{folder}: cannot be created: {error.strerror}") from None
    try:
        yield folder
    finally:
        for part in folder.glob(".*.part"):
            part.unlink(missing_ok=True)
        if not (file.exists() and folder.exists() and any(folder.iterdir())):
            shutil.rmtree(folder, ignore_errors=True)


class FormServer(LoopbackServer):
    """The server of the page; ``serve_forever`` returns when the scenario has been saved."""

    def __init__(
        self, port: int, folder: Path, token: str, create: Create, page: Path = FORM_PAGE
    ) -> None:
        """Listen on loopback.

        Args:
            port: The port; 0 selects a free port.
            folder: The folder of the uploads.
            token: The token that requests must contain.
            create: Receives the options of ``incident new``, writes the scenario file, and returns
                a JSON object for the page; it may raise MissionServiceError.
            page: The built page.

        Raises:
            MissionServiceError: The page has not been built, or the port cannot be used.
        """
        if not page.is_file():
            raise MissionServiceError(f"{page}: the page was not built; run make web")
        self.folder, self.token, self.create = folder, token, create
        self.creating, self.ended = threading.Lock(), False
        self.saved: dict[str, Any] | None = None
        super().__init__(port, partial(_Requests, directory=str(page.parent)))

    @property
    def address(self) -> str:
        """The address for the browser, with the token."""
        return f"http://{LOOPBACK}:{self.server_port}/#token={self.token}"

    def server_close(self) -> None:
        """Stop listening, and wait for a check that is in progress; no other check begins."""
        super().server_close()
        with self.creating:
            self.ended = True

    def open_in_browser(self) -> None:
        """Open the page in a thread, because a text browser ends only after the form."""
        threading.Thread(target=webbrowser.open, args=(self.address,), daemon=True).start()


class _RefusedError(Exception):
    """A request that is refused; the arguments are the status and the reason."""


class _Requests(SimpleHTTPRequestHandler):
    """Serves the page and its scripts, receives files and forms; prints nothing."""

    server: FormServer
    timeout = SILENT_S

    def translate_path(self, path: str) -> str:
        """Return the file at an address; the form is at ``/``."""
        return super().translate_path(f"/{FORM_PAGE.name}" if urlsplit(path).path == "/" else path)

    def list_directory(self, path: Any) -> None:
        """Refuse to list a folder."""
        self.send_error(404)

    def end_headers(self) -> None:
        for name, value in HEADERS.items():
            self.send_header(name.decode(), value.decode())
        super().end_headers()

    def do_PUT(self) -> None:
        """Store a file: ``PUT /files/NAME``."""
        self._answer(self._store)

    def do_POST(self) -> None:
        """Make the scenario: ``POST /incident``."""
        self._answer(self._make)

    def _answer(self, act: Callable[[], dict[str, Any]]) -> None:
        try:
            self._check()
            status, body = 200, act()
        except _RefusedError as error:
            status, body = error.args[0], {"error": error.args[1]}
        content = json.dumps(body).encode()
        try:
            self.send_response(status)
            self.send_header("content-type", "application/json")
            self.send_header("content-length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)
            self.wfile.flush()
            if status != 200:
                self._discard_rest()
        except OSError:  # the browser has closed the connection
            self.close_connection = True
        finally:
            if self.server.saved is not None:
                threading.Thread(target=self.server.shutdown, daemon=True).start()

    def _discard_rest(self) -> None:
        """Read the rest of a refused request; otherwise, the browser would not get the reason."""
        self.connection.shutdown(socket.SHUT_WR)
        for _ in range(MAX_FILE_BYTES // PART_BYTES):
            if not self.connection.recv(PART_BYTES):
                return

    def _check(self) -> None:
        """Raise _RefusedError for a request of another site or another user of this machine."""
        port = self.server.server_port
        if self.headers.get("host") not in (f"{LOOPBACK}:{port}", f"localhost:{port}"):
            raise _RefusedError(403, "another host name")
        given = self.headers.get("authorization", "").removeprefix("Bearer ")
        if not hmac.compare_digest(given.encode(), self.server.token.encode()):
            raise _RefusedError(401, "the token is missing; open the address that was printed")

    def _length(self, max_bytes: int) -> int:
        text = self.headers.get("content-length", "")
        if not (text.isascii() and text.isdigit() and len(text) < 16):
            raise _RefusedError(411, "content-length is missing")
        if int(text) > max_bytes:
            raise _RefusedError(413, f"{text} bytes; at most {max_bytes} are accepted")
        return int(text)

    def _store(self) -> dict[str, Any]:
        name = unquote(self.path.removeprefix("/files/"))
        if not self.path.startswith("/files/") or FILE_NAME.fullmatch(name) is None:
            raise _RefusedError(
                422, f"{name}: rename the file; letters, digits and the signs . _ - are accepted"
            )
        left = self._length(MAX_FILE_BYTES)
        made = self.server.folder / f".{threading.get_ident()}.part"
        try:
            with made.open("wb") as file:
                while left > 0:
                    part = self.rfile.read(min(left, PART_BYTES))
                    if not part:
                        raise _RefusedError(400, f"{name}: the upload ended early; choose it again")
                    file.write(part)
                    left -= len(part)
            made.replace(self.server.folder / name)
        except OSError as error:
            raise _RefusedError(507, f"{name}: {error.strerror or error}") from error
        finally:
            made.unlink(missing_ok=True)
        return {"file": name}

    def _make(self) -> dict[str, Any]:
        if self.path != "/incident":
            raise _RefusedError(404, f"{self.path}: no such address")
        body = self.rfile.read(self._length(MAX_FORM_BYTES))
        try:
            form = msgspec.json.decode(body, type=Form)
        except msgspec.MsgspecError as error:
            raise _RefusedError(422, str(error)) from error
        with self.server.creating:
            if self.server.saved is not None or self.server.ended:
                raise _RefusedError(409, "the form has ended")
            try:
                saved = self.server.create(options_of(form, self.server.folder))
            except (MissionServiceError, FireModelError, BridgeError) as error:
                raise _RefusedError(422, str(error)) from error
            except Exception as error:  # a defect must not end the form
                log.exception("the form cannot be used")
                raise _RefusedError(500, f"internal error: {in_words(error)}") from error
            self.server.saved = saved
        return saved

    def log_message(self, *_: Any) -> None:
        """Print nothing."""
