"""Determines alert levels for an aircraft from sets of thresholds, with hysteresis. Pure.

Level 1 is preventive, 2 corrective and 3 a warning, as in RTCA DO-365; 0 is no alert. The
hysteresis rules are those of NASA's DAIDALUS (reference manual, chapter on alerting): a level
applies if m of the last n values reach it, an alert persists for a minimum time, and an alert in
force ends only when the violation is farther away than the early alerting time.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from mission_service.ground_distance import M_PER_FT, M_PER_NMI
from mission_service.surveillance.well_clear import Encounter, WellClearVolume, violation

EPSILON_S = 1e-9
CORRECTIVE, WARNING = 2, 3


class AlertLevel(NamedTuple):
    """The thresholds of one level; the early alerting time applies while the level is in force."""

    volume: WellClearVolume
    alerting_s: float
    early_alerting_s: float


class AlertSet(NamedTuple):
    """The levels, from 1, and the hysteresis of an alerter; an ``of`` of 0 disables m of n."""

    levels: tuple[AlertLevel, ...]
    lookahead_s: float = 180.0
    enough: int = 2  # m
    of: int = 4  # n
    hysteresis_s: float = 5.0  # after a longer pause, earlier values are ignored
    persistence_s: float = 4.0

    @property
    def well_clear(self) -> WellClearVolume:
        """The volume of the corrective alert, whose violation is a loss of well clear."""
        return self.levels[CORRECTIVE - 1].volume


def _volume(dthr_m: float, zthr_ft: float, tthr_s: float, tcoa_s: float = 0.0) -> WellClearVolume:
    return WellClearVolume(dthr_m, zthr_ft * M_PER_FT, tthr_s, tcoa_s)


def _levels(
    preventive: WellClearVolume,
    well_clear: WellClearVolume,
    times_s: tuple[tuple[float, float], ...],
) -> tuple[AlertLevel, ...]:
    """Return the three levels with their alerting and early alerting times."""
    volumes = (preventive, well_clear, well_clear)
    return tuple(AlertLevel(each, *times) for each, times in zip(volumes, times_s, strict=True))


_EN_ROUTE_M = 0.66 * M_PER_NMI
_TERMINAL = _volume(1500.0 * M_PER_FT, 450.0, 0.0)
_NON_COOPERATIVE = _volume(2200.0 * M_PER_FT, 450.0, 0.0)
_SMALL_M = 2000.0 * M_PER_FT
_BUFFERED = _levels(
    _volume(M_PER_NMI, 750.0, 35.0, 20.0),
    _volume(M_PER_NMI, 450.0, 35.0, 20.0),
    ((60.0, 75.0), (60.0, 75.0), (30.0, 55.0)),
)
ALERT_SETS: dict[str, AlertSet] = {
    # ASTM F3442/F3442M: 2000 ft and 250 ft. The standard states no alerting times; these are those
    # of DO-365 for non-cooperative aircraft, without the long early times.
    "small_uas": AlertSet(
        _levels(
            _volume(_SMALL_M, 450.0, 0.0),
            _volume(_SMALL_M, 250.0, 0.0),
            ((55.0, 75.0), (55.0, 75.0), (25.0, 55.0)),
        )
    ),
    "do_365_en_route": AlertSet(
        _levels(
            _volume(_EN_ROUTE_M, 700.0, 35.0),
            _volume(_EN_ROUTE_M, 450.0, 35.0),
            ((55.0, 75.0), (55.0, 75.0), (25.0, 55.0)),
        )
    ),
    "do_365_terminal": AlertSet(
        _levels(_TERMINAL, _TERMINAL, ((45.0, 75.0), (45.0, 75.0), (45.0, 75.0)))
    ),
    "do_365_non_cooperative": AlertSet(
        _levels(_NON_COOPERATIVE, _NON_COOPERATIVE, ((55.0, 110.0), (55.0, 110.0), (25.0, 90.0)))
    ),
    "buffered_en_route": AlertSet(_BUFFERED, enough=0, of=0, hysteresis_s=0.0, persistence_s=0.0),
}


@dataclass
class AlertHistory:
    """The alert level for one aircraft, and the values on which it depends."""

    level: int = -1  # before the first update
    at_us: int | None = None
    raised_at_us: int | None = None  # time of the last rise; reset by a pause
    values: deque[int] = field(default_factory=deque)  # the last n values

    def add_encounter(self, alerts: AlertSet, encounter: Encounter, at_us: int) -> int:
        """Add an encounter at a mission time later than the last one; return the alert level."""
        value = self._value(alerts, encounter, at_us)
        if self.at_us is None or at_us - self.at_us > 1e6 * alerts.hysteresis_s:
            self.level, self.raised_at_us = -1, None
            absent = alerts.of - alerts.enough
            self.values = deque([value] * alerts.enough + [-1] * absent, maxlen=alerts.of)
        filtered = self._filtered(alerts, value)
        raised_us = self.raised_at_us
        persists = (
            raised_us is not None
            and self.level > 0
            and filtered < self.level
            and at_us - raised_us < 1e6 * alerts.persistence_s
        )
        if not persists:
            if filtered > max(self.level, 0):
                self.raised_at_us = at_us
            self.level = max(filtered, 0)
        self.at_us = at_us
        return self.level

    def _value(self, alerts: AlertSet, encounter: Encounter, at_us: int) -> int:
        """Return the most severe level whose volume is violated within its alerting time."""
        for number in range(len(alerts.levels), 0, -1):
            level = alerts.levels[number - 1]
            found = violation(encounter, level.volume, alerts.lookahead_s)
            in_force = self.at_us is not None and self.at_us < at_us and self.level == number
            within_s = level.early_alerting_s if in_force else level.alerting_s
            if found is not None and (found[0] == 0.0 or found[0] < within_s - EPSILON_S):
                return number
        return 0

    def _filtered(self, alerts: AlertSet, value: int) -> int:
        """Return the highest level reached by ``enough`` of the last values; -1 if there is none.

        Without m of n, this is the value itself.
        """
        if not alerts.of:
            return value
        self.values.append(value)
        return sorted(self.values, reverse=True)[alerts.enough - 1]
