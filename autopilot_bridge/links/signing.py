"""Signs MAVLink 2 frames with a shared key, verifies signatures and rejects replayed frames.

The specification is https://mavlink.io/en/guide/message_signing.html. A signature is the first 48
bits of SHA-256 over the key, the frame, a link id and a timestamp. A *stream* consists of the
frames with the same system, component and link id. Timestamps count units of 10 us since 2015 and
increase with every frame of a stream.

The implementation in pymavlink 2.4.50 (``MAVLink.check_signature``, ``decode``) has faults:

- it stores a stream's timestamp before it checks the hash, so that after one forged frame with a
  timestamp far in the future every genuine frame fails;
- it adopts the greatest timestamp received, even from a sender with a wrong clock, so that after
  our next frames each vehicle rejects every other station;
- it passes frames with a *wrong* signature to the callback that allows unsigned frames;
- it does not verify frames of unknown messages, and compares signatures with ``!=``.

This module stores a timestamp only if the hash is right, and received timestamps do not change the
timestamps of sent frames. A stream may be ahead of our clock only by a bounded time. A frame with a
wrong signature is rejected, whatever its message.

At every boot and with every new key, ArduPilot 4.6 (source: ``GCS_Signing.cpp``) starts from its
saved timestamp plus 60 s. ArduPilot uses UTC as soon as GPS provides the time. ArduPilot accepts
unsigned frames on its first port (USB; SERIAL0 of the simulator), and rejects a stream that begins
more than a minute behind ArduPilot's own timestamp. PX4 signs frames from version 1.18.
"""

import base64
import binascii
import contextlib
import hashlib
import hmac
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.framing import (
    SIGNATURE_BYTES,
    SIGNED,
    V2,
    checksum,
    message_id_of,
    source_of,
)

EPOCH_US = 1_420_070_400_000_000  # 2015-01-01, microseconds since 1970
TICKS_PER_S = 100_000
OLDEST_BEGIN_S = 60
# ArduPilot adds a minute to its timestamp at every boot without GPS, so a small lead over our clock
# is not a fault.
MAX_AHEAD_S = 300
# Telemetry radios send their own status unsigned, because they have no keys.
UNSIGNED_ALLOWED = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS})
SETUP_SIGNING = int(mavlink.MAVLINK_MSG_ID_SETUP_SIGNING)
# Timestamps are reserved on disk this far ahead; some receivers allow a lead of only 6 s.
RESERVED_S = 5
_HASH_BYTES = 6


# Keys -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Key:
    """A secret key of 32 bytes, which ``repr`` does not show."""

    secret: bytes = field(repr=False)


def key_of(text: str) -> Key:
    """Return the key in a text: 32 bytes after ``hex:`` or ``base64:``, or 64 hex digits.

    Any other text is a passphrase; the key is the SHA-256 of its UTF-8, as in QGroundControl and
    MAVProxy. Raises a BridgeError whose text does not contain the key.
    """
    kind, colon, rest = text.partition(":")
    if colon and kind in ("hex", "base64"):
        try:
            secret = bytes.fromhex(rest) if kind == "hex" else base64.b64decode(rest, validate=True)
        except (ValueError, binascii.Error):
            raise BridgeError(f"signing key: the text after {kind}: is not valid {kind}") from None
    elif len(text) == 64 and all(letter in "0123456789abcdefABCDEF" for letter in text):
        secret = bytes.fromhex(text)
    elif text:
        secret = hashlib.sha256(text.encode()).digest()
    else:
        raise BridgeError(
            "signing key: the text is empty; use a passphrase, or hex: followed by 64 digits"
        )
    if len(secret) != 32:
        raise BridgeError(f"signing key: has {len(secret)} bytes, but must have 32")
    if not any(secret):
        raise BridgeError("signing key: a key of zeros disables signing; use another key")
    return Key(secret)


def read_key(source: str) -> Key:
    """Return the key from ``file:PATH`` (its first line) or ``env:NAME``. Raises BridgeError."""
    return key_of(held(source, "signing key"))


