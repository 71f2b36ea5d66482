"""Stores a vehicle's battery reports, and learns how fast the battery discharges. Pure.

A value that differs much from the previous one is used only after it has lasted ``CONFIRMED_S``, so
that a single wrong value causes no return. In the air, a charge that rises much is not used:
batteries are swapped on the ground. If it lasts, the autopilot counts from a new beginning (an
ArduPilot that is restarted in flight assumes a full battery), and only its later falls are used. A
charge that falls faster than ``MAX_DISCHARGE_PCT_S`` is used, but counts as a correction, not as a
discharge (the simulated battery of PX4 falls to 50 % within half a minute, and stays there).
"""

import math
from dataclasses import dataclass, field

from mission_service.events import BatteryUpdated

CONFIRMED_S = 20.0
LEVEL_STEP_PCT = 10.0  # larger changes in charge must last
TIME_STEP_S = 180.0  # larger changes in the autopilot's estimate of the time of an empty battery
LEARN_EVERY_S = 30.0
MAX_DISCHARGE_PCT_S = 100.0 / 240.0  # a full battery in four minutes
LEVEL_SMOOTHING_S, CHARGE_SMOOTHING_S = 300.0, 120.0  # time constants
MIN_LEARNED_S, MIN_LEARNED_PCT = 120.0, 3.0  # flight and discharge before a rate is used
MIN_SHARE_PCT = 10.0  # discharge before the charge of one per cent is used
MAX_GAP_S = 60.0  # no current is integrated over a longer gap between reports


@dataclass(slots=True)
class Confirmed:
    """A value whose large changes are used only after they have lasted ``CONFIRMED_S``."""

    step: float
    value: float | None = None
    _new: float | None = None
    _since_s: float = 0.0

    def consider(self, value: float, at_s: float, may_rise: bool = True) -> None:
        """Use a value that is near the last one; otherwise start or continue waiting."""
        if self.value is not None and abs(value - self.value) <= self.step:
            self.value, self._new = value, None
        elif self.value is not None and value > self.value and not may_rise:
            self._new = None
        else:
            if self._new is None or abs(value - self._new) > self.step:
                self._since_s = at_s
            self._new = value
            self.settle(at_s)

    def settle(self, at_s: float) -> None:
        """Use the new value if it has lasted."""
        if self._new is not None and at_s - self._since_s >= CONFIRMED_S:
            self.value, self._new = self._new, None


@dataclass(slots=True)
class UseRate:
    """The smoothed consumption of a quantity per second of flight, kept between flights."""

    smoothing_s: float
    max_per_s: float = math.inf
    per_s: float = 0.0
    seen_s: float = 0.0  # flight time from which the rate was learned
    used: float = 0.0  # amount used in this time
    _last: tuple[float, float] | None = None  # time and remaining amount
    _before: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rate, time, use before the last span
    _corrected: bool = False  # whether the last span contained a correction

    def learn(self, left: float, at_s: float) -> None:
        """Update the rate from the amount that remains in flight.

        The first values are averaged with equal weights; later the rate is an exponential average.
        A span in which more than ``max_per_s`` is used is a correction. The spans before and after
        it, which may contain its beginning and its end, do not count either.
        """
        if self._last is None:
            self._last = at_s, left
            return
        span_s, used = at_s - self._last[0], self._last[1] - left
        if span_s < LEARN_EVERY_S:
            return
        self._last = at_s, left
        if abs(used) / span_s > self.max_per_s:
            self.per_s, self.seen_s, self.used = self._before
            self._corrected = True
            return
        if self._corrected:
            self._corrected = False
            return
        self._before = self.per_s, self.seen_s, self.used
        self.seen_s += span_s
        self.used += used
        weight = max(1.0 - math.exp(-span_s / self.smoothing_s), span_s / self.seen_s)
        self.per_s = max(self.per_s + weight * (used / span_s - self.per_s), 0.0)

    def end_flight(self) -> None:
        """Start afresh with the next flight; the rate is kept."""
        self._last = None


