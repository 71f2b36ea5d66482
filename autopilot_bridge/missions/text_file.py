"""Reads and writes text files; an error message is one line."""

from pathlib import Path

from autopilot_bridge.errors import BridgeError


def read_text(path: Path) -> str:
    """Return the text of a file. Raises a BridgeError that names the file if reading fails."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise BridgeError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise BridgeError(f"{path}: cannot be read: it is not a text file") from None


def write_text(path: Path, text: str) -> None:
    """Write the text of a file. Raises a BridgeError that names the file if writing fails."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BridgeError(f"{path}: cannot be written: {error.strerror}") from None