def held(source: str, what: str) -> str:
    """Return the secret from ``file:PATH`` (its first line) or ``env:NAME``.

    Raises a BridgeError whose text begins with ``what`` and does not contain the secret.
    """
    kind, _, name = source.partition(":")
    if kind == "env":
        text = os.environ.get(name)
        if text is None:
            raise BridgeError(f"{what}: the environment variable {name} is not set")
    elif kind == "file":
        try:
            text = Path(name).expanduser().read_text(encoding="utf-8")
        except OSError as error:
            raise BridgeError(f"{what}: {name}: {error.strerror}") from None
        except UnicodeDecodeError:
            raise BridgeError(f"{what}: {name}: is not a text file") from None
    else:
        raise BridgeError(f"{what}: specify it as file:PATH or env:NAME")
    return text.partition("\n")[0].rstrip("\r")


def key_warning(source: str, what: str = "signing key") -> str | None:
    """Return a warning if the source of a key is insecure, otherwise None."""
    kind, _, name = source.partition(":")
    if kind != "file" or os.name != "posix":
        return None
    if stat.S_IMODE(Path(name).expanduser().stat().st_mode) & 0o077:
        return f"{what}: {name} is readable by other users of this machine; run chmod 600 {name}"
    return None


def setup_signing(target: tuple[int, int], key: Key | None, wall_us: int) -> Message:
    """Return the SETUP_SIGNING that sets a vehicle's key, or turns signing off if ``key`` is None.

    The key is in clear text: send it only over a link without eavesdroppers, and do not log it. The
    timestamp is a minute in the past because ArduPilot adds a minute. ArduPilot rejects the message
    while it is armed.
    """
    if key is None:
        return mavlink.MAVLink_setup_signing_message(*target, bytes(32), 0)
    began = max(ticks_of(wall_us) - OLDEST_BEGIN_S * TICKS_PER_S, 1)
    return mavlink.MAVLink_setup_signing_message(*target, key.secret, began)


# Timestamps -----------------------------------------------------------------------------------


def ticks_of(wall_us: int) -> int:
    """Return the signing timestamp (units of 10 us since 2015) for microseconds since 1970."""
    return max(wall_us - EPOCH_US, 0) // 10


class Timestamps:
    """The timestamps of sent frames: from the clock, and strictly increasing even after restarts.

    ``wall_us`` returns microseconds since 1970. With a ``file``, no timestamp is used twice even if
    the clock is set back while the program is not running. Several links may share one file. If the
    disk becomes full later, frames are still signed, and the file is written when that is possible.
    """

    def __init__(self, wall_us: Callable[[], int], file: Path | None = None) -> None:
        self._wall_us = wall_us
        self._file = file
        self._last = self._reserved = 0 if file is None else _stored(file)
        if self._last == 0 and ticks_of(wall_us()) == 0:
            raise BridgeError(
                "signing: the clock is set to a time before 2015; correct it, because receivers "
                "reject such frames"
            )
        if file is not None:
            self._store(max(self._last, ticks_of(wall_us())))

    def next(self) -> int:
        """Return the next frame's timestamp."""
        self._last = max(self._last + 1, ticks_of(self._wall_us()))
        if self._last > self._reserved:
            self._reserve(self._last + RESERVED_S * TICKS_PER_S)
        return self._last

    def _reserve(self, ticks: int) -> None:
        if self._file is not None:
            with contextlib.suppress(BridgeError):  # it is tried again at the end of the next span
                self._store(ticks)
        self._reserved = ticks

    def present(self) -> int:
        """Return the current timestamp, with which received timestamps are compared."""
        return max(self._last, ticks_of(self._wall_us()))

    def close(self) -> None:
        """Release the unused part of the reserved timestamps."""
        self._reserve(self._last)

    def _store(self, ticks: int) -> None:
        assert self._file is not None
        # Another process may write the file at the same moment.
        new = self._file.with_name(f"{self._file.name}.{os.getpid()}.new")
        try:
            new.write_text(f"{ticks}\n", encoding="ascii")
            new.replace(self._file)
        except OSError as error:
            raise BridgeError(f"signing: {self._file}: {error.strerror}") from None


def _stored(file: Path) -> int:
    try:
        return int(file.read_text(encoding="ascii"))
    except FileNotFoundError:
        return 0
    except (OSError, ValueError):
        raise BridgeError(
            f"signing: {file}: contains no timestamp; if the clock is correct, delete the file"
        ) from None


