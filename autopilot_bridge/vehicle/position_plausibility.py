"""Checks whether an autopilot's times since boot and its positions are plausible.

The checks read no clock: ``now_us`` is the time of the link (in a log, the time at which the
message was recorded).

*Times.* The time since boot advances as fast as the link's clock; in simulations it may advance
faster or slower. A line is fitted to the received times by medians, so that a minority of wrong
times has no effect; the line gives the expected time since boot at each moment. A time is not used
if it is later than the expected time by more than ``AHEAD_US`` (in simulations: by more than the
vehicle's clock advances in ten seconds), or if it is earlier than the latest received time by more
than ``BACK_US`` (in simulations: five seconds of the vehicle's clock). The times in delayed
messages and in bursts are earlier than expected, and are accepted.

Autopilots count from zero at boot (``hrt_absolute_time`` in PX4, ``millis`` in ArduPilot). A new
series of times is therefore a *restart* only if its first time since boot does not exceed the
length of the silence before the series. The series must include every message received during
``REBOOT_KEPT_US`` and at least ``KEPT`` messages. Any other series that includes every message
received during ``CHANGED_KEPT_US`` is adopted as the autopilot's new time: its clock was set, or
this machine's clock stood still. Mission time then continues without a jump.

*Positions.* A position is discarded if the airframe could not have flown there from its last
positions in the elapsed time. Positions that are consistent with each other for ``PLACES_KEPT_US``
are adopted: a simulated vehicle was moved, or a wrong position estimate was corrected. After a
start of the autopilot, positions are checked only once the position estimate is healthy.

A forged message within these limits that comes from the vehicle's own address cannot be
distinguished from a true message. Signed links prevent forgery.
"""

import math
from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import Literal

from autopilot_bridge.vehicle.client_events import Position

AHEAD_US = 3_000_000
BACK_US = 5_000_000
KEPT = 4
REBOOT_KEPT_US = 1_000_000
CHANGED_KEPT_US = 3_000_000
POINTS = 10  # number of points to which the line is fitted
MAX_SINCE = 64
BY_CHANCE = 2
FITS = 60  # a simulation that has fallen behind may catch up within a minute
FIRST_EVERY_US, EVERY_US = 100_000, 1_000_000
# Limits in the first second, before the rate is fitted: those of the fastest simulation.
FASTEST, BURST_US = 200.0, 30_000_000
SLOWEST = 0.1  # rate of the slowest simulation
REAL = 1.25  # a clock that runs faster than this is simulated
SIMULATED_AHEAD_S = 10.0

PLACES_KEPT_US = 2_000_000
ANCHORED_US = 2_000_000
MARGIN_M = 50.0
M_PER_DEG = 111_320.0

TimeVerdict = Literal["kept", "ahead", "back", "rebooted", "changed"]
PlaceVerdict = Literal["kept", "beyond", "adopted"]


@dataclass(slots=True)
class _Base:
    """A consistent series of times that does not continue the accepted series."""

    first_boot_us: int
    first_us: int
    boot_us: int
    at_us: int
    messages: int = 1

    def continues(self, boot_us: int, now_us: int) -> bool:
        max_us = self.boot_us + BURST_US + FASTEST * (now_us - self.at_us)
        return self.boot_us - BACK_US <= boot_us <= max_us

    def advances(self) -> bool:
        """Return whether the times advance like a clock instead of repeating one value."""
        return self.boot_us - self.first_boot_us >= SLOWEST * (self.at_us - self.first_us)


