"""A server of HTTP pages for the user of this machine."""

from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from mission_service.errors import MissionServiceError

LOOPBACK = "127.0.0.1"


class LoopbackServer(ThreadingHTTPServer):
    """Listens on loopback; ``server_port`` is the port."""

    def __init__(self, port: int, handler: Callable[..., BaseHTTPRequestHandler]) -> None:
        """Listen on the port; 0 selects a free port. Raises MissionServiceError if it fails."""
        try:
            super().__init__((LOOPBACK, port), handler)
        except OSError as error:
            raise MissionServiceError(
                f"{LOOPBACK}:{port}: cannot listen: {error.strerror}; choose another --port"
            ) from None
