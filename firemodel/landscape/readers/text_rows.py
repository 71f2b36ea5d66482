"""Read the rows of text files: fields, numbers and fuel codes."""

import math
from collections.abc import Iterator
from pathlib import Path

from firemodel.errors import FireModelError

MAX_CODE = 32767


def rows_of(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the fields of each line of a text file; ``#`` begins a comment.

    Fields are separated by spaces, tabs or commas. Raises FireModelError for an unreadable file.
    """
    for line, text in enumerate(text_of(path).splitlines(), 1):
        fields = text.partition("#")[0].replace(",", " ").split()
        if fields:
            yield line, fields


def text_of(path: Path) -> str:
    """Return the text of a file. Raises FireModelError if it cannot be read as UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FireModelError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise FireModelError(f"{path}: is not text in UTF-8; save it as such") from None


def number(where: str, name: str, text: str, least: float, most: float) -> float:
    """Return the number in a field. Raises FireModelError beyond the limits or for other text."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise FireModelError(
            f"{where}: {name} is {text!r}; it must be a number from {least:g} to {most:g}"
        )
    return value


def fuel_code(where: str, text: str, least: int = 1) -> int:
    """Return the fuel code in a field. Raises FireModelError for other text."""
    if not text.isascii() or not text.isdigit() or not least <= int(text) <= MAX_CODE:
        raise FireModelError(
            f"{where}: fuel code {text!r} must be a whole number from {least} to {MAX_CODE}"
        )
    return int(text)
