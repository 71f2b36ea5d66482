"""Arrivals at places, and the alarms about them."""

from datetime import UTC

import msgspec
import numpy as np

from mission_service.fire_arrival.arrival_times import (
    ArrivalAlarms,
    FireArrival,
    arrival_text,
    fire_arrivals,
)
from mission_service.fire_arrival.places import Place

MIN_US = 60_000_000
NOW_US, UNIX_US = 100 * MIN_US, 1_795_304_000_000_000  # 23:33:20Z
FAR_US = NOW_US + 360 * MIN_US


def place(key: str) -> Place:
    return Place(key, key.title(), "value", 36.0, -84.0, None, np.array([0]))


def arrival(early_min: float | None, median_min: float | None = None) -> FireArrival:
    """Return an arrival in minutes from now."""
    times = [
        None if each is None else NOW_US + round(each * MIN_US) for each in (early_min, median_min)
    ]
    return FireArrival(
        *(NOW_US, UNIX_US, "value/road/1", "Road", "value", 36.0, -84.0, None),
        *(times[0], times[1], None, FAR_US),
    )


def test_arrivals_are_in_the_order_of_time() -> None:
    times_s = np.array([[np.inf, 7200.0, 7200.0], [np.inf, 9000.0, 8000.0], [np.inf] * 3])
    places = [place("never"), place("late"), place("soon")]
    found = fire_arrivals(places, times_s, (NOW_US, UNIX_US), FAR_US)
    assert [each.name for each in found] == ["Soon", "Late", "Never"]
    assert (found[0].early_at_us, found[0].late_at_us) == (7_200_000_000, None)
    assert found[2].early_at_us is None


def test_texts_state_local_times() -> None:
    assert arrival_text(arrival(12.0, 25.0), UTC) == (
        "Road: fire possible from 23:45 UTC, expected at 23:58 UTC"
    )
    assert arrival_text(arrival(12.0), UTC) == "Road: fire possible from 23:45 UTC"
    assert arrival_text(arrival(-1.0), UTC) == "Road: the fire may be there now"
    assert arrival_text(arrival(None), UTC) == "Road: no fire expected until 05:33 UTC"


def test_texts_state_mission_times_if_they_do_not_pass_as_real_time() -> None:
    found = msgspec.structs.replace(arrival(12.0, 25.0), at_unix_us=None)
    assert arrival_text(found, UTC) == "Road: fire possible from time 1:52, expected at time 2:05"


def alarms_after(*minutes: float | None) -> list[tuple[str, str] | None]:
    """Return the alarm after each of several arrivals, as severity and text."""
    alarms = ArrivalAlarms(3600.0, 1200.0, UTC)
    found: list[tuple[str, str] | None] = []
    for each in minutes:
        alarm = alarms.present([arrival(each)]).get("value/road/1")
        found.append(None if alarm is None else (alarm.severity, alarm.text[-9:]))
    return found


def test_an_alarm_becomes_severe_and_ends() -> None:
    assert alarms_after(61.0, 60.0, 20.0, None) == [
        None,
        ("warning", "00:33 UTC"),
        ("severe", "23:53 UTC"),
        None,
    ]


def test_an_alarm_near_its_limit_does_not_flutter() -> None:
    severities = [
        None if each is None else each[0]
        for each in alarms_after(60.0, 65.0, 73.0, 65.0, 20.0, 23.0, 25.0, 71.0, 73.0)
    ]
    assert severities == [
        *("warning", "warning", None, None),
        *("severe", "severe", "warning", "warning", None),
    ]


def test_a_small_change_does_not_change_the_text() -> None:
    texts = [each and each[1] for each in alarms_after(50.0, 47.0, 44.0, 50.0)]
    assert texts == ["00:23 UTC", "00:23 UTC", "00:17 UTC", "00:23 UTC"]


def test_the_text_changes_when_the_fire_has_arrived() -> None:
    first, second = alarms_after(0.3, -0.3)
    assert first is not None
    assert second is not None
    assert second[1].endswith("there now")
