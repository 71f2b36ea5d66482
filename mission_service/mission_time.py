"""Formats mission times for people."""


def clock_text(at_us: int) -> str:
    """Return a mission time as h:mm:ss."""
    seconds = at_us // 1_000_000
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