@dataclass(slots=True)
class BatteryReports:
    """The reports of one vehicle's battery, and the rates learned from them."""

    level: Confirmed = field(default_factory=lambda: Confirmed(LEVEL_STEP_PCT))  # percent
    empty_at: Confirmed = field(default_factory=lambda: Confirmed(TIME_STEP_S))  # the autopilot's
    level_rate: UseRate = field(
        default_factory=lambda: UseRate(LEVEL_SMOOTHING_S, MAX_DISCHARGE_PCT_S)
    )
    charge_rate: UseRate = field(default_factory=lambda: UseRate(CHARGE_SMOOTHING_S))  # mAh
    reported_pct: float | None = None  # charge in the last report that has one
    _excess_pct: float = 0.0  # of the reported charge over the one in use, after a rise in flight
    _risen: tuple[float, float] | None = None  # time and size of a rise that may be such an excess
    voltage_v: float | None = None
    low_voltage_since_s: float | None = None
    reported_at_s: float = -math.inf
    _used_mah: float = 0.0  # in this flight, as reported or integrated from the current
    _consumed_mah: float | None = None  # as last reported

    def apply(self, report: BatteryUpdated, airborne: bool, min_voltage_v: float | None) -> None:
        """Apply a report; voltages of 0, and charges of 0 % without a voltage, are ignored."""
        at_s = report.at_us / 1e6
        self._update_voltage(report.voltage_v, at_s, min_voltage_v)
        if report.percent is not None and (report.percent > 0.0 or report.voltage_v is not None):
            self.reported_pct = report.percent
            self._update_level(report.percent, at_s, airborne)
        if report.time_remaining_s is not None:
            self.empty_at.consider(at_s + report.time_remaining_s, at_s)
        else:
            self.empty_at = Confirmed(TIME_STEP_S)
        if airborne:
            self._use_charge(report, at_s)
            if self.level.value is not None and self._risen is None:
                self.level_rate.learn(self.level.value, at_s)
        self._consumed_mah = report.consumed_mah
        self.reported_at_s = at_s

    def settle(self, at_s: float) -> None:
        """Use the new values that have lasted, even if no further report has arrived."""
        self.level.settle(at_s)
        self.empty_at.settle(at_s)

    def end_flight(self) -> None:
        """Start afresh with the next flight, perhaps with another battery; the rates are kept."""
        self.level, self.empty_at = Confirmed(LEVEL_STEP_PCT), Confirmed(TIME_STEP_S)
        self.level_rate.end_flight()
        self.charge_rate.end_flight()
        self.reported_pct = self.low_voltage_since_s = self._risen = None
        self._used_mah = self._excess_pct = 0.0

    def level_pct(self, at_s: float) -> float | None:
        """Return the charge in percent; without recent reports, continued at the usual rate."""
        if self.level.value is None:
            return None
        silent_s = at_s - self.reported_at_s
        rate = self.level_rate.per_s if silent_s > MAX_GAP_S else 0.0
        return max(self.level.value - rate * silent_s, 0.0)

    def discharge_pct_s(self) -> float | None:
        """Return the percentage used per second; None until it has been learned."""
        rate = self.level_rate
        known = rate.seen_s >= MIN_LEARNED_S and rate.used >= MIN_LEARNED_PCT and rate.per_s > 0.0
        return rate.per_s if known else None

    def discharge_by_charge_pct_s(self) -> float | None:
        """Return the percentage used per second, from the current; None until it is learned."""
        level, charge = self.level_rate, self.charge_rate
        known = level.used >= MIN_SHARE_PCT and charge.seen_s >= MIN_LEARNED_S
        if not known or charge.used <= 0.0 or charge.per_s <= 0.0:
            return None
        return charge.per_s * level.used / charge.used

    def _update_level(self, reported_pct: float, at_s: float, airborne: bool) -> None:
        level_pct = self.level.value
        if level_pct is not None and abs(reported_pct - level_pct) <= LEVEL_STEP_PCT:
            self._excess_pct = 0.0
        rise_pct = 0.0 if level_pct is None else reported_pct - self._excess_pct - level_pct
        if not airborne or rise_pct <= LEVEL_STEP_PCT:
            self._risen = None
        elif self._risen is None:
            self._risen = at_s, rise_pct
        elif at_s - self._risen[0] >= CONFIRMED_S:
            self._excess_pct += self._risen[1]
            self._risen = None
        counted_pct = max(reported_pct - self._excess_pct, 0.0)
        self.level.consider(counted_pct, at_s, may_rise=not airborne)

    def _update_voltage(self, volts: float | None, at_s: float, min_v: float | None) -> None:
        if volts is None or volts <= 0.0:
            return
        self.voltage_v = volts
        if min_v is None or volts >= min_v:
            self.low_voltage_since_s = None
        elif self.low_voltage_since_s is None:
            self.low_voltage_since_s = at_s

    def _use_charge(self, report: BatteryUpdated, at_s: float) -> None:
        consumed, before = report.consumed_mah, self._consumed_mah
        if consumed is not None:
            used_mah = consumed - before if before is not None else 0.0
        elif report.current_a is not None and at_s - self.reported_at_s <= MAX_GAP_S:
            used_mah = report.current_a * (at_s - self.reported_at_s) / 3.6
        else:
            used_mah = 0.0
        if used_mah >= 0.0:
            self._used_mah += used_mah
        self.charge_rate.learn(-self._used_mah, at_s)
