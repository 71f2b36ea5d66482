"""Adds tokens to a tokens file; the existing content of the file does not change."""

import os
import tempfile
from pathlib import Path

from mission_service.errors import MissionServiceError
from mission_service.interfaces.api.access.auth import ROLES, new_token, read_tokens, sum_of


def added(path: Path, name: str, roles: tuple[str, ...], station: str) -> str:
    """Add a new token to a file and return it.

    The file is replaced as a whole, with mode 0600. Raises MissionServiceError for an unknown role,
    for a name that is in use or contains invalid characters, and for an unusable file.
    """
    for role in roles:
        if role not in ROLES:
            raise MissionServiceError(f"--roles {role}: the roles are {', '.join(ROLES)}")
    before = _text(path)
    if before and any(user.name == name for user in read_tokens(path)):
        raise MissionServiceError(f"{path}: already has a token for {name}; remove it first")
    token = new_token()
    text = before + ("" if not before or before.endswith("\n") else "\n")
    text += ("\n" if before else "") + "[[tokens]]\n"
    text += f"name = {_quoted(name)}\n"
    text += f"roles = [{', '.join(_quoted(role) for role in roles)}]\n"
    text += f"station = {_quoted(station)}\n" if station else ""
    text += f'sha256 = "{sum_of(token)}"\n'
    try:
        handle, made = tempfile.mkstemp(dir=path.parent, prefix=path.name)
        fresh = Path(made)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            read_tokens(fresh)
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except OSError as error:
        raise MissionServiceError(f"{path}: cannot be written: {error.strerror}") from None
    except MissionServiceError as error:
        raise MissionServiceError(str(error).replace(made, str(path))) from None
    return token


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ""
    except (OSError, UnicodeDecodeError) as error:
        raise MissionServiceError(f"{path}: cannot be read: {error}") from None


def _quoted(text: str) -> str:
    """Return a text as a TOML basic string; ``read_tokens`` refuses control characters."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
