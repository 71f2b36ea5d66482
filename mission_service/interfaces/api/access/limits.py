"""Limits of rates and of concurrent requests. Pure; ``now_s`` is a monotonic clock."""

from collections import Counter, OrderedDict

MAX_CLIENTS = 1024  # with a bucket; the least recently used bucket is dropped first


class RateLimiter:
    """One bucket per client: ``burst`` requests at once, ``rate_s`` per second on average."""

    def __init__(self, rate_s: float, burst: float) -> None:
        self._rate_s = rate_s
        self._burst = burst
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_s(self, client: str, now_s: float) -> float:
        """Return time until the next request of ``client`` is allowed: 0 if it is allowed now."""
        left, at_s = self._left.get(client, (self._burst, now_s))
        left = min(self._burst, left + (now_s - at_s) * self._rate_s)
        return 0.0 if left >= 1.0 else (1.0 - left) / self._rate_s

    def consume(self, client: str, now_s: float) -> float:
        """Take one request from the bucket and return 0, or return the seconds to wait."""
        wait_s = self.wait_s(client, now_s)
        if wait_s == 0.0:
            left, at_s = self._left.pop(client, (self._burst, now_s))
            self._left[client] = (
                min(self._burst, left + (now_s - at_s) * self._rate_s) - 1.0,
                now_s,
            )
            if len(self._left) > MAX_CLIENTS:
                self._left.popitem(last=False)
        return wait_s


class ConcurrencyLimiter:
    """Limits concurrent requests: ``most`` in total, ``max_each`` of one client."""

    def __init__(self, most: int, max_each: int) -> None:
        self.most = most
        self._max_each = max_each
        self._inside: Counter[str] = Counter()

    def acquire(self, client: str) -> bool:
        """Count a request until ``leave``; False if the limit is reached."""
        if self._inside.total() >= self.most or self._inside[client] >= self._max_each:
            return False
        self._inside[client] += 1
        return True

    def release(self, client: str) -> None:
        """Count a request as ended."""
        self._inside[client] -= 1
        if self._inside[client] <= 0:
            del self._inside[client]
