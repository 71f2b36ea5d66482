"""Mixes two estimates of the front, weighted by their errors in predicting the views so far.

The first estimate (the model's estimate) follows the fire model. Where the fuel map or the wind is
wrong, the model's estimate has large errors between two views. The second estimate is ``cautious``:
it follows measured rates more than the model. The mixture contains the cautious estimate and small
fractions of the model's estimate and of the front as last seen; the largest error of the mixture is
smaller than the largest error of any part. The result is the model's estimate if this estimate's
errors are clearly smaller than those of the mixture, and otherwise the mixture. Errors are measured
where the front comes into view again.

The constants were tuned on fires 200 to 229 of ``benchmarks.random_fires --wrong``. Without a model
there is only one estimate.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.fire_map import BEARINGS
from mission_service.guidance.front.front_estimate import FrontEstimate, FrontModel, cautious
from mission_service.guidance.front.front_estimate_kernels import mixed_front

Floats = NDArray[np.float64]

# Fractions in the mixture: the model's estimate, the cautious estimate, the front as last seen.
SHARES = (0.15, 0.75, 0.10)
CLEARLY = 0.5  # ratio of mean square errors (model / mixture) at which the two have equal weight
SHARPNESS = 4.0  # exponent of this ratio in ``model_share``
AGAIN_S = 120.0  # errors are measured on bearings that have been out of view for longer than this
KEPT = 0.9975  # factor by which each new error reduces the weights of earlier errors
FIRST_SQUARES = 20.0  # initial sum of the mixture's squared errors, in cells squared


class FrontMixture:
    """The mixed front, with the interface of ``FrontEstimate``; arrays have 360 elements."""

    def __init__(
        self,
        shape: tuple[int, int],
        centre: tuple[float, float],
        model: FrontModel | None,
        front: Floats,
        at_s: float,
    ) -> None:
        self.modelled = FrontEstimate(shape, centre, model, front, at_s)
        other = (
            None if model is None else FrontEstimate(shape, centre, cautious(model), front, at_s)
        )
        self._cautious = other
        self._begin()

    def _begin(self) -> None:
        self._last_seen = np.full(BEARINGS, np.nan)
        self._squares = FIRST_SQUARES * np.array([CLEARLY, 1.0])
        _, self.front = self._mixed()

    @property
    def model_share(self) -> float:
        """The weight of the model's estimate in the result (0 to 1); the rest is the mixture."""
        ratio = float(self._squares[0] / (CLEARLY * max(self._squares[1], 1e-9)))
        return float(1.0 / (1.0 + min(ratio, 1e3) ** SHARPNESS))

    def _mixed(self) -> tuple[Floats, Floats]:
        """Return the mixture, and the front as a mean of the model's estimate and the mixture."""
        modelled = self.modelled
        if self._cautious is None:
            return modelled.front, modelled.front
        mixture, front = np.empty(BEARINGS), np.empty(BEARINGS)
        shares, views = (SHARES, self.model_share), (modelled.burned, mixture, front)
        mixed_front(modelled.front, self._cautious.front, self._last_seen, *shares, *views)
        return mixture, front

    def reset_around(
        self, centre: tuple[float, float], front: Floats, at_s: float
    ) -> "FrontMixture":
        """Return a mixture around another centre, with the same models and wind but no views."""
        found = object.__new__(FrontMixture)
        found.modelled = self.modelled.reset_around(centre, front, at_s)
        own = self._cautious
        found._cautious = None if own is None else own.reset_around(centre, front, at_s)
        found._begin()
        return found

    def add_wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Add a wind measurement, as in ``FrontEstimate.add_wind``."""
        for estimate in self._estimates():
            estimate.add_wind(speed_m_s, from_deg, at_s)

    def advance(self, to_s: float) -> None:
        """Advance the front to the time ``to_s``."""
        for estimate in self._estimates():
            estimate.advance(to_s)
        _, self.front = self._mixed()

    def add_window(self, row: int, col: int, window: NDArray[np.uint8], at_s: float) -> None:
        """Update the front from one camera window, as in ``FrontEstimate.add_window``."""
        for estimate in self._estimates():
            estimate.advance(at_s)
        predicted = np.stack([self.modelled.front, self._mixed()[0]])
        unseen_s = at_s - self.modelled.seen_at_s
        view = self.modelled.bounded_view(row, col, window)  # both estimates have the same centre
        in_view = self.modelled.add_bounded_view(view)
        if self._cautious is not None:
            self._cautious.add_bounded_view(view)
        seen = self.modelled.front[in_view]
        again = ((unseen_s > AGAIN_S) & np.isfinite(unseen_s))[in_view]
        self._last_seen[in_view] = seen
        if again.any():
            off = predicted[:, in_view][:, again] - seen[again]
            self._squares = KEPT ** np.count_nonzero(again) * self._squares + (off**2).sum(axis=1)
        _, self.front = self._mixed()

    def correct_window(self, row: int, col: int, window: NDArray[np.uint8], at_s: float) -> None:
        """Apply a window corrected by an operator."""
        for estimate in self._estimates():
            estimate.correct_window(row, col, window, at_s)
        self._last_seen = np.where(
            self.modelled.seen_at_s == at_s, self.modelled.front, self._last_seen
        )
        _, self.front = self._mixed()

    def _estimates(self) -> tuple[FrontEstimate, ...]:
        return (self.modelled,) if self._cautious is None else (self.modelled, self._cautious)
