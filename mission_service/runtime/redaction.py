"""Removes secrets from text: registered ones, and text that looks like one. Pure."""

import re

HIDDEN = "[hidden]"
MIN_SECRET = 6  # characters: a shorter one would also remove ordinary words
_LOOKS_SECRET = re.compile(
    r"((?:bearer|basic)\s+|[\w-]*(?:token|passw(?:or)?d|secret|signing[ _-]?key|api[ _-]?key)"
    r"[\"']?\s*[=:]\s*[\"']?)(?!file:|env:)[^\s\"',;&]+",
    re.IGNORECASE,
)
_secrets: set[str] = set()


def hide(secret: str | bytes) -> None:
    """Register a secret: a token, a password, a key (bytes: in hexadecimal)."""
    text = secret.hex() if isinstance(secret, bytes) else secret
    if len(text) >= MIN_SECRET:
        _secrets.add(text)


def clean(text: str) -> str:
    """Return the text without secrets."""
    for secret in _secrets:
        text = text.replace(secret, HIDDEN)
    return _LOOKS_SECRET.sub(rf"\g<1>{HIDDEN}", text)
