"""Open connections. Beyond a limit the oldest connection without a valid token is closed."""

import ipaddress
from collections import Counter
from collections.abc import Callable

MAX_UNPROVEN = 384  # connections without a valid token; together with those that have one they ...
MAX_PROVEN = 256  # ... stay below the 1024 files that a process usually may have open
MAX_OF_AN_ADDRESS = 192  # of the unproven


class ClientConnection:
    """One connection, from its acceptance on. ``cut`` closes it."""

    def __init__(self, client: str, cut: Callable[[], None]) -> None:
        self.client = client
        self.cut = cut


class ClientConnections:
    """All connections, in the order of their arrival."""

    def __init__(self) -> None:
        self._unproven: dict[ClientConnection, None] = {}
        self._proven: dict[ClientConnection, None] = {}

    def come(self, caller: ClientConnection) -> None:
        """Add a connection; beyond a limit close one, of its own or of the busiest address."""
        self._unproven[caller] = None
        counts = Counter(each.client for each in self._unproven)
        if counts[caller.client] > MAX_OF_AN_ADDRESS:
            self._cut_oldest(caller.client)
        elif len(self._unproven) > MAX_UNPROVEN:
            self._cut_oldest(max(counts, key=lambda client: counts[client]))

    def prove(self, caller: ClientConnection) -> None:
        """Keep a connection with a valid token; at most ``MAX_PROVEN`` are kept."""
        if caller in self._unproven and len(self._proven) < MAX_PROVEN:
            del self._unproven[caller]
            self._proven[caller] = None

    def remove(self, caller: ClientConnection) -> None:
        """Remove a connection that has ended."""
        self._unproven.pop(caller, None)
        self._proven.pop(caller, None)

    def cut_one(self) -> None:
        """Close the oldest connection without a valid token."""
        for caller in self._unproven:
            self._cut_oldest(caller.client)
            return

    def _cut_oldest(self, client: str) -> None:
        oldest = next(each for each in self._unproven if each.client == client)
        del self._unproven[oldest]
        oldest.cut()


def client_at(address: object) -> str:
    """Return what counts as one client: an IPv4 address, the /64 network of an IPv6 one."""
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
