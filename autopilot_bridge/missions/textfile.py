"""Reading and writing of text files, with one-line errors."""

from pathlib import Path

from autopilot_bridge.errors import BridgeError


def read_text(path: Path) -> str:
    """Return a file's text. Raises BridgeError, which names the file."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise BridgeError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise BridgeError(f"{path}: cannot be read: it is not a text file") from None


def write_text(path: Path, text: str) -> None:
    """Write a file's text. Raises BridgeError, which names the file."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BridgeError(f"{path}: cannot be written: {error.strerror}") from None
