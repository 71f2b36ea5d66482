"""Compare observations from several sources, and find those that contradict the others. Pure.

Sources are cameras, and the people and detectors that report observations. A burned cell stays
burned. If a cell is burned in an observation from one source but unburned in a later one from
another source, one of the two sources is wrong. This rule holds for any fire and requires no model
of fire spread.
"""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats, Place, bounds_of, widened
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation
from mission_service.fire.sightings import Sightings

COMPARED_EVERY_S = 5.0  # interval between comparisons of one source
REMEMBERED_S = 900.0  # age up to which sightings are compared
FORGOTTEN_S = 600.0  # time in which the weight of a comparison falls to 1/e
MIN_CELLS = 20.0  # minimum weight of the cells observed by both of two sources
CONTRADICTORY = 0.1  # sources contradict each other if they differ in more than this share of cells
BESIDE_CELLS = 3  # only burned cells this close to unburned cells are compared
WITHIN_SD = 2.0  # cells this many standard deviations or fewer from a front are not compared
MAX_STATED = 0.2  # stated fractions of missed and false cells are tolerated up to this value
MAX_REPORTERS = 8  # latest sources of reports, which are compared
MAX_COMPARED = 20_000  # if there are more cells, only every second, third, ... row and column is


class Comparison(NamedTuple):
    """The weights of the cells in which two sources agree and in which they contradict each other.

    ``stated`` is the largest fraction of wrong cells stated by either source.
    """

    at_s: float = 0.0
    agree: float = 0.0
    contradict: float = 0.0
    stated: float = 0.0

    def with_cells(
        self, at_s: float, agree: int, contradict: int, stated: float = 0.0
    ) -> "Comparison":
        """Return the comparison after adding cells that were compared at a time."""
        kept = math.exp(-max(at_s - self.at_s, 0.0) / FORGOTTEN_S)
        return Comparison(
            max(at_s, self.at_s),
            kept * self.agree + agree,
            kept * self.contradict + contradict,
            max(self.stated, min(stated, MAX_STATED)),
        )

    def at_odds(self, at_s: float) -> bool | None:
        """Return whether the sources contradict each other; None if they share too few cells."""
        _, agree, contradict, stated = self.with_cells(at_s, 0, 0)
        count = agree + contradict
        return contradict > (CONTRADICTORY + stated) * count if count >= MIN_CELLS else None


class Seen(NamedTuple):
    """The last sightings of a source."""

    last: Sightings
    burned_since_s: Floats  # (y, x) first sighting as burned, for cells last seen as burned

    def include(self, image: Observation) -> None:
        """Add an image; the later of two sightings of a cell is kept."""
        state = self.last.state[image.where]  # a view, which the next line modifies
        before = state == BURNED
        self.last.add(image)
        self.burned_since_s[image.where][(state == BURNED) & ~before] = image.at_s


