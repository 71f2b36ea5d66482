"""Compare what several sources of images see, and find sources that contradict the others. Pure.

A burned cell stays burned. If one source sees a cell as burned and another sees it as unburned at a
later time, one of them is wrong. This rule holds for any fire and needs no model of its spread.
"""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import widened
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation
from mission_service.fire.sightings import Sightings

COMPARED_EVERY_S = 5.0  # interval of the comparisons of one source
REMEMBERED_S = 900.0  # age up to which sightings are compared
FORGOTTEN_S = 600.0  # time in which the weight of a comparison falls to 1/e
MIN_CELLS = 30.0  # weight of the cells that two sources must have in common
CONTRADICTORY = 0.1  # sources contradict each other if they differ in more than this share of cells
BESIDE_CELLS = 3  # only burned cells this near to unburned cells are compared
WITHIN_SD = 2.0  # cells within this many standard deviations of a front are not compared


class Comparison(NamedTuple):
    """The weights of the cells in which two sources agree and contradict each other."""

    at_s: float = 0.0
    agree: float = 0.0
    contradict: float = 0.0

    def with_cells(self, at_s: float, agree: int, contradict: int) -> "Comparison":
        """Return the comparison after adding cells that were compared at a time."""
        kept = math.exp(-max(at_s - self.at_s, 0.0) / FORGOTTEN_S)
        return Comparison(
            max(at_s, self.at_s), kept * self.agree + agree, kept * self.contradict + contradict
        )

    def at_odds(self, at_s: float) -> bool | None:
        """Return whether the sources contradict each other; None with too few cells in common."""
        agree, contradict = self.with_cells(at_s, 0, 0)[1:]
        count = agree + contradict
        return contradict > CONTRADICTORY * count if count >= MIN_CELLS else None


class SourceAgreement:
    """The last sightings of each source, and a comparison of each pair of sources."""

    def __init__(self, shape: tuple[int, int], cell_m: float) -> None:
        """Begin without sources on a grid of this shape."""
        self._shape, self._cell_m = shape, cell_m
        self._sightings: dict[str, Sightings] = {}  # last sightings by source
        self._compared: dict[tuple[str, str], Comparison] = {}
        self._due_s: dict[str, float] = {}  # time of the next comparison, by source
        self._at_s = -math.inf  # time of the last comparison
        self.distrusted: frozenset[str] = frozenset()

    def add_image(self, image: Observation) -> None:
        """Add an image without errors of detection (``observation_in``)."""
        source = image.source
        if source not in self._sightings:
            self._sightings[source] = Sightings(self._shape)
            self._due_s[source] = image.at_s
        if image.at_s >= self._due_s[source]:
            self._due_s[source] = image.at_s + COMPARED_EVERY_S
            self._compare(image)
            self._at_s = max(self._at_s, image.at_s)
            self.distrusted = self._contradicting_most()
        self._sightings[source].add(image)

    def _compare(self, image: Observation) -> None:
        """Compare an image with the sightings of other sources."""
        if len(self._sightings) == 1:  # only the image's own source
            return
        reach = math.ceil(WITHIN_SD * image.position_sd_m / self._cell_m)
        state = image.state
        unburned = (state == UNBURNED) & ~widened(state == BURNED, reach)
        for other, seen in self._sightings.items():
            recent = seen.seen_s[image.where] >= image.at_s - REMEMBERED_S
            before = np.where(recent, seen.state[image.where], UNSEEN)
            burned = before == BURNED
            if other == image.source or not burned.any():
                continue
            inside = burned & ~widened(before == UNBURNED, reach)
            contradict = int(np.count_nonzero(inside & unburned))
            beside = widened((before == UNBURNED) | (state == UNBURNED), BESIDE_CELLS)
            agree = int(np.count_nonzero(burned & (state == BURNED) & beside))
            if contradict or agree:
                pair = (min(other, image.source), max(other, image.source))
                known = self._compared.get(pair, Comparison(image.at_s))
                self._compared[pair] = known.with_cells(image.at_s, agree, contradict)

    def _contradicting_most(self) -> frozenset[str]:
        """Return the sources that contradict most of the others, if the other sources are reliable.

        The other sources are reliable if they are the majority and do not contradict each other.
        Otherwise it is unknown which sources are wrong, and the result is empty.
        """
        odds: dict[str, list[bool]] = {name: [] for name in self._sightings}
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
        """Return a text about each source that contradicts others, by the name of the source."""
        found = {
            one: f"the images of {one} and {other} contradict each other; check both cameras"
            for (one, other), compared in sorted(self._compared.items())
            if compared.at_odds(self._at_s) and self.distrusted.isdisjoint((one, other))
        }
        return found | {name: self._words_on(name) for name in sorted(self.distrusted)}

    def _words_on(self, source: str) -> str:
        own = [each for pair, each in self._compared.items() if source in pair]
        contradict = sum(each.contradict for each in own)
        share = contradict / (contradict + sum(each.agree for each in own))
        return (
            f"the images of {source} are not used: in {share:.0%} of the burned cells they "
            "contradict those of the others; check the camera and its position"
        )
