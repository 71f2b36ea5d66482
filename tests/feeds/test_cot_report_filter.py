"""Which received events become observations: groups, roles, resends, changes, times and rates."""

import re
from typing import Any

import msgspec
import pytest
from pydantic import ValidationError

from mission_service.config.service_section import CotReportsSection, CotSection
from mission_service.interfaces.cot.received_events import parse_event
from mission_service.interfaces.cot.report_filter import (
    MAX_WAITING,
    RETRY_S,
    TOTAL_BURST,
    USER_BURST,
    USER_RATE_S,
    WAIT_S,
    Accepted,
    Refused,
    ReportFilter,
)
from mission_service.requests import Observe
from tests.feeds.tak_events import HERE, HOPE, NOW_US, RING, deletion, marker, shape, user

SETTINGS = CotReportsSection(groups=("cyan", "Red"), roles=("team member",))
MINUTE_US = 60_000_000


class Filter:
    """A filter with its clocks; the request handler accepts every request."""

    def __init__(self, journal: frozenset[bytes] = frozenset(), **settings: Any) -> None:
        self.settings = SETTINGS.model_copy(update=settings)
        self.now_s, self.unix_us = 100.0, NOW_US
        self.filter = ReportFilter(self.settings, journal.__contains__)
        self.digests: set[bytes] = set()

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.unix_us += round(1e6 * seconds)

    def requests(self, *events: bytes) -> list[dict[str, Any]]:
        """Return the requests of events, which must cause no refusal."""
        verdicts = self.verdicts(*events)
        assert all(isinstance(each, Accepted) for each in verdicts), verdicts
        return [each.request for each in verdicts if isinstance(each, Accepted)]

    def problems(self, *events: bytes) -> list[str]:
        """Return the refusals of events, which must cause no request."""
        verdicts = self.verdicts(*events)
        assert all(isinstance(each, Refused) for each in verdicts), verdicts
        return [each.problem for each in verdicts if isinstance(each, Refused)]

    def verdicts(self, *events: bytes) -> list[Accepted | Refused]:
        found: list[Accepted | Refused] = []
        for data in events:
            event = parse_event(data)
            assert event is not None
            verdicts = self.filter.receive(event, self.now_s, self.unix_us)
            for each in verdicts:
                if isinstance(each, Accepted):
                    msgspec.convert(each.request, Observe)  # a valid request
                    self.filter.add_accepted(each.report)
                    self.digests.add(each.report.digest)
            found += verdicts
        return found


def test_a_marker_of_an_accepted_user_is_a_request() -> None:
    found = Filter()
    found.wait(12.5)
    assert found.requests(user(), marker(ce=40.0)) == [
        {
            "do": "observe",
            "by": "cot:HOPE",
            "station": f"cot:{HOPE}",
            "state": "burning",
            "shape": "points",
            "points": (HERE,),
            "age_s": 12.5,
            "position_sd_m": 40.0,
            "false_alarms_pct": 5.0,
            "missed_pct": 5.0,
        }
    ]
    (request,) = Filter(position_sd_m=15.0, missed_pct=0.0).requests(user(), shape())
    assert (request["points"], request["shape"]) == (RING, "polygon")
    assert (request["position_sd_m"], request["missed_pct"]) == (15.0, 0.0)


@pytest.mark.parametrize(
    ("group", "role", "problem"),
    [
        (
            "Blue",
            "Team Member",
            "its creator is in the group Blue, which is not listed in `groups`",
        ),
        ("CYAN", "HQ", "its creator has the role HQ, which is not listed in `roles`"),
        ("Red", "", r"its creator has the role \(none\)"),
    ],
)
def test_other_groups_and_roles_are_refused_once(group: str, role: str, problem: str) -> None:
    found = Filter()
    (line,) = found.problems(user(group=group, role=role), marker())
    assert re.match(problem, line)
    for number in range(3):
        found.wait(RETRY_S + 1.0)
        at_us = NOW_US + (number + 1) * MINUTE_US
        assert found.verdicts(user(group=group, role=role), marker(at_us=at_us)) == []
    # The user changes the group and sends the marker again.
    assert len(found.requests(user(group="Red"), marker(at_us=found.unix_us))) == 1