# Frames ---------------------------------------------------------------------------------------


@dataclass(slots=True)
class Counts:
    """The numbers of received frames, by outcome."""

    good: int = 0
    unsigned_allowed: int = 0
    unsigned: int = 0  # rejected, like the frames counted in the fields below
    wrong: int = 0  # signed with another key, or altered in transit
    # The timestamp is not later than the last one of the stream: replayed or reordered.
    repeated: int = 0
    old: int = 0  # first frame of a stream, too far in the past
    ahead: int = 0  # too far in the future: the sender's clock or ours is wrong


class Signing:
    """The signing and verification of frames on all links that share a key.

    All these links use the same object, so that a frame is not accepted again on another link.
    """

    def __init__(
        self,
        key: Key,
        timestamps: Timestamps,
        allow_unsigned: frozenset[int] = UNSIGNED_ALLOWED,
    ) -> None:
        """Create the signing for a key; message ids in ``allow_unsigned`` need no signature."""
        self.counts = Counts()
        self._key = key
        self._timestamps = timestamps
        self._allow_unsigned = allow_unsigned
        self._streams: dict[tuple[int, int, int], int] = {}

    def sign(self, frame: bytes, link_id: int) -> bytes:
        """Return a MAVLink 2 frame with its signature; ``link_id`` is the sending link's id."""
        body = bytearray(frame[:-2])
        body[2] |= SIGNED
        crc = checksum(bytes(body[1:]), message_id_of(frame))
        stamped = b"".join(
            (
                body,
                crc.to_bytes(2, "little"),
                bytes((link_id,)),
                self._timestamps.next().to_bytes(6, "little"),
            )
        )
        return stamped + self._hash(stamped)

    def accepts(self, frame: bytes, of_link: Counts | None = None) -> bool:
        """Return whether a frame with a correct checksum is accepted.

        The frame is counted in ``counts`` and in ``of_link``.
        """
        verdict = self._verdict(frame)
        for counts in (self.counts, of_link):
            if counts is not None:
                setattr(counts, verdict, getattr(counts, verdict) + 1)
        return verdict in ("good", "unsigned_allowed")

    def lead_s(self, system_id: int | None = None) -> float:
        """Return the largest lead, in seconds, of a stream over our clock.

        With ``system_id``, only streams from this system count. If the lead is above 60, the sender
        may reject our frames. When our clock was two minutes slow, an ArduPilot 4.6 sent valid
        frames but did not reply to messages (observed).
        """
        present = self._timestamps.present()
        leads = (
            at - present
            for (system, _, _), at in self._streams.items()
            if system_id in (None, system)
        )
        return max(leads, default=0) / TICKS_PER_S

    def _verdict(self, frame: bytes) -> str:
        if not is_signed(frame):
            allowed = message_id_of(frame) in self._allow_unsigned
            return "unsigned_allowed" if allowed else "unsigned"
        if not hmac.compare_digest(self._hash(frame[:-_HASH_BYTES]), frame[-_HASH_BYTES:]):
            return "wrong"
        stream = (*source_of(frame), frame[-SIGNATURE_BYTES])
        at = int.from_bytes(frame[1 - SIGNATURE_BYTES : -_HASH_BYTES], "little")
        present, last = self._timestamps.present(), self._streams.get(stream)
        if at > present + MAX_AHEAD_S * TICKS_PER_S:
            return "ahead"
        if last is None and at < present - OLDEST_BEGIN_S * TICKS_PER_S:
            return "old"
        if last is not None and at <= last:
            return "repeated"
        self._streams[stream] = at
        return "good"

    def _hash(self, stamped: bytes) -> bytes:
        return hashlib.sha256(self._key.secret + stamped).digest()[:_HASH_BYTES]


def is_signed(frame: bytes) -> bool:
    """Return whether a frame has a signature, valid or not."""
    return frame[0] == V2 and bool(frame[2] & SIGNED)


def is_secret(frame: bytes) -> bool:
    """Return whether a frame contains a key, so that it must not be recorded."""
    return message_id_of(frame) == SETUP_SIGNING