class SourceAgreement:
    """The last sightings of each source, and a comparison of each pair of sources."""

    def __init__(self, shape: tuple[int, int], cell_m: float) -> None:
        """Begin without sources on a grid of this shape."""
        self._shape, self._cell_m = shape, cell_m
        self._seen: dict[str, Seen] = {}  # by source
        self._reporters: dict[str, None] = {}  # the sources of reports; the last reporter is last
        self._compared: dict[tuple[str, str], Comparison] = {}
        self._due_s: dict[str, float] = {}  # time of the next comparison, by source
        self._at_s = -math.inf  # time of the last comparison
        self.distrusted: frozenset[str] = frozenset()

    def add_report(self, report: Observation) -> None:
        """Add the cells of a report; only the last ``MAX_REPORTERS`` sources are compared."""
        self._reporters.pop(report.source, None)
        self._reporters[report.source] = None
        if len(self._reporters) > MAX_REPORTERS:
            oldest = next(iter(self._reporters))
            del self._reporters[oldest], self._seen[oldest], self._due_s[oldest]
            self._compared = {
                pair: each for pair, each in self._compared.items() if oldest not in pair
            }
        self.add_image(report)

    def add_image(self, image: Observation) -> None:
        """Add an image without detection errors (``observation_in``)."""
        source = image.source
        if source not in self._seen:
            self._seen[source] = Seen(Sightings(self._shape), np.full(self._shape, -np.inf))
            self._due_s[source] = image.at_s
        if image.at_s >= self._due_s[source]:
            self._due_s[source] = image.at_s + COMPARED_EVERY_S
            self._compare(image)
            self._at_s = max(self._at_s, image.at_s)
            self.distrusted = self._contradicting_most()
        self._seen[source].include(image)

    def burned_since_s(self) -> dict[str, Floats]:
        """Return the times (y, x) since which each source has shown cells as burned, by source.

        The time is infinity for cells that the source's last view did not show as burned.
        """
        return {
            name: np.where(seen.last.state == BURNED, seen.burned_since_s, np.inf)
            for name, seen in self._seen.items()
        }

    def _compare(self, image: Observation) -> None:
        """Compare an image with the sightings of other sources."""
        stated = max(image.missed, image.false_alarms)
        for other, seen in self._seen.items():
            if other == image.source:
                continue
            sd_m = math.hypot(image.position_sd_m, seen.last.position_sd_m)
            reach = min(math.ceil(WITHIN_SD * sd_m / self._cell_m), max(image.state.shape))
            agree, contradict = _compared(image, seen, reach)
            if contradict or agree:
                pair = (min(other, image.source), max(other, image.source))
                known = self._compared.get(pair, Comparison(image.at_s))
                self._compared[pair] = known.with_cells(image.at_s, agree, contradict, stated)

    def _contradicting_most(self) -> frozenset[str]:
        """Return the sources that contradict most of the others, if the others are reliable.

        The other sources are reliable if they are the majority and do not contradict each other. If
        they are not reliable, it is unknown which sources are wrong, and the result is empty.
        """
        odds: dict[str, list[bool]] = {name: [] for name in self._seen}
        for pair, compared in self._compared.items():
            at_odds = compared.at_odds(self._at_s)
            if at_odds is not None:
                for name in pair:
                    odds[name].append(at_odds)
        found = {name for name, each in odds.items() if sum(each) > max(1, len(each) / 2)}
        others = {name for name, each in odds.items() if each} - found
        disagree = any(
            compared.at_odds(self._at_s) and others.issuperset(pair)
            for pair, compared in self._compared.items()
        )
        return frozenset() if disagree or len(others) <= len(found) else frozenset(found)

    def contradictions(self) -> dict[str, str]:
        """Return a text about each source that contradicts others, by source name."""
        found = {
            one: f"the observations of {one} and {other} contradict each other; check both"
            for (one, other), compared in sorted(self._compared.items())
            if compared.at_odds(self._at_s) and self.distrusted.isdisjoint((one, other))
        }
        return found | {name: self._words_on(name) for name in sorted(self.distrusted)}

    def _words_on(self, source: str) -> str:
        own = [each for pair, each in self._compared.items() if source in pair]
        contradict = sum(each.contradict for each in own)
        share = contradict / (contradict + sum(each.agree for each in own))
        return (
            f"the observations of {source} are not used: in {share:.0%} of the burned cells they "
            "contradict those of the other sources; check the sensor and its position"
        )


def _compared(image: Observation, seen: Seen, reach: int) -> tuple[int, int]:
    """Return the numbers of cells in which an image and another source agree and disagree.

    Cells within ``reach`` cells of the front between burned and unburned cells of the same source
    do not count as contradictions.
    """
    recent = np.abs(seen.last.seen_s[image.where] - image.at_s) <= REMEMBERED_S
    other = np.where(recent, seen.last.state[image.where], UNSEEN)
    # Only the surroundings of cells that both sources observed, and one of them as burned, are
    # compared.
    both = (image.state != UNSEEN) & (other != UNSEEN)
    margin = max(reach, BESIDE_CELLS)
    part = _widened_window(bounds_of(both & ((image.state == BURNED) | (other == BURNED))), margin)
    step = 1 + math.isqrt(max(image.state[part].size - 1, 0) // MAX_COMPARED)
    state, other, seen_s, since_s = (
        each[part][::step, ::step]
        for each in (
            *(image.state, other),
            *(seen.last.seen_s[image.where], seen.burned_since_s[image.where]),
        )
    )
    if not state.size:
        return 0, 0
    reach, near = math.ceil(reach / step), math.ceil(BESIDE_CELLS / step)
    burned, unburned = (state == BURNED, other == BURNED), (state == UNBURNED, other == UNBURNED)
    inside = [one & ~widened(two, reach) for one, two in zip(burned, unburned, strict=True)]
    outside = [one & ~widened(two, reach) for one, two in zip(unburned, burned, strict=True)]
    contradict = inside[1] & (since_s <= image.at_s) & outside[0]
    contradict |= inside[0] & outside[1] & (seen_s > image.at_s)
    beside = widened(unburned[0] | unburned[1], near)
    agree = burned[0] & burned[1] & beside
    return int(np.count_nonzero(agree)), int(np.count_nonzero(contradict))


def _widened_window(where: Place, margin: int) -> Place:
    """Return a window with a margin; an empty window stays empty."""
    if where[0].start == where[0].stop:
        return where
    rows, cols = (slice(max(each.start - margin, 0), each.stop + margin) for each in where)
    return rows, cols