def test_an_unchanged_report_is_used_once_and_a_changed_one_again() -> None:
    found = Filter()
    assert len(found.requests(user(), shape())) == 1
    for _ in range(5):  # the client sends the shape again with a new time
        found.wait(60.0)
        assert found.requests(shape(at_us=found.unix_us), user(at_us=found.unix_us)) == []
    renamed = shape(at_us=found.unix_us, title="Burned 77")  # in the same state
    assert found.requests(renamed) == []
    larger = shape((*RING[:2], (36.38, -84.14), RING[3]), at_us=found.unix_us)
    assert [each["points"][2] for each in found.requests(larger, larger)] == [(36.38, -84.14)]
    assert found.requests(shape()) == []  # the first version, late
    found.wait(1.0)
    other = shape(at_us=found.unix_us, title="unburned")
    assert [each["state"] for each in found.requests(other)] == ["unburned"]
    found.wait(1.0)
    again = shape(at_us=found.unix_us)  # the first drawing once more, as a correction of the second
    assert [each["state"] for each in found.requests(again)] == ["burned"]


def test_after_a_restart_the_reports_in_the_journal_are_not_used_again() -> None:
    before = Filter()
    assert len(before.requests(user(), shape(), marker())) == 2
    after = Filter(journal=frozenset(before.digests))
    after.wait(600.0)
    sent_us = after.unix_us
    assert after.requests(user(), shape(at_us=sent_us), marker(at_us=sent_us)) == []
    moved = marker(at_us=sent_us + 1000, place=RING[0])
    assert [each["points"] for each in after.requests(moved)] == [(RING[0],)]


def test_two_users_may_use_the_same_uid() -> None:
    found, other = Filter(), "ANDROID-2"
    people = user(), user(other, "FAITH")
    one, two = marker("burned"), marker("unburned", creator=other)
    assert [each["by"] for each in found.requests(*people, one, two)] == ["cot:HOPE", "cot:FAITH"]
    for _ in range(5):
        found.wait(60.0)
        sent = (
            marker("burned", at_us=found.unix_us),
            marker("unburned", creator=other, at_us=found.unix_us),
        )
        assert found.requests(*sent) == []


def test_a_burned_place_has_the_time_of_sending_and_an_unburned_one_that_of_drawing() -> None:
    found = Filter()
    drawn_us = NOW_US - 10 * MINUTE_US
    people = (user(),)
    burned = shape(created_us=drawn_us)
    assert [each["age_s"] for each in found.requests(*people, burned)] == [0.0]
    unburned = shape(uid="shape-2", title="unburned", created_us=drawn_us)
    assert [each["age_s"] for each in found.requests(unburned)] == [600.0]
    found.wait(60.0)  # a change is as old as the event
    changed = shape(
        RING[:3], uid="shape-2", title="unburned", created_us=drawn_us, at_us=found.unix_us
    )
    assert [each["age_s"] for each in found.requests(changed)] == [0.0]


def test_old_and_future_reports_are_refused() -> None:
    found = Filter()
    ahead = marker(at_us=NOW_US + 31_000_000)
    (line,) = found.problems(user(), ahead)
    assert line == "its time is 31 s in the future; check the clock of its creator"
    assert [
        each["age_s"] for each in found.requests(marker(uid="a", at_us=NOW_US + 29_000_000))
    ] == [0.0]
    found.wait(3601.0)
    (line,) = found.problems(marker(uid="b"))
    assert line == "it is 3601 s old; max_age_s is 3600"


