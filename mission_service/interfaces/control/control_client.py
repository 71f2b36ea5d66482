"""Connects to the control socket of a run, for the command line and tests."""

import socket
from pathlib import Path
from typing import Any, Self

import msgspec

from mission_service.errors import ControlError, RequestError

NAME = "control.sock"  # name of the socket in the run's folder
ANSWER_WITHIN_S = 10.0


class ControlClient:
    """A connection to the run in the folder ``out``."""

    def __init__(self, out: Path) -> None:
        self.path = out / NAME
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(ANSWER_WITHIN_S)
        try:
            self._socket.connect(str(self.path))
        except OSError as error:
            self._socket.close()
            raise ControlError(f"{self.path}: {_why(error)}") from None
        self._replies = self._socket.makefile("rb")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._replies.close()
        self._socket.close()

    def ask(self, **request: Any) -> dict[str, Any]:
        """Return the reply to a request.

        Raises RequestError if the request is refused, and ControlError if no reply arrives.
        """
        try:
            self._socket.sendall(msgspec.json.encode(request) + b"\n")
            line = self._replies.readline()
        except OSError as error:
            raise ControlError(f"{self.path}: {_why(error)}") from None
        if not line.endswith(b"\n"):
            raise ControlError(f"{self.path}: the run has ended")
        answer: dict[str, Any] = msgspec.json.decode(line)
        if not answer["ok"]:
            raise RequestError(str(answer["error"]))
        return answer


def _why(error: OSError) -> str:
    match error:
        case FileNotFoundError():
            return "no run uses this folder; start mission-service run with this --out"
        case ConnectionRefusedError():
            return "the run in this folder was killed; start it again to resume it"
        case PermissionError():
            return "no permission: only the user that runs the service may control it"
        case TimeoutError():
            return f"the run did not reply within {ANSWER_WITHIN_S:g} s"
        case _:
            return str(error.strerror or error)
