"""Converts any text to one line that each interface can show. Pure."""

MAX_LINE = 500  # characters


def one_line(text: str) -> str:
    """Return a text as one line of at most ``MAX_LINE`` printable characters."""
    words = " ".join(text.encode(errors="backslashreplace").decode().split())
    return "".join(each if each.isprintable() else "?" for each in words)[:MAX_LINE]