def test_a_report_waits_for_the_position_of_its_creator() -> None:
    found = Filter()
    assert found.verdicts(marker(), shape()) == []
    found.wait(WAIT_S - 1.0)
    assert found.filter.handle_timer(found.now_s) == []
    assert [each["shape"] for each in found.requests(user())] == ["points", "polygon"]
    assert found.requests(user(), marker()) == []

    stranger = marker(uid="x", creator="ANDROID-9", at_us=found.unix_us)
    assert found.verdicts(stranger) == []
    found.wait(WAIT_S - 1.0)
    assert found.verdicts(stranger) == []  # sent again: the time runs from its first arrival
    found.wait(2.0)
    (refused,) = found.filter.handle_timer(found.now_s)
    assert isinstance(refused, Refused)
    assert refused.problem.startswith("no position of its creator arrived within 120 s")
    assert found.filter.handle_timer(found.now_s) == []


def test_deletions_are_ignored() -> None:
    found = Filter()
    assert found.verdicts(user()) == []
    assert len(found.requests(marker())) == 1
    assert found.verdicts(deletion()) == []
    assert found.requests(marker()) == []


def test_too_many_reports_are_refused_and_used_when_they_are_sent_again() -> None:
    found = Filter()
    count = int(USER_BURST) + 5
    verdicts = found.verdicts(user(), *(marker(uid=f"m{n}") for n in range(count)))
    refused = [each for each in verdicts if isinstance(each, Refused)]
    assert len(refused) == 5
    assert refused[0].problem.startswith("too many reports arrived; it is used when its client")
    found.wait(RETRY_S + 1.0)
    again = [marker(uid=f"m{n}", at_us=found.unix_us) for n in range(count)]
    assert len(found.requests(*again)) == 5
    assert USER_RATE_S * RETRY_S >= 5

    found = Filter()
    people = [user(f"u{n}") for n in range(10)]
    flood = [
        marker(uid=f"{n} {k}", creator=f"u{n}") for n in range(10) for k in range(int(USER_BURST))
    ]
    assert (
        sum(isinstance(each, Accepted) for each in found.verdicts(*people, *flood)) == TOTAL_BURST
    )


def test_a_refusal_of_the_request_handler_is_tried_again_after_a_minute() -> None:
    found = Filter()
    event = parse_event(marker())
    assert event is not None
    found.verdicts(user())
    (accepted,) = found.filter.receive(event, found.now_s, found.unix_us)
    retry_s = found.now_s + RETRY_S
    assert len(found.filter.refuse(accepted.report, "64 observations wait", retry_s)) == 1
    assert found.verdicts(marker()) == []
    found.wait(RETRY_S + 1.0)
    (accepted,) = found.filter.receive(event, found.now_s, found.unix_us)
    assert isinstance(accepted, Accepted)
    assert found.filter.refuse(accepted.report, "65 observations wait", retry_s) == []


def test_few_reports_wait_for_unknown_users() -> None:
    found = Filter()
    lines = found.problems(*(marker(uid=f"m{n}", creator=f"c{n}") for n in range(MAX_WAITING + 3)))
    assert lines == [f"more than {MAX_WAITING} reports from unknown users are waiting"] * 3


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"groups": (), "roles": ("HQ",)}, "at least 1 item"),
        ({"groups": ("Red",)}, "roles"),
        ({"groups": ("Red",), "roles": ("HQ",), "missed_pct": 100}, "less than 100"),
        ({"groups": ("Red",), "roles": ("HQ",), "max_age_s": 1e5}, "21600"),
    ],
)
def test_invalid_settings_are_refused(settings: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        CotReportsSection(**settings)


def test_reports_need_a_server_or_a_multicast_group() -> None:
    for url in ("udp://10.0.0.7:6969", "udp://tak.example:6969", "udp://[::1]:6969"):
        with pytest.raises(ValidationError, match="no events arrive from"):
            CotSection(url=url, reports=SETTINGS)
        assert CotSection(url=url).reports is None
    for url in ("udp://239.2.3.1:6969", "udp://[ff02::1]:6969", "tcp://a:8087", "tls://a:8089"):
        assert CotSection(url=url, reports=SETTINGS).reports == SETTINGS
