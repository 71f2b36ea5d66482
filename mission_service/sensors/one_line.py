"""Makes one line of text, which each interface can show, of any text. Pure."""

MAX_LINE = 500  # characters


def one_line(text: str) -> str:
    """Return a text as one line of printable characters, at most ``MAX_LINE``."""
    words = " ".join(text.encode(errors="backslashreplace").decode().split())
    return "".join(each if each.isprintable() else "?" for each in words)[:MAX_LINE]
