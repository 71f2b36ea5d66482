"""Decides which received events become observations of the fire. Sans-IO.

A report passes if its creator belongs to an accepted group and has an accepted role, if it is new,
and if its time is plausible. Clients send markers and shapes repeatedly. An unchanged marker or
shape is used once; a changed one is a new observation.
"""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from mission_service.config.service_section import CotReportsSection
from mission_service.fire.reported_observations import TAK_STATION
from mission_service.interfaces.cot.fire_reports import MAX_NAME, FireReport, reports_in
from mission_service.interfaces.cot.received_events import CotEvent
from mission_service.interfaces.limits import RateLimiter

MAX_USERS, MAX_SEEN, MAX_WAITING = 2000, 4096, 64
WAIT_S = 120.0  # to wait for a creator's position; clients send theirs every minute or more often
MAX_AHEAD_S = 30.0  # tolerance for the clocks of clients
USER_RATE_S, USER_BURST = 0.5, 20.0  # for the reports of one user
TOTAL_RATE_S, TOTAL_BURST = 1.0, 40.0  # for all users together, because a sender can use any uid
RETRY_S = 60.0  # a refused report is tried again if it arrives after this time
ALL = ""

Key = tuple[str, str]  # uid of the creator, uid of the marker or shape
Value = TypeVar("Value")


class User(NamedTuple):
    """A TAK user, as described in the last event with the user's position."""

    callsign: str
    group: str
    role: str


class Seen(NamedTuple):
    """The last version of a marker or shape that was used."""

    digest: bytes
    sent_unix_us: int


class Accepted(NamedTuple):
    """A report with its request for the request handler."""

    report: FireReport
    request: dict[str, Any]


class Refused(NamedTuple):
    """A report with the reason why it is not used; each version of a report is refused once."""

    report: FireReport
    problem: str


Verdict = Accepted | Refused


class _Refusal(NamedTuple):
    digest: bytes
    retry_s: float


class _Waiting(NamedTuple):
    report: FireReport
    since_s: float


