"""Removes secrets from text: registered secrets, and text that looks like a secret. Pure."""

import re

HIDDEN = "[hidden]"
MIN_SECRET = 6  # minimum length in characters; a shorter secret would match ordinary words
_LOOKS_SECRET = re.compile(
    r"((?:bearer|basic)\s+|[\w-]*(?:token|passw(?:or)?d|secret|signing[ _-]?key|api[ _-]?key)"
    r"[\"']?\s*[=:]\s*[\"']?)(?!file:|env:)[^\s\"',;&]+",
    re.IGNORECASE,
)
_secrets: set[str] = set()


def hide(secret: str | bytes) -> None:
    """Register a secret, such as a token, a password or a key; bytes become hexadecimal text."""
    text = secret.hex() if isinstance(secret, bytes) else secret
    if len(text) >= MIN_SECRET:
        _secrets.add(text)


def clean(text: str) -> str:
    """Return the text with each secret replaced by ``HIDDEN``."""
    for secret in _secrets:
        text = text.replace(secret, HIDDEN)
    return _LOOKS_SECRET.sub(rf"\g<1>{HIDDEN}", text)
