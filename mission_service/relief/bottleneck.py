"""Finds the smallest addition of batteries, chargers and aircraft that prevents all lapses. Pure.

The search tries one additional item (a battery, a charger or an aircraft, in this order), then two
items, and so on. If more than ``MAX_TRIED`` items are needed, it removes items from a large
addition, one by one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement

from mission_service.relief.relief_plan import is_kept
from mission_service.relief.watch import Watch

MAX_TRIED = 6  # maximum number of items for which all combinations are tried
MAX_OF_KIND = 20  # maximum number of items of a kind in a larger addition


_Kind = tuple[str, str | int]  # "battery" and pool, "charger" and "", "aircraft" and index


@dataclass(frozen=True, slots=True)
class Addition:
    """Additional batteries (pool and number), chargers and aircraft (names of equal ones)."""

    batteries: tuple[tuple[str, int], ...]
    chargers: int
    aircraft: tuple[str, ...]

    @property
    def words(self) -> str:
        """The addition for operators, such as "1 more charger and 2 more aircraft"."""
        parts = [(n, _battery(pool), "") for pool, n in self.batteries]
        parts += [(self.chargers, "charger", "")] if self.chargers else []
        parts += [
            (self.aircraft.count(name), "aircraft", f" like {name}")
            for name in dict.fromkeys(self.aircraft)
        ]
        named = [f"{n} more {_plural(noun, n)}{like}" for n, noun, like in parts]
        return " and ".join([", ".join(named[:-1]), named[-1]] if named[:-1] else named)

    def verb(self) -> str:
        """Return the verb after ``words``: "prevents" for one item, "prevent" for several."""
        total = sum(n for _, n in self.batteries) + self.chargers + len(self.aircraft)
        return "prevents" if total == 1 else "prevent"


def smallest_addition(watch: Watch) -> Addition | None:
    """Return an addition that leaves a watch without lapses; None if no tried addition suffices.

    If the addition has at most ``MAX_TRIED`` items, no smaller one suffices. If it has more, each
    of its items is needed.
    """
    kinds = _kinds(watch)
    sizes = (kinds * count for count in range(1, MAX_OF_KIND + 1))
    chosen = next((each for each in sizes if is_kept(_with(watch, each))), None)
    if chosen is None:
        return None
    for total in range(1, MAX_TRIED + 1):
        for tried in combinations_with_replacement(kinds, total):
            if is_kept(_with(watch, list(tried))):
                return _addition(watch, list(tried))
    return _addition(watch, _thinned(watch, chosen))


def _thinned(watch: Watch, chosen: list[_Kind]) -> list[_Kind]:
    """Return an addition without the items that can be omitted, tried in turn by kind.

    The passes are repeated, because an item may become superfluous when another one is omitted.
    """
    before: list[_Kind] = []
    while chosen != before:
        before = chosen
        for kind in reversed(before):
            fewer = chosen.copy()
            fewer.remove(kind)
            if is_kept(_with(watch, fewer)):
                chosen = fewer
    return chosen


def _kinds(watch: Watch) -> list[_Kind]:
    """Return the kinds of items to add; only the first of equal aircraft is included."""
    return [
        *(("battery", pool) for pool, _ in watch.batteries),
        ("charger", ""),
        *(("aircraft", index) for index in _different(watch)),
    ]


def _different(watch: Watch) -> Iterator[int]:
    """Yield the index of the first usable aircraft of each pool and home."""
    seen = set()
    for index, each in enumerate(watch.aircraft):
        if watch.usable(each) and (each.pool, each.home) not in seen:
            seen.add((each.pool, each.home))
            yield index


def _with(watch: Watch, chosen: list[_Kind]) -> Watch:
    batteries = {pool: chosen.count(("battery", pool)) for pool, _ in watch.batteries}
    aircraft = [n for kind, n in chosen if kind == "aircraft" and isinstance(n, int)]
    return watch.with_more(batteries, chosen.count(("charger", "")), aircraft)


def _addition(watch: Watch, chosen: list[_Kind]) -> Addition:
    batteries = [(pool, chosen.count(("battery", pool))) for pool, _ in watch.batteries]
    return Addition(
        tuple((pool, n) for pool, n in batteries if n),
        chosen.count(("charger", "")),
        tuple(watch.aircraft[n].name for _, n in chosen if isinstance(n, int)),
    )


def _battery(pool: str) -> str:
    return "battery" if pool == "battery" else f"{pool} battery"


def _plural(noun: str, count: int) -> str:
    if count == 1 or noun == "aircraft":
        return noun
    return f"{noun.removesuffix('y')}ies" if noun.endswith("y") else f"{noun}s"
