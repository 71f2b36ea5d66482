"""Compute, from the members of an estimate, the probability that each cell has burned."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from firemodel.arrays import Floats, Mask, Place, bounds_of
from firemodel.assimilation.perimeter_rates import FrontRates, Segments
from firemodel.errors import FireModelError

TIME_LOG_SD = 0.7  # standard deviation of ln of the time that a member takes to reach a cell


Cells = NDArray[np.intp]


class Arrivals(NamedTuple):
    """The arrival times of one member in the window of its burned cells."""

    here: Place  # index of the window in the grid
    arrival_s: NDArray[np.float32]  # (y, x) infinity in unburned cells


class LearnedFront(NamedTuple):
    """The front at the start of a forecast, and the rates estimated from earlier perimeters."""

    segments: Segments
    rates: FrontRates


@dataclass(frozen=True)
class Forecast:
    """The forecast of an estimate, based on the observations up to ``at_s``.

    ``burned`` (y, x) is the mask of the cells that were observed as burned or have probably burned
    by ``at_s``. ``front`` is None if the rates of the front are not known from mapped perimeters.
    """

    at_s: float
    until_s: float
    simulated_until_s: float
    burned: Mask
    members: list[Arrivals]
    front: LearnedFront | None

    def burn_probability(self, at_s: float) -> Floats:
        """Return the probability (y, x) that each cell has burned by the given time.

        Raises FireModelError for a time before ``at_s`` or after ``until_s``.
        """
        if not self.at_s <= at_s <= self.until_s:
            raise FireModelError(
                f"forecast: {at_s} s is outside {self.at_s:g} to {self.until_s:g} s"
            )
        return self._share(at_s) if self.front is None else self._by_rates(self.front, at_s)

    def likely_burned(self, at_s: float) -> Mask:
        """Return the area (y, x) with the largest expected intersection over union at this time."""
        return likely_area(self.burn_probability(at_s))

    def at_places(self, places: Sequence[Cells]) -> "Forecast":
        """Return the forecast of the fire's arrival at the given places, on a grid with one row.

        Args:
            places: For each of n places, one or more cells as flat indices of the grid (y, x).

        Returns:
            A forecast on the grid (1, n). A place burns when the first of its cells burns. It is
            assigned to the segment of the front whose ground contains the cell that a member
            reaches first.
        """
        if not places:
            return replace(self, burned=np.zeros((1, 0), dtype=bool), members=[], front=None)
        cells = np.concatenate(places)
        begin = np.cumsum([0, *(len(each) for each in places)])
        burned = np.logical_or.reduceat(self.burned.flat[cells], begin[:-1])[None]
        here = (slice(0, 1), slice(0, len(places)))
        members, earliest_s = [], np.full(len(cells), np.inf, dtype=np.float32)
        for member in self.members:
            every_s = np.full(self.burned.shape, np.inf, dtype=np.float32)
            every_s[member.here] = member.arrival_s
            arrival_s = every_s.flat[cells]
            members.append(Arrivals(here, np.minimum.reduceat(arrival_s, begin[:-1])[None]))
            np.minimum(earliest_s, arrival_s, out=earliest_s)
        front = self.front
        if front is not None:
            ends = pairwise(begin)
            first = [cells[at + int(np.argmin(earliest_s[at:end]))] for at, end in ends]
            of_cell = front.segments.of_cell.flat[first][None]
            front = front._replace(segments=front.segments._replace(of_cell=of_cell))
        return replace(self, burned=burned, members=members, front=front)

    def arrival_quantiles_s(self, shares: Sequence[float], times_s: Sequence[float]) -> Floats:
        """Return the times (k, y, x) at which the burn probability reaches each share.

        Args:
            shares: k probabilities between 0 and 1, such as 0.1, 0.5 and 0.9.
            times_s: Increasing times from ``at_s`` to ``until_s``, at which the probability is
                computed; between them it is interpolated linearly.

        Returns:
            Times, at the earliest the first of ``times_s``; infinity where the probability stays
            below the share.
        """
        found = np.full((len(shares), *self.burned.shape), np.inf)
        before, before_s = np.zeros(self.burned.shape), times_s[0]
        for at_s in times_s:
            probability = np.maximum(self.burn_probability(at_s), before)
            for share, reached_s in zip(shares, found, strict=True):
                new = (probability >= share) & (before < share)
                part = (share - before[new]) / (probability[new] - before[new])
                reached_s[new] = before_s + part * (at_s - before_s)
            before, before_s = probability, at_s
        return found

    def travel_s(self) -> Floats:
        """Return the modelled time (y, x) from ``at_s`` to arrival: the members' geometric mean.

        For a member that does not reach a cell, the longest simulated time is used. The result is
        infinity in cells that no member reaches.
        """
        longest_s = max(self.simulated_until_s - self.at_s, 1.0)
        total = np.full(self.burned.shape, len(self.members) * math.log(longest_s))
        reached = np.zeros(self.burned.shape, dtype=bool)
        for member in self.members:
            after_s = member.arrival_s.astype(np.float64) - self.at_s
            total[member.here] += np.log(np.clip(after_s, 1.0, longest_s) / longest_s)
            reached[member.here] |= np.isfinite(after_s)
        found: Floats = np.where(reached, np.exp(total / len(self.members)), np.inf)
        return found

    def median_arrival_s(self) -> Floats:
        """Return the median (y, x) of the members' arrival times; infinity if most are infinite.

        The result is ``at_s`` in cells of ``burned`` that have not burned in most members.
        """
        shape = (len(self.members), *self.burned.shape)
        every = np.full(shape, np.inf, dtype=np.float32)
        for number, member in enumerate(self.members):
            every[number][member.here] = member.arrival_s
        found = np.median(every, axis=0).astype(np.float64)
        late = self.burned & ~(found <= self.at_s)
        found[late] = self.at_s
        return found

    def _share(self, at_s: float) -> Floats:
        """Return the mean burn probability (y, x) of the members, with the error ``TIME_LOG_SD``.

        This error in the travel times represents local variations in the spread rate, which are not
        in the members' inputs.
        """
        total = np.zeros(self.burned.shape)
        for member in self.members:
            new = np.isfinite(member.arrival_s) & (member.arrival_s > self.at_s)
            part = (member.arrival_s <= self.at_s).astype(np.float64)
            if at_s > self.at_s:
                share = (member.arrival_s[new] - self.at_s) / (at_s - self.at_s)
                part[new] = ndtr(-np.log(share) / TIME_LOG_SD)
            total[member.here] += part
        return total / len(self.members)

    def _by_rates(self, front: LearnedFront, at_s: float) -> Floats:
        """Return the burn probability (y, x) from the members' travel times and segments' rates."""
        for_s = max(at_s - self.at_s, 1.0)
        predicted = front.rates.predict(front.segments, self.at_s, for_s)
        total = np.zeros(self.burned.shape)
        for member in self.members:
            of = front.segments.of_cell[member.here]
            new = (of >= 0) & np.isfinite(member.arrival_s)
            of = of[new]
            share = np.maximum(member.arrival_s[new] - self.at_s, 1.0) / for_s
            score = (predicted.log_mean[of] - np.log(share)) / predicted.log_sd[of]
            total[member.here][new] += ndtr(score) * (1.0 - predicted.held[of])
        found: Floats = total / len(self.members)
        found[self.burned] = 1.0
        return found


def likely_area(probability: Floats) -> Mask:
    """Return the area (y, x) with the largest expected intersection over union.

    ``probability`` (y, x) is the probability that each cell has burned.
    """
    falling = np.sort(probability[probability > 0.0])[::-1]
    if not falling.size:
        return probability > 0.0
    inside = np.cumsum(falling)
    ratio = inside / (np.arange(1, falling.size + 1) + inside[-1] - inside)
    return np.asarray(probability >= falling[int(np.argmax(ratio))])


def arrivals_of(arrival_s: Floats) -> Arrivals:
    """Return the arrival times (y, x) in the smallest window that contains all burned cells."""
    here = bounds_of(np.isfinite(arrival_s))
    return Arrivals(here, arrival_s[here].astype(np.float32))
