"""Lists the faults of a mock, as data; ``fault_injection.py`` applies them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from autopilot_bridge.errors import BridgeError

Span = tuple[float, float]  # start and end in seconds since the start of the mock


@dataclass
class Faults:
    """The faults of one mock; all times are seconds since the start of the mock.

    ``refuse`` contains the MAV_MISSION_RESULT of items to reject, by mission type and item.
    ``silent_after`` is the number of mission protocol messages that the autopilot sends before it
    falls silent. ``loss`` and ``duplication`` are fractions of the frames in each direction.
    ``delay_s`` and ``jitter_s`` also apply to each direction; jitter reorders frames.
    """

    refuse: dict[tuple[int, int], int] = field(default_factory=dict)
    silent_after: int | None = None
    loss: float = 0.0
    duplication: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    late_ack_s: float = 0.0  # additional delay of MISSION_ACKs
    silence: list[Span] = field(default_factory=list)  # no message is received or sent
    gps_loss: list[Span] = field(default_factory=list)
    reboot: list[float] = field(default_factory=list)
    battery_low: list[float] = field(default_factory=list)
    stray_ack: list[float] = field(default_factory=list)
    second_upload: list[float] = field(default_factory=list)  # uploads by another ground station
    second_download: list[float] = field(default_factory=list)
    battery_emergency: list[float] = field(default_factory=list)
    fence_breach: list[Span] = field(default_factory=list)
    engine_failure: list[Span] = field(default_factory=list)
    remote_id_error: list[Span] = field(default_factory=list)
    remote_id_loss: list[Span] = field(default_factory=list)


FORMS = (
    "loss=SHARE, duplication=SHARE, delay=S, jitter=S, late-ack=S, refuse=ITEM:CODE, "
    "silent-after=MESSAGES, silence@FROM..TO, gps-loss@FROM..TO, fence-breach@FROM..TO, "
    "engine-failure@FROM..TO, remote-id-error@FROM..TO, remote-id-loss@FROM..TO, reboot@S, "
    "battery-low@S, battery-emergency@S, "
    "stray-ack@S, second-upload@S, second-download@S"
)
_SECONDS = {"delay": "delay_s", "jitter": "jitter_s", "late-ack": "late_ack_s"}
_SPANS = (
    *("silence", "gps-loss", "fence-breach", "engine-failure"),
    *("remote-id-error", "remote-id-loss"),
)
_TIMES = (
    *("reboot", "battery-low", "battery-emergency"),
    *("stray-ack", "second-upload", "second-download"),
)


def parse_faults(texts: Sequence[str]) -> Faults:
    """Return the faults in texts such as ``reboot@30`` and ``gps-loss@10..20`` (see ``FORMS``).

    A span without an end lasts until the end of the run. Raises BridgeError if a text is not valid.
    """
    faults = Faults()
    for text in texts:
        name, _, value = text.replace("@", "=", 1).partition("=")
        if name == "refuse":
            item, colon, code = value.partition(":")
            number = _whole(text, item, "ITEM:CODE", 0, 65534)
            faults.refuse[0, number] = _whole(text, code if colon else "", "ITEM:CODE", 1, 15)
        elif name == "silent-after":
            faults.silent_after = _whole(text, value, "MESSAGES", 0, 10**9)
        elif name in ("loss", "duplication"):
            setattr(faults, name, _number(text, value, "a fraction from 0 to 1", maximum=1.0))
        elif name in _SECONDS:
            setattr(faults, _SECONDS[name], _number(text, value, "seconds"))
        elif name in _SPANS:
            start, _, end = value.partition("..")
            start_s = _number(text, start, "FROM..TO")
            end_s = _number(text, end, "FROM..TO with TO after FROM", start_s) if end else math.inf
            getattr(faults, name.replace("-", "_")).append((start_s, end_s))
        elif name in _TIMES:
            getattr(faults, name.replace("-", "_")).append(_number(text, value, "seconds"))
        else:
            raise BridgeError(f"--fault {text!r}: unknown fault; the faults are {FORMS}")
    return faults


def _number(text: str, value: str, form: str, minimum: float = 0.0, maximum: float = 1e9) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not minimum <= number <= maximum:
        raise BridgeError(f"--fault {text!r}: {value!r} is not valid; use {form}")
    return number


def _whole(text: str, value: str, form: str, minimum: int, maximum: int) -> int:
    if not (value.isascii() and value.isdigit() and minimum <= int(value) <= maximum):
        raise BridgeError(
            f"--fault {text!r}: {value!r} is not valid; use {form}, a whole number from {minimum} "
            f"to {maximum}"
        )
    return int(value)
