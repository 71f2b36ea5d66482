"""Authenticates HTTP clients by tokens with roles; only the SHA-256 hashes of tokens are stored.

A token has 32 random bytes and cannot be guessed, so its hash needs no salt and need not be slow.
"""

import hashlib
import hmac
import logging
import os
import re
import secrets
import tomllib
from pathlib import Path
from typing import Annotated, get_args

import msgspec
from msgspec import Meta

from mission_service.errors import MissionServiceError
from mission_service.requests import FULL_HASH, Role
from mission_service.runtime.redaction import hide
from mission_service.value_errors import in_words

ROLES: tuple[Role, ...] = get_args(Role)
TOKEN_FILE = "token"  # name of the file in the run's folder
LONGEST_TOKEN = 200
_TOKEN = re.compile(rf"[A-Za-z0-9_-]{{20,{LONGEST_TOKEN}}}")

log = logging.getLogger(__name__)


class User(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The user of a token: a person or a program."""

    name: Annotated[str, Meta(pattern=r"^[\w .@-]{1,40}$")]
    roles: frozenset[Role]
    sha256: Annotated[str, Meta(pattern=FULL_HASH)]
    station: Annotated[str, Meta(max_length=80)] = ""

    def may(self, role: Role) -> bool:
        """Return whether the user has this role.

        Every user has ``look``, except a detector, which has only ``observe``. ``correct`` includes
        ``observe``.
        """
        if role == "look":
            return self.roles != {"observe"}
        return role in self.roles or (role == "observe" and "correct" in self.roles)

    @property
    def highest_role(self) -> Role:
        """The last role in ``ROLES`` that this user has."""
        return next(role for role in reversed(ROLES) if self.may(role))


class _TokensFile(msgspec.Struct, forbid_unknown_fields=True):
    tokens: tuple[User, ...] = ()


def sum_of(token: str) -> str:
    """Return the SHA-256 hash of a token, which is stored instead of the token."""
    return hashlib.sha256(token.encode()).hexdigest()


def new_token() -> str:
    """Return a new random token."""
    return secrets.token_urlsafe(32)


def read_tokens(path: Path) -> tuple[User, ...]:
    """Return the users in a tokens file.

    Raises MissionServiceError, whose text gives the file, the position in the file and the error.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MissionServiceError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise MissionServiceError(f"{path}: not valid TOML: {error}") from None
    try:
        found = msgspec.convert(data, _TokensFile).tokens
    except msgspec.ValidationError as error:
        raise MissionServiceError(
            f"{path}: {in_words(error, _TokensFile)}; a token is a table [[tokens]] with name, "
            "roles, station and sha256, written by `mission-service token`"
        ) from None
    names = [user.name for user in found]
    if twice := [name for name in names if names.count(name) > 1]:
        raise MissionServiceError(
            f"{path}: two tokens have the name {twice[0]}; rename one of them"
        )
    return found


def own_token(out: Path) -> str:
    """Return the token of a run without a tokens file; at the first start, create it in OUT/token.

    Only the user that runs the service may read the file. Raises MissionServiceError if other users
    may read the file, or if the file contains no token.
    """
    path = out / TOKEN_FILE
    try:
        handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
        with os.fdopen(handle, "w") as file:
            file.write(new_token() + "\n")
    except FileExistsError:
        pass
    except OSError as error:
        raise MissionServiceError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            token = file.read(LONGEST_TOKEN + 2).decode("ascii", "replace").strip()
    except OSError as error:
        raise MissionServiceError(f"{path}: cannot be read: {error.strerror}") from None
    if mode & 0o077:
        raise MissionServiceError(
            f"{path}: other users can read it; remove it, and the service creates a new token"
        )
    if _TOKEN.fullmatch(token) is None:
        raise MissionServiceError(
            f"{path}: contains no token; remove it, and the service creates a new token"
        )
    hide(token)
    return token


class Tokens:
    """The valid tokens: those in a file, which is read again after each change, or the run's token.

    If ``named``, each token is personal and determines the name in requests; the token of a run is
    not personal. If the file becomes invalid, the tokens stay valid and a warning is logged,
    because an error in the file must not lock out the operators during a fire.
    """

    def __init__(self, users: tuple[User, ...], path: Path | None = None) -> None:
        self._users = users
        self._path = path
        self._stamp = _stamp(path)
        self.named = path is not None

    @classmethod
    def of_file(cls, path: Path) -> "Tokens":
        """Return the tokens of a file. Raises MissionServiceError."""
        return cls(read_tokens(path), path)

    @classmethod
    def of_run(cls, out: Path) -> "Tokens":
        """Return the token in the run's folder, with all roles."""
        user = User("user", frozenset(ROLES), sum_of(own_token(out)))
        return cls((user,))

    def user_of(self, token: str) -> User | None:
        """Return the user of a token, or None.

        The comparison takes the same time for all tokens, because it covers all users.
        """
        self._read_again()
        digest, found = sum_of(token), None
        for user in self._users:
            if hmac.compare_digest(user.sha256, digest):
                found = user
        return found

    def still(self, user: User) -> bool:
        """Return whether a user's token is still valid, with the same roles."""
        self._read_again()
        return user in self._users

    def _read_again(self) -> None:
        """Read the file again if it has changed."""
        stamp = _stamp(self._path)
        if self._path is None or stamp == self._stamp:
            return
        self._stamp = stamp
        try:
            self._users = read_tokens(self._path)
        except MissionServiceError as error:
            log.warning("%s; the tokens from before the change remain valid", error)


def _stamp(path: Path | None) -> tuple[int, ...]:
    """Return a value that changes when the file is modified or replaced; () if there is no file."""
    if path is None:
        return ()
    try:
        found = path.stat()
    except OSError:
        return ()
    return (found.st_ino, found.st_size, found.st_mtime_ns)
