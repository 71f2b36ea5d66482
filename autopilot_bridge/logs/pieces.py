"""A file in pieces: memory stays small, and records that two pieces share are put together."""

from collections.abc import Iterator
from pathlib import Path

from autopilot_bridge.errors import BridgeError

PIECE_BYTES = 1 << 19


def pieces(path: Path) -> Iterator[bytes]:
    """The bytes of a file, in order. Raises BridgeError if it cannot be read."""
    try:
        with path.open("rb", buffering=0) as file:
            while piece := file.read(PIECE_BYTES):
                yield piece
    except OSError as error:
        raise BridgeError(f"{path}: cannot be read: {error.strerror}") from None
