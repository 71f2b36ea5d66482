"""Stores the last known positions of people in the field. Pure."""

from collections import OrderedDict
from typing import NamedTuple

MAX_PEOPLE = 2000
MAX_POSITION_AGE_S = 3600.0  # a person without a new position is removed after this time


class Person(NamedTuple):
    """A person's last known position (WGS84); ``at_unix_us`` is the time of the position."""

    uid: str
    name: str
    lat_deg: float
    lon_deg: float
    at_unix_us: int


class People:
    """The people of one run, at most ``MAX_PEOPLE``; the oldest position is removed first."""

    def __init__(self) -> None:
        self._people: OrderedDict[str, Person] = OrderedDict()

    def update_position(self, person: Person) -> None:
        """Store a position, unless a newer one of the same person is stored."""
        before = self._people.get(person.uid)
        if before is not None and before.at_unix_us > person.at_unix_us:
            return
        self._people[person.uid] = person
        self._people.move_to_end(person.uid)
        if len(self._people) > MAX_PEOPLE:
            self._people.popitem(last=False)

    def current(self, unix_us: int) -> list[Person]:
        """Return the people sorted by identifier, and remove those with outdated positions."""
        oldest_us = unix_us - round(MAX_POSITION_AGE_S * 1e6)
        for uid in [uid for uid, each in self._people.items() if each.at_unix_us < oldest_us]:
            del self._people[uid]
        return [self._people[uid] for uid in sorted(self._people)]
