"""Limits open connections: beyond a limit, the oldest one without a valid token is closed."""

import ipaddress
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

# Connections without and with a valid token: together below the usual limit of 1024 open files.
MAX_UNPROVEN, MAX_PROVEN = 384, 256
MAX_OF_AN_ADDRESS = 192  # connections of one client without a valid token


@dataclass(eq=False)
class ClientConnection:
    """One accepted connection of ``client``. ``cut`` closes the connection."""

    client: str
    cut: Callable[[], None]


class ClientConnections:
    """All connections, in order of arrival."""

    def __init__(self) -> None:
        self._unproven: dict[ClientConnection, None] = {}
        self._proven: dict[ClientConnection, None] = {}

    def add(self, connection: ClientConnection) -> None:
        """Add a connection; beyond a limit, close the oldest of this or the busiest client."""
        self._unproven[connection] = None
        counts = Counter(each.client for each in self._unproven)
        if counts[connection.client] > MAX_OF_AN_ADDRESS:
            self._cut_oldest(connection.client)
        elif len(self._unproven) > MAX_UNPROVEN:
            self._cut_oldest(max(counts, key=lambda client: counts[client]))

    def prove(self, connection: ClientConnection) -> None:
        """Mark a connection as having a valid token, if fewer than ``MAX_PROVEN`` are marked."""
        if connection in self._unproven and len(self._proven) < MAX_PROVEN:
            del self._unproven[connection]
            self._proven[connection] = None

    def remove(self, connection: ClientConnection) -> None:
        """Remove a connection that has ended."""
        self._unproven.pop(connection, None)
        self._proven.pop(connection, None)

    def cut_one(self) -> None:
        """Close the oldest connection without a valid token."""
        if self._unproven:
            self._cut_oldest(next(iter(self._unproven)).client)

    def _cut_oldest(self, client: str) -> None:
        oldest = next(each for each in self._unproven if each.client == client)
        del self._unproven[oldest]
        oldest.cut()


def client_at(address: object) -> str:
    """Return the client at an address: an IPv4 address, or the /64 network of an IPv6 address."""
    host = address[0] if isinstance(address, tuple) and address else ""
    try:
        found = ipaddress.ip_address(host)
    except ValueError:
        return str(host)
    if found.version == 4:
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, 64), strict=False))