class ReportFilter:
    """The users and the reports of one run. All tables are bounded."""

    def __init__(self, settings: CotReportsSection, is_journalled: Callable[[bytes], bool]) -> None:
        """Start with no users.

        Args:
            settings: The accepted groups and roles, and the errors of reports.
            is_journalled: Returns whether the journal contains a report with a digest, for example
                from before a restart.
        """
        self._settings = settings
        self._is_journalled = is_journalled
        self._users: OrderedDict[str, User] = OrderedDict()
        self._seen: OrderedDict[Key, Seen] = OrderedDict()
        self._refused: OrderedDict[Key, _Refusal] = OrderedDict()
        self._waiting: OrderedDict[Key, _Waiting] = OrderedDict()
        self._of_user = RateLimiter(USER_RATE_S, USER_BURST)
        self._of_all = RateLimiter(TOTAL_RATE_S, TOTAL_BURST)

    def receive(self, event: CotEvent, now_s: float, unix_us: int) -> list[Verdict]:
        """Process an event; return the reports that are now accepted or refused.

        ``now_s`` is a monotonic clock, ``unix_us`` the wall clock. Raises CotEventError for a
        report that cannot be used.
        """
        reports = reports_in(event)
        if reports:
            if reports[0].creator.uid not in self._users:
                return [found for each in reports for found in self._wait(each, now_s)]
        elif event.is_user:
            _store(self._users, event.uid, User(event.title, event.group, event.role), MAX_USERS)
            keys = [key for key in self._waiting if key[0] == event.uid]
            reports = [self._waiting.pop(key).report for key in keys]
        else:
            return []
        return [found for each in reports for found in self._verdicts(each, now_s, unix_us)]

    def handle_timer(self, now_s: float) -> list[Verdict]:
        """Return the refusals of reports that have waited too long for their creator."""
        late = [key for key, each in self._waiting.items() if now_s - each.since_s > WAIT_S]
        problem = (
            f"no position of its creator arrived within {WAIT_S:g} s, and only positions contain "
            "group and role"
        )
        reports = [self._waiting.pop(key).report for key in late]
        return [found for each in reports for found in self.refuse(each, problem, now_s)]

    def add_accepted(self, report: FireReport) -> None:
        """Store a report that the request handler has accepted; it is not used again."""
        seen = Seen(report.digest, report.sent_unix_us)
        _store(self._seen, _key(report), seen, MAX_SEEN)

    def refuse(self, report: FireReport, problem: str, retry_s: float) -> list[Verdict]:
        """Store a refusal, and return it unless this version of the report was refused before.

        If the report arrives at ``retry_s`` (monotonic clock) or later, it is tried again.
        """
        before = self._refused.get(_key(report))
        _store(self._refused, _key(report), _Refusal(report.digest, retry_s), MAX_SEEN)
        is_known = before is not None and before.digest == report.digest
        return [] if is_known else [Refused(report, problem)]

    def _wait(self, report: FireReport, now_s: float) -> list[Verdict]:
        before = self._waiting.get(_key(report))
        since_s = now_s if before is None else before.since_s
        self._waiting[_key(report)] = _Waiting(report, since_s)
        if len(self._waiting) <= MAX_WAITING:
            return []
        _, (oldest, _) = self._waiting.popitem(last=False)
        return self.refuse(
            oldest, f"more than {MAX_WAITING} reports from unknown users are waiting", now_s
        )

    def _verdicts(self, report: FireReport, now_s: float, unix_us: int) -> list[Verdict]:
        """Return the request or the refusal of a report; none if it was used before."""
        before = self._seen.get(_key(report))
        if before is not None:
            if report.digest == before.digest or report.sent_unix_us <= before.sent_unix_us:
                return []
        elif self._is_journalled(report.digest):
            self.add_accepted(report)
            return []
        user = self._users[report.creator.uid]
        seen_us = report.sent_unix_us
        if report.state == "unburned" and before is None:
            # A client may send an old drawing with a new time. Ground that was unburned at the time
            # of drawing may have burned since. Burned ground stays burned.
            created_us = report.creator.created_unix_us
            seen_us = seen_us if created_us is None else min(seen_us, created_us)
        age_s = (unix_us - seen_us) / 1e6
        if problem := self._problem(user, age_s):
            return self.refuse(report, problem, now_s)
        refused = self._refused.get(_key(report))
        if refused and refused.digest == report.digest and now_s < refused.retry_s:
            return []
        if problem := self._above_rate(report, now_s):
            return self.refuse(report, problem, now_s + RETRY_S)
        return [Accepted(report, self._request(report, user, max(age_s, 0.0)))]

    def _problem(self, user: User, age_s: float) -> str:
        """Return the reason why a report of a user is not used, or ""."""
        if not self._settings.accepts_group(user.group):
            return f"its creator is in the group {user.group}, which is not listed in `groups`"
        if not self._settings.accepts_role(user.role):
            return (
                f"its creator has the role {user.role or '(none)'}, which is not listed in `roles`"
            )
        if age_s < -MAX_AHEAD_S:
            return f"its time is {-age_s:.0f} s in the future; check the clock of its creator"
        if age_s > self._settings.max_age_s:
            return f"it is {age_s:.0f} s old; max_age_s is {self._settings.max_age_s:g}"
        return ""

    def _above_rate(self, report: FireReport, now_s: float) -> str:
        if self._of_user.consume(report.creator.uid, now_s) or self._of_all.consume(ALL, now_s):
            return (
                "too many reports arrived; it is used when its client sends it again later "
                f"(limits: {60 * USER_RATE_S:g} a minute per user, {60 * TOTAL_RATE_S:g} for all)"
            )
        return ""

    def _request(self, report: FireReport, user: User, age_s: float) -> dict[str, Any]:
        settings = self._settings
        return {
            "do": "observe",
            "by": f"{TAK_STATION}{user.callsign or report.creator.uid}"[:MAX_NAME].strip(),
            "station": report.station,
            "state": report.state,
            "shape": report.shape,
            "points": report.points,
            "age_s": age_s,
            "position_sd_m": max(report.error_m or 0.0, settings.position_sd_m),
            "false_alarms_pct": settings.false_alarms_pct,
            "missed_pct": settings.missed_pct,
        }


def _key(report: FireReport) -> Key:
    return report.creator.uid, report.uid


def _store(table: OrderedDict[Any, Value], key: Any, value: Value, most: int) -> None:
    """Store a value as the newest; remove the oldest one above the limit."""
    table[key] = value
    table.move_to_end(key)
    if len(table) > most:
        table.popitem(last=False)
