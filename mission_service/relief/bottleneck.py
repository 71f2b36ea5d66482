"""Finds the smallest addition of batteries, chargers and aircraft that prevents all lapses. Pure.

The additions are tried: one thing more, then two, and so on; batteries before chargers before
aircraft.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement

from mission_service.relief.relief_plan import is_kept
from mission_service.relief.watch import Watch

MAX_MORE = 8  # maximum number of things added in all


@dataclass(frozen=True, slots=True)
class Addition:
    """Additional batteries (pool and number), chargers, and aircraft (names of equal ones)."""

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
        """Return "removes" or "remove", as fits ``words``."""
        total = sum(n for _, n in self.batteries) + self.chargers + len(self.aircraft)
        return "removes" if total == 1 else "remove"


def smallest_addition(watch: Watch) -> Addition | None:
    """Return the smallest addition with which a watch has no lapse; None if it needs more."""
    kinds = _kinds(watch)
    everything = [kind for kind in kinds for _ in range(MAX_MORE)]
    if not is_kept(_with(watch, everything)):
        return None
    for total in range(1, MAX_MORE + 1):
        for chosen in combinations_with_replacement(kinds, total):
            if is_kept(_with(watch, list(chosen))):
                return _addition(watch, list(chosen))
    return None


_Kind = tuple[str, str | int]  # "battery" and pool, "charger" and "", "aircraft" and index


def _kinds(watch: Watch) -> list[_Kind]:
    """Return the kinds of things to add; of equal aircraft only the first."""
    return [
        *(("battery", pool) for pool, _ in watch.batteries),
        ("charger", ""),
        *(("aircraft", index) for index in _different(watch)),
    ]


def _different(watch: Watch) -> Iterator[int]:
    """Yield the first usable aircraft of each pool and home."""
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
