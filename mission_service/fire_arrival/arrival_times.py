"""Lists when the fire reaches places, and raises alarms about these arrivals. Pure."""

import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta, tzinfo
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mission_service.commands import Severity
from mission_service.fire_arrival.places import Kind, Place

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
SHARES = (0.1, 0.5, 0.9)  # probabilities of the three arrival times
END_FACTOR = 1.2  # an alarm ends when the early arrival exceeds its limit times this factor
# A text changes when the early arrival has changed by this share of the remaining time, and by at
# least this time.
CHANGED_SHARE, CHANGED_S = 0.1, 60.0


class FireArrival(msgspec.Struct, tag="fire_arrival/1", tag_field="schema"):
    """The forecast arrival of the fire at a person or a value at risk (position in WGS84).

    The fire arrives before ``early_at_us``, ``median_at_us`` and ``late_at_us`` (mission time) with
    a probability of 10, 50 and 90 %; None: not until ``until_us``. A time in the past is the
    estimated time of arrival. ``at_unix_us`` is the wall clock at ``at_us``, None if mission time
    does not pass as real time; ``position_unix_us`` is the time of a person's position.
    """

    at_us: int
    at_unix_us: int | None
    key: str
    name: str
    kind: Kind
    lat_deg: float
    lon_deg: float
    position_unix_us: int | None
    early_at_us: int | None
    median_at_us: int | None
    late_at_us: int | None
    until_us: int


def fire_arrivals(
    places: Sequence[Place], times_s: NDArray[np.float64], at: tuple[int, int | None], until_us: int
) -> list[FireArrival]:
    """Return the arrivals at places, the earliest first.

    Args:
        places: n places.
        times_s: Times (3, n) of the probabilities ``SHARES``, infinity for none.
        at: The current mission time, and the wall clock (microseconds since 1970), None if mission
            time does not pass as real time.
        until_us: The end of the forecast in mission time.
    """
    found = []
    for place, quantiles_s in zip(places, times_s.T.tolist(), strict=True):
        early_us, median_us, late_us = (
            round(each * 1e6) if math.isfinite(each) else None for each in quantiles_s
        )
        found.append(
            FireArrival(
                *at,
                place.key,
                place.name,
                place.kind,
                round(place.lat_deg, 7),
                round(place.lon_deg, 7),
                place.at_unix_us,
                early_us,
                median_us,
                late_us,
                until_us,
            )
        )
    return sorted(found, key=_order)


def _order(arrival: FireArrival) -> tuple[float, float, str]:
    times = (arrival.early_at_us, arrival.median_at_us)
    early_us, median_us = (math.inf if each is None else each for each in times)
    return early_us, median_us, arrival.key


class ArrivalAlarm(NamedTuple):
    """An alarm about a place; its text was composed when the early arrival was ``early_us``."""

    severity: Severity
    text: str
    early_us: int


class ArrivalAlarms:
    """The alarms about places that the fire may reach soon.

    A place has an alarm while the fire arrives within ``warn_s`` with a probability of 10 %; the
    alarm is severe within ``severe_s``. Texts contain local times in ``zone``.
    """

    def __init__(self, warn_s: float, severe_s: float, zone: tzinfo) -> None:
        self._limits_s: dict[Severity, float] = {"severe": severe_s, "warning": warn_s}
        self._zone = zone
        self._alarms: dict[str, ArrivalAlarm] = {}

    def present(self, arrivals: Iterable[FireArrival]) -> dict[str, ArrivalAlarm]:
        """Return the current alarms, by the key of their place."""
        found = {}
        for each in arrivals:
            alarm = self._alarm_of(each, self._alarms.get(each.key))
            if alarm is not None:
                found[each.key] = alarm
        self._alarms = found
        return found

    def _alarm_of(self, arrival: FireArrival, before: ArrivalAlarm | None) -> ArrivalAlarm | None:
        if arrival.early_at_us is None:
            return None
        left_s = (arrival.early_at_us - arrival.at_us) / 1e6
        severity = self._severity(left_s, before)
        if severity is None:
            return None
        text = arrival_text(arrival, self._zone)
        if before is not None and severity == before.severity:
            change_s = abs(arrival.early_at_us - before.early_us) / 1e6
            if change_s < max(CHANGED_SHARE * left_s, CHANGED_S) and left_s > 0.0:
                return before
        return ArrivalAlarm(severity, text, arrival.early_at_us)

    def _severity(self, left_s: float, before: ArrivalAlarm | None) -> Severity | None:
        for severity, limit_s in self._limits_s.items():
            was_as_severe = before is not None and before.severity in ("severe", severity)
            if left_s <= limit_s * (END_FACTOR if was_as_severe else 1.0):
                return severity
        return None


def arrival_text(arrival: FireArrival, zone: tzinfo) -> str:
    """Return a line such as "Engine 3: fire possible from 14:35 PDT, expected at 14:52 PDT".

    "possible" states the time with a probability of 10 %, "expected" that of 50 %.
    """
    if arrival.early_at_us is None:
        return f"{arrival.name}: no fire expected until {_clock(arrival.until_us, arrival, zone)}"
    if arrival.early_at_us <= arrival.at_us:
        return f"{arrival.name}: the fire may be there now"
    text = f"{arrival.name}: fire possible from {_clock(arrival.early_at_us, arrival, zone)}"
    if arrival.median_at_us is not None:
        text += f", expected at {_clock(arrival.median_at_us, arrival, zone)}"
    return text


def _clock(at_us: int, arrival: FireArrival, zone: tzinfo) -> str:
    """Return a mission time as a local time ("14:35 PDT"), or as mission time ("time 1:13")."""
    if arrival.at_unix_us is None:
        return f"time {at_us // 3_600_000_000}:{at_us // 60_000_000 % 60:02d}"
    after = timedelta(microseconds=arrival.at_unix_us + at_us - arrival.at_us)
    return f"{(EPOCH + after).astimezone(zone):%H:%M %Z}"
