"""Finds the positions of people among received Cursor on Target events. Pure."""

from mission_service.config.service_section import CotPeopleSection
from mission_service.fire_arrival.people import Person
from mission_service.interfaces.cot.received_events import CotEvent, place_of


def person_in(event: CotEvent, settings: CotPeopleSection, unix_us: int) -> Person | None:
    """Return the position of a person in an accepted group with an accepted role, or None.

    The time of the position is that of the event, at most ``unix_us`` (microseconds since 1970),
    because the clocks of devices may be ahead. Raises CotEventError if the position is not on the
    Earth.
    """
    if not event.is_user:
        return None
    if not (settings.accepts_group(event.group) and settings.accepts_role(event.role)):
        return None
    lat_deg, lon_deg = place_of(event)
    if lat_deg == 0.0 and lon_deg == 0.0:
        return None  # TAK clients send this position before their first fix
    name = event.title or event.uid
    return Person(event.uid, name, lat_deg, lon_deg, min(event.sent_unix_us, unix_us))
