"""Parses the addresses of links."""

from dataclasses import dataclass
from typing import Literal, cast

from autopilot_bridge.errors import BridgeError

NetworkKind = Literal["udpin", "udpout", "tcp", "tcpin"]
# For each kind of link, the kind that the program at the other end uses.
_OTHER_END = {"udpin": "udpout", "udpout": "udpin", "tcp": "tcpin", "tcpin": "tcp"}


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """A UDP or TCP address: ``udpin`` and ``tcpin`` listen, ``udpout`` and ``tcp`` connect."""

    kind: NetworkKind
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """The address of a serial line, e.g. of a telemetry radio."""

    device: str
    baud: int

    def __str__(self) -> str:
        return f"serial:{self.device}:{self.baud}"


def parse_link(text: str) -> LinkAddress | SerialAddress:
    """Parse ``udpin:``, ``udpout:``, ``tcp:`` or ``tcpin:HOST:PORT``, or ``serial:DEVICE:BAUD``."""
    kind, _, rest = text.partition(":")
    host_or_device, _, number = rest.rpartition(":")
    if kind not in (*_OTHER_END, "serial"):
        kinds = ", ".join(_OTHER_END)
        raise BridgeError(
            f"link {text!r}: must begin with {kinds} or serial, as in udpin:HOST:PORT"
        )
    form = "serial:DEVICE:BAUD" if kind == "serial" else f"{kind}:HOST:PORT"
    if not host_or_device or not (number.isascii() and number.isdigit()):
        raise BridgeError(f"link {text!r}: write it as {form}")
    if kind == "serial":
        if not 0 < int(number) <= 10_000_000:
            raise BridgeError(f"link {text!r}: {number} is not a baud rate; 57600 is usual")
        return SerialAddress(host_or_device, int(number))
    if not 0 < int(number) < 65536:
        raise BridgeError(f"link {text!r}: port {number} is not between 1 and 65535")
    return LinkAddress(cast(NetworkKind, kind), host_or_device, int(number))


def other_end(link: str) -> str:
    """Return the address for the program at the other end: ``udpout:...`` for ``udpin:...`` etc."""
    address = parse_link(link)
    if isinstance(address, SerialAddress):
        raise BridgeError(f"link {link!r}: a serial line has no network port; use udpin or tcpin")
    return f"{_OTHER_END[address.kind]}:{address.host}:{address.port}"
