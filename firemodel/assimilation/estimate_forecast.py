"""Compute probabilities of a burned area from the members of an estimate."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from firemodel.arrays import Floats, Mask
from firemodel.assimilation.perimeter_rates import FrontRates, Segments
from firemodel.errors import FireModelError

TIME_LOG_SD = 0.5  # of the logarithm of the time in which a member reaches a cell


class Arrivals(NamedTuple):
    """The arrival times of one member in the window of its burned cells."""

    top: int
    left: int
    arrival_s: NDArray[np.float32]  # (y, x) infinity in unburned cells


class Forecast:
    """The forecast of an estimate, made from what was observed until ``at_s``."""

    def __init__(
        self,
        at_s: float,
        until_s: float,
        simulated_until_s: float,
        burned: Mask,
        members: list[Arrivals],
        segments: Segments | None,
        rates: FrontRates | None,
    ) -> None:
        self.at_s, self.until_s = at_s, until_s
        self.simulated_until_s = simulated_until_s
        self.burned = burned  # (y, x) cells that have burned by ``at_s``, as observed or likely
        self.members = members
        self._segments, self._rates = segments, rates

    def burn_probability(self, at_s: float) -> Floats:
        """Return the probability (y, x) that each cell has burned by a time.

        Raises FireModelError for a time that is not from ``at_s`` to ``until_s``.
        """
        if not self.at_s <= at_s <= self.until_s:
            raise FireModelError(
                f"forecast: {at_s} s is outside {self.at_s:g} to {self.until_s:g} s"
            )
        if self._segments is None or self._rates is None:
            return self._share(at_s)
        return self._by_rates(self._segments, self._rates, at_s)

    def likely_burned(self, at_s: float) -> Mask:
        """Return the area (y, x) with the largest expected intersection over union at a time."""
        probability = self.burn_probability(at_s)
        falling = np.sort(probability[probability > 0.0])[::-1]
        if not falling.size:
            return self.burned.copy()
        inside = np.cumsum(falling)
        ratio = inside / (np.arange(1, falling.size + 1) + inside[-1] - inside)
        found: Mask = probability >= falling[int(np.argmax(ratio))]
        return found | self.burned if self._rates is not None else found

    def travel_s(self) -> Floats:
        """Return the modelled time (y, x) from ``at_s``: the geometric mean of the members.

        A member that does not reach a cell counts with the longest simulated time. Cells that no
        member reaches have infinity.
        """
        longest_s = max(self.simulated_until_s - self.at_s, 1.0)
        total = np.full(self.burned.shape, len(self.members) * math.log(longest_s))
        reached = np.zeros(self.burned.shape, dtype=bool)
        for member in self.members:
            rows, cols = member.arrival_s.shape
            here = np.s_[member.top : member.top + rows, member.left : member.left + cols]
            after_s = member.arrival_s.astype(np.float64) - self.at_s
            total[here] += np.log(np.clip(after_s, 1.0, longest_s) / longest_s)
            reached[here] |= np.isfinite(after_s)
        found: Floats = np.where(reached, np.exp(total / len(self.members)), np.inf)
        return found

    def _share(self, at_s: float) -> Floats:
        """Return the mean probability of the members, whose times have an error of ``TIME_LOG_SD``.

        The error stands for local rates, which the members' inputs do not contain.
        """
        total = np.zeros(self.burned.shape)
        for member in self.members:
            rows, cols = member.arrival_s.shape
            here = np.s_[member.top : member.top + rows, member.left : member.left + cols]
            new = np.isfinite(member.arrival_s) & (member.arrival_s > self.at_s)
            part = (member.arrival_s <= self.at_s).astype(np.float64)
            if at_s > self.at_s:
                share = (member.arrival_s[new] - self.at_s) / (at_s - self.at_s)
                part[new] = ndtr(-np.log(share) / TIME_LOG_SD)
            total[here] += part
        return total / len(self.members)

    def _by_rates(self, segments: Segments, rates: FrontRates, at_s: float) -> Floats:
        """Return the probability from the members' travel times and the rates of the segments."""
        for_s = max(at_s - self.at_s, 1.0)
        predicted = rates.predict(segments, self.at_s, for_s)
        total = np.zeros(self.burned.shape)
        for member in self.members:
            rows, cols = member.arrival_s.shape
            here = np.s_[member.top : member.top + rows, member.left : member.left + cols]
            of = segments.of_cell[here]
            new = (of >= 0) & np.isfinite(member.arrival_s)
            of = of[new]
            share = np.maximum(member.arrival_s[new] - self.at_s, 1.0) / for_s
            score = (predicted.log_mean[of] - np.log(share)) / predicted.log_sd[of]
            total[here][new] += ndtr(score) * (1.0 - predicted.held[of])
        found: Floats = total / len(self.members)
        found[self.burned] = 1.0
        return found


def arrivals_of(arrival_s: Floats) -> Arrivals:
    """Return the smallest window with all burned cells of a grid (y, x)."""
    burned = np.isfinite(arrival_s)
    rows, cols = np.flatnonzero(burned.any(axis=1)), np.flatnonzero(burned.any(axis=0))
    if not rows.size:
        return Arrivals(0, 0, np.empty((0, 0), dtype=np.float32))
    here = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return Arrivals(int(rows[0]), int(cols[0]), arrival_s[here].astype(np.float32))
