"""The client of the control socket, for the command line and tests."""

import socket
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec

from mission_service.errors import ControlError, RequestError

NAME = "control.sock"  # in the folder of a run
ANSWER_WITHIN_S = 10.0


class ControlClient:
    """A connection to the run whose files are in ``out``."""

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._replies.close()
        self._socket.close()

    def ask(self, **request: Any) -> dict[str, Any]:
        """Return the answer to a request; raises RequestError if it was refused, ControlError if none."""
        try:
            self._socket.sendall(msgspec.json.encode(request) + b"\n")
            line = self._replies.readline()
        except TimeoutError:
            raise ControlError(
                f"{self.path}: the run does not answer within {ANSWER_WITHIN_S:g} s"
            ) from None
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
            return "no run there; is mission-service run active with this --out?"
        case ConnectionRefusedError():
            return "the run that made it was killed; start it again to resume it"
        case PermissionError():
            return "no permission: only the user that runs the service may control it"
        case TimeoutError():
            return f"the run does not answer within {ANSWER_WITHIN_S:g} s"
        case _:
            return str(error.strerror or error)
