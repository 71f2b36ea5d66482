"""Open connections. Beyond a limit the oldest connection without a valid token is closed."""

import ipaddress
from collections import Counter
from collections.abc import Callable

MOST_UNPROVEN = 384  # connections that have shown no token; together with the proven ones they ...
MOST_PROVEN = 256  # ... stay below the 1024 files that a process usually may have open
MOST_OF_AN_ADDRESS = 192  # of the unproven


class Caller:
    """One connection, from its acceptance on. ``cut`` closes it."""

    def __init__(self, client: str, cut: Callable[[], None]) -> None:
        self.client = client
        self.cut = cut


class Callers:
    """All connections, in the order of their arrival."""

    def __init__(self) -> None:
        self._unproven: dict[Caller, None] = {}
        self._proven: dict[Caller, None] = {}

    def come(self, caller: Caller) -> None:
        """Add a connection; beyond a limit close one, of its own or of the busiest address."""
        self._unproven[caller] = None
        counts = Counter(each.client for each in self._unproven)
        if counts[caller.client] > MOST_OF_AN_ADDRESS:
            self._cut_oldest(caller.client)
        elif len(self._unproven) > MOST_UNPROVEN:
            self._cut_oldest(max(counts, key=lambda client: counts[client]))

    def prove(self, caller: Caller) -> None:
        """Keep a connection with a valid token; at most ``MOST_PROVEN`` are kept."""
        if caller in self._unproven and len(self._proven) < MOST_PROVEN:
            del self._unproven[caller]
            self._proven[caller] = None

    def leave(self, caller: Caller) -> None:
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
    """What counts as one client: an IPv4 address, the /64 network of an IPv6 one."""
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