class BootClock:
    """The times since boot of one autopilot."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, int]] = deque(maxlen=POINTS)  # (now_us, boot_us)
        self._since: list[tuple[int, int]] = []  # times received since the last point
        self._latest_us: int | None = None  # time since boot
        self._received_us = 0
        self._rates: deque[float] = deque(maxlen=FITS)
        self._peak = 1.0  # the third greatest of ``_rates``, because two may be outliers
        self._slope = 1.0
        self._line = (0, 0.0)  # a point of the fitted line: (now_us, boot_us)
        self._other: _Base | None = None

    @property
    def rate(self) -> float:
        """The highest rate at which the autopilot's clock may run, relative to the link's clock."""
        return 1.0 if self._peak <= REAL else REAL * self._peak

    def ahead_us(self, boot_us: int, now_us: int) -> int:
        """Return by how many microseconds a time since boot is ahead of the expected time."""
        if self._latest_us is None:
            return 0
        if len(self._points) < POINTS:
            return round(boot_us - self._latest_us - self.rate * (now_us - self._received_us))
        at_us, line_us = self._line
        return round(boot_us - line_us - self._slope * (now_us - at_us))

    def judge(self, boot_us: int, now_us: int) -> TimeVerdict:
        """Classify a time since boot; ``rebooted`` and ``changed`` begin a new series."""
        if self._latest_us is None:
            self._begin(boot_us, now_us)
            return "kept"
        back_us = BACK_US * (1.0 if self._peak <= REAL else self._peak)
        if self._latest_us - back_us <= boot_us <= max(self._max_us(now_us), self._latest_us):
            self._other = None
            self._latest_us = max(self._latest_us, min(boot_us, self._expected_us(now_us)))
            self._received_us = now_us
            self._add_point(boot_us, now_us)
            return "kept"
        other = self._other
        if other is None or not other.continues(boot_us, now_us):
            self._other = _Base(boot_us, now_us, boot_us, now_us)
            return "back" if boot_us < self._latest_us else "ahead"
        other.boot_us, other.at_us = max(other.boot_us, boot_us), now_us
        other.messages += 1
        silent_us = other.first_us - self._received_us
        slack_us = SIMULATED_AHEAD_S * 1e6 * max(self._peak, 1.0)
        restarts = boot_us < self._latest_us
        restarts &= other.first_boot_us <= self.rate * silent_us + slack_us
        kept_us = REBOOT_KEPT_US if restarts else CHANGED_KEPT_US
        if other.messages >= KEPT and now_us - other.first_us >= kept_us and other.advances():
            self._begin(boot_us, now_us)
            return "rebooted" if restarts else "changed"
        return "back" if boot_us < self._latest_us else "ahead"

    def _begin(self, boot_us: int, now_us: int) -> None:
        self._points.clear()
        self._rates.clear()
        self._since.clear()
        self._peak = 1.0
        self._latest_us, self._received_us, self._other = boot_us, now_us, None
        self._add_point(boot_us, now_us)

    def _max_us(self, now_us: int) -> float:
        """Return the greatest time since boot that is accepted now."""
        at_us, boot_us = self._line
        if len(self._points) < POINTS:
            return boot_us + FASTEST * (now_us - at_us) + BURST_US
        slack_us = AHEAD_US if self._peak <= REAL else SIMULATED_AHEAD_S * 1e6 * self._peak
        return boot_us + self.rate * (now_us - at_us) + slack_us

    def _expected_us(self, now_us: int) -> int:
        """Return the upper limit of ``_latest_us``: one wrong time must not make others late."""
        if len(self._points) < POINTS:
            return 1 << 62
        at_us, boot_us = self._line
        return round(boot_us + self._slope * (now_us - at_us)) + AHEAD_US

    def _add_point(self, boot_us: int, now_us: int) -> None:
        points = self._points
        every_us = EVERY_US if len(points) == POINTS else FIRST_EVERY_US
        if len(self._since) < MAX_SINCE:
            self._since.append((now_us, boot_us))
        if points and now_us - points[-1][0] < every_us:
            return
        ordered = sorted(self._since, key=lambda since: since[1] - since[0])
        points.append(ordered[len(ordered) // 2])
        self._since.clear()
        if len(points) < POINTS:
            self._line = points[0]
            return
        half = POINTS // 2
        slopes = [
            (points[n + half][1] - points[n][1]) / (points[n + half][0] - points[n][0])
            for n in range(half)
        ]
        slope = median(slopes)
        self._rates.append(slope)
        self._peak = max(1.0, sorted(self._rates)[-min(len(self._rates), BY_CHANCE + 1)])
        if self._peak <= REAL:
            slope = 1.0
        self._slope = slope
        self._line = (now_us, median(boot + slope * (now_us - at) for at, boot in points))


@dataclass(slots=True)
class _Elsewhere:
    """A consistent series of positions that does not continue the accepted series."""

    first: Position
    last: Position
    places: int = 1


class Reach:
    """The positions that one airframe can reach."""

    def __init__(self, speed_m_s: float | None) -> None:
        """Create the check for a maximum horizontal and vertical speed; None disables the check."""
        self._speed_m_s = speed_m_s
        self._last: Position | None = None
        self._anchor: Position | None = None  # an older position, so that errors do not accumulate
        self._other: _Elsewhere | None = None

    def forget_times(self) -> None:
        """Use the link's clock for the next position, because the time since boot has restarted."""
        self._anchor = self._other = None

    def forget_positions(self) -> None:
        """Accept any position next, because no earlier one is reliable."""
        self._last = self._anchor = self._other = None

    def judge(self, place: Position, rate: float) -> PlaceVerdict:
        """Classify a position; ``rate`` is ``BootClock.rate``."""
        if self._speed_m_s is None:
            return "kept"
        last, anchor = self._last, self._anchor
        if last is None:
            self._use(place)
            return "kept"
        passed_us = (place.at_us - last.at_us) * rate if anchor is None else _passed_us(last, place)
        if self._is_reachable(last, place, passed_us) and (
            anchor is None or self._is_reachable(anchor, place, _passed_us(anchor, place))
        ):
            self._use(place)
            return "kept"
        other = self._other
        if other is None or not self._is_reachable(
            other.last, place, _passed_us(other.last, place)
        ):
            self._other = _Elsewhere(place, place)
            return "beyond"
        other.last, other.places = place, other.places + 1
        if other.places < KEPT or _passed_us(other.first, place) < PLACES_KEPT_US:
            return "beyond"
        self._anchor = None
        self._use(place)
        return "adopted"

    def beyond_m(self, place: Position) -> float:
        """Return the distance in metres between a position and the last position that was used."""
        return 0.0 if self._last is None else max(map(abs, _apart_m(self._last, place)))

    def _use(self, place: Position) -> None:
        self._last, self._other = place, None
        if self._anchor is None or _passed_us(self._anchor, place) >= ANCHORED_US:
            self._anchor = place

    def _is_reachable(self, before: Position, place: Position, passed_us: float) -> bool:
        assert self._speed_m_s is not None
        max_m = self._speed_m_s * max(passed_us, 0.0) / 1e6 + MARGIN_M
        ground_m, up_m, up_relative_m = _apart_m(before, place)
        return max(ground_m, abs(up_m), abs(up_relative_m)) <= max_m


def _passed_us(before: Position, place: Position) -> int:
    return place.boot_us - before.boot_us


def _apart_m(before: Position, place: Position) -> tuple[float, float, float]:
    """Return three distances in metres: horizontal, in altitude, and in height above home."""
    north_deg = place.lat_deg - before.lat_deg
    east_deg = (place.lon_deg - before.lon_deg + 180.0) % 360.0 - 180.0
    east_deg *= math.cos(math.radians(place.lat_deg))
    ground_m = math.hypot(north_deg, east_deg) * M_PER_DEG
    return (
        ground_m,
        place.altitude_amsl_m - before.altitude_amsl_m,
        place.altitude_relative_m - before.altitude_relative_m,
    )
