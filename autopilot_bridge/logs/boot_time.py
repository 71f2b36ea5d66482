"""Flight time from a log recorded by another clock, as with a fast or slow simulator.

Stamps of a .tlog are by the recorder's clock. If the autopilots' time since boot runs at another
rate, the flight's time follows it.
"""

from collections.abc import Iterator
from statistics import median

Sample = tuple[int, int, int]  # system id, stamp, time since boot; microseconds

SAMPLES, MIN_PAIRS = 400, 10
SPAN_US, APART_US = 5_000_000, 1_000_000  # time between stamps: of all samples, of a pair
MIN_RATE, MAX_RATE = 0.8, 1.25  # rates between these are clock errors or link delays
LEAP_US = 60_000_000  # a boot time this far ahead of the expected one is noise or a reboot
STILL_US = 1_000_000  # after this time without boot times, flight time follows the rate


def rate_of(samples: Iterator[Sample]) -> float:
    """Return the rate of the autopilots' time relative to the stamps; 1 if too few samples show it.

    The median over pairs of samples, so that noise, pauses and late records count little.
    """
    by_system: dict[int, list[tuple[int, int]]] = {}
    for number, (system, stamp_us, boot_us) in enumerate(samples, start=1):
        known = by_system.setdefault(system, [])
        known.append((stamp_us, boot_us))
        if number >= SAMPLES and stamp_us - known[0][0] >= SPAN_US:
            break
    rates = _rates(max(by_system.values(), key=len, default=[]))
    rate = median(rates) if len(rates) >= MIN_PAIRS else 1.0
    return 1.0 if rate <= 0.0 or MIN_RATE <= rate <= MAX_RATE else rate


def _rates(known: list[tuple[int, int]]) -> list[float]:
    """Return the rate of each sample and the next one at least ``APART_US`` later."""
    rates, later = [], 0
    for stamp_us, boot_us in known:
        while later < len(known) and known[later][0] - stamp_us < APART_US:
            later += 1
        if later == len(known):
            break
        later_us, later_boot_us = known[later]
        rates.append((later_boot_us - boot_us) / (later_us - stamp_us))
    return rates


class FlightTime:
    """Conversion of a log's stamps to flight time, which never decreases."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._latest_us = 0
        self._known: tuple[int, int] | None = None  # the flight's time at a stamp
        self._offset_us: dict[int, int] = {}  # from each system's time since boot

    def at(self, stamp_us: int, system: int, boot_us: int | None) -> int:
        """Return the flight time of a record, from its stamp and its time since boot if it has one."""
        if self._rate == 1.0:
            return stamp_us
        if self._known is None:
            self._known = (stamp_us, stamp_us)
            self._latest_us = stamp_us
        then_us, then_stamp_us = self._known
        passed_us = stamp_us - then_stamp_us
        expected_us = then_us + round(self._rate * passed_us)
        if boot_us is not None:
            found_us = self._by_boot(system, boot_us, expected_us)
            self._latest_us = max(self._latest_us, found_us)
            self._known = (self._latest_us, stamp_us)
        elif self._rate * passed_us > STILL_US:
            self._latest_us = max(self._latest_us, expected_us)
        return self._latest_us

    def _by_boot(self, system: int, boot_us: int, expected_us: int) -> int:
        """Return the flight time by a system's offset, which is reset after a reboot, a pause or noise."""
        found_us = boot_us + self._offset_us.get(system, expected_us - boot_us)
        if not self._latest_us - STILL_US <= found_us <= expected_us + LEAP_US:
            found_us = expected_us
        self._offset_us[system] = found_us - boot_us
        return found_us
