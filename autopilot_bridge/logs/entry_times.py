"""Computes flight time for the log of a simulator that ran faster or slower than real time.

The timestamps in a .tlog are those of the recorder's clock. If the autopilots' time since boot
advances at a different rate from the timestamps, flight time advances at the autopilots' rate.
"""

from collections.abc import Iterator
from statistics import median

Sample = tuple[int, int, int]  # system id, stamp, and time since boot; times in microseconds

SAMPLES, MIN_PAIRS = 400, 10
SPAN_US, APART_US = 5_000_000, 1_000_000  # minimum intervals: first to last timestamp; in a pair
MIN_RATE, MAX_RATE = 0.8, 1.25  # rates in this range may come from clock errors or link delays
LEAP_US = 60_000_000  # a time this far ahead of the expected time is noise or a reboot
STILL_US = 1_000_000  # after this long without a time since boot, time is extrapolated


def rate_of(samples: Iterator[Sample]) -> float:
    """Return the rate of the autopilots' time relative to timestamps; 1 if samples are too few.

    The rate is the median over pairs of samples, so that noise, pauses and late records have little
    effect.
    """
    by_system: dict[int, list[tuple[int, int]]] = {}
    for number, (system, stamp_us, boot_us) in enumerate(samples, start=1):
        series = by_system.setdefault(system, [])
        series.append((stamp_us, boot_us))
        if number >= SAMPLES and stamp_us - series[0][0] >= SPAN_US:
            break
    rates = _rates(max(by_system.values(), key=len, default=[]))
    rate = median(rates) if len(rates) >= MIN_PAIRS else 1.0
    return 1.0 if rate <= 0.0 or MIN_RATE <= rate <= MAX_RATE else rate


def _rates(series: list[tuple[int, int]]) -> list[float]:
    """Return the rate between each sample and the first sample at least ``APART_US`` later."""
    rates, later = [], 0
    for stamp_us, boot_us in series:
        while later < len(series) and series[later][0] - stamp_us < APART_US:
            later += 1
        if later == len(series):
            break
        later_us, later_boot_us = series[later]
        rates.append((later_boot_us - boot_us) / (later_us - stamp_us))
    return rates


class FlightTime:
    """A converter from a log's timestamps to flight time, which never decreases."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._latest_us = 0
        self._anchor: tuple[int, int] | None = None  # (flight time, stamp) of the last record
        self._offset_us: dict[int, int] = {}  # flight time minus time since boot, by system

    def flight_us(self, stamp_us: int, system: int, boot_us: int | None) -> int:
        """Return a record's flight time, from its timestamp and its time since boot, if any."""
        if self._rate == 1.0:
            return stamp_us
        if self._anchor is None:
            self._anchor = (stamp_us, stamp_us)
            self._latest_us = stamp_us
        anchor_us, anchor_stamp_us = self._anchor
        elapsed_us = stamp_us - anchor_stamp_us
        expected_us = anchor_us + round(self._rate * elapsed_us)
        if boot_us is not None:
            found_us = self._by_boot(system, boot_us, expected_us)
            self._latest_us = max(self._latest_us, found_us)
            self._anchor = (self._latest_us, stamp_us)
        elif self._rate * elapsed_us > STILL_US:
            self._latest_us = max(self._latest_us, expected_us)
        return self._latest_us

    def _by_boot(self, system: int, boot_us: int, expected_us: int) -> int:
        """Return the flight time for a time since boot, using the system's stored offset.

        A reboot, a pause or noise resets the offset.
        """
        found_us = boot_us + self._offset_us.get(system, expected_us - boot_us)
        if not self._latest_us - STILL_US <= found_us <= expected_us + LEAP_US:
            found_us = expected_us
        self._offset_us[system] = found_us - boot_us
        return found_us
