"""Finds people's reports about the fire among received Cursor on Target events. Pure.

By convention, the title of a marker or shape that reports fire is one of the words in ``STATES``,
alone or with a number ("burned", "Burned 3"). All other events are not reports, because most
markers of an incident do not show where the fire is.
"""

import re
from typing import Literal, NamedTuple

from mission_service.fire.reported_observations import TAK_STATION
from mission_service.interfaces.cot.received_events import (
    CotEvent,
    CotEventError,
    Creator,
    LatLon,
    drawings_in,
)
from mission_service.runtime.observation_sources import report_digest

MAX_NAME = 80  # limit for names in requests

State = Literal["burned", "burning", "unburned"]
STATES: dict[str, State] = {
    "burned": "burned",
    "burnt": "burned",
    "burning": "burning",
    "unburned": "unburned",
    "unburnt": "unburned",
}
_TITLE = re.compile(rf"({'|'.join(STATES)})[ ._-]{{0,3}}[0-9]{{0,6}}", re.ASCII | re.IGNORECASE)


class FireReport(NamedTuple):
    """A marker or shape that shows where the fire is. ``report_digest`` returns ``digest``."""

    uid: str
    title: str
    creator: Creator
    state: State
    shape: str
    points: tuple[LatLon, ...]
    error_m: float | None
    sent_unix_us: int
    digest: bytes

    @property
    def station(self) -> str:
        """The station in requests: the creator's uid, because callsigns are not unique."""
        return station_of(self.creator)


def station_of(creator: Creator) -> str:
    """Return a creator's station in requests."""
    return f"{TAK_STATION}{creator.uid}"[:MAX_NAME]


def name_of(report: FireReport) -> str:
    """Return the name of a report for operators: title and creator."""
    return f"{report.title} from {report.creator.callsign or report.creator.uid}"


def state_in(title: str) -> State | None:
    """Return the state that the title of a marker or shape reports, or None."""
    found = _TITLE.fullmatch(title)
    return None if found is None else STATES[found[1].lower()]


def reports_in(event: CotEvent) -> list[FireReport]:
    """Return the reports in an event: one for each of its shapes; none if it is not a report.

    Raises CotEventError for a report that cannot be used.
    """
    state = state_in(event.title)
    if state is None or (event.is_user and event.creator is None):
        return []
    if event.creator is None:
        raise CotEventError(f"{event.title} ({event.uid}): the event does not name its creator")
    try:
        drawings = drawings_in(event)
    except CotEventError as error:
        raise CotEventError(f"{event.title} ({event.uid}): {error}") from None
    return [
        FireReport(
            event.uid if number == 0 else f"{event.uid}/{number}",
            event.title,
            event.creator,
            state,
            shape,
            points,
            event.error_m,
            event.sent_unix_us,
            report_digest(station_of(event.creator), state, shape, points),
        )
        for number, (shape, points) in enumerate(drawings)
    ]
