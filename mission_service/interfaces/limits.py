"""Limits request rates and concurrent requests. Pure; ``now_s`` is a monotonic clock."""

from collections import Counter, OrderedDict

MAX_CLIENTS = 1024  # clients with a bucket; the least recently used bucket is dropped first


class RateLimiter:
    """A token bucket for each client.

    The bucket permits ``burst`` requests at once, and ``rate_s`` requests a second on average.
    """

    def __init__(self, rate_s: float, burst: float) -> None:
        self._rate_s = rate_s
        self._burst = burst
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def consume(self, client: str, now_s: float) -> float:
        """Take one token from the client's bucket and return 0, or return the seconds to wait."""
        left, at_s = self._left.get(client, (self._burst, now_s))
        left = min(self._burst, left + (now_s - at_s) * self._rate_s)
        if left < 1.0:
            return (1.0 - left) / self._rate_s
        self._left[client] = left - 1.0, now_s
        self._left.move_to_end(client)
        if len(self._left) > MAX_CLIENTS:
            self._left.popitem(last=False)
        return 0.0


class ConcurrencyLimiter:
    """A limit of concurrent requests: ``most`` in total and ``max_each`` from one client."""

    def __init__(self, most: int, max_each: int) -> None:
        self._most, self._max_each = most, max_each
        self._active: Counter[str] = Counter()

    @property
    def limits(self) -> str:
        """The limits in words."""
        if self._most == self._max_each:
            return f"the limit is {self._most}"
        return f"the limits are {self._max_each} per client and {self._most} in total"

    def acquire(self, client: str) -> bool:
        """Count a request until ``release``; return False if the limit is reached."""
        if self._active.total() >= self._most or self._active[client] >= self._max_each:
            return False
        self._active[client] += 1
        return True

    def release(self, client: str) -> None:
        """Count a request as ended."""
        self._active[client] -= 1
        if self._active[client] <= 0:
            del self._active[client]
