"""A fire let burn ahead: once as it is expected, and many times a little otherwise."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from firemodel.spread.fire_scheme import Fire, StartArea

# Odd, and no share of them is 10, 50 or 90 %: bands never run along the centres of cells.
MEMBERS = 15
# How far off the model may be, one standard deviation. Cruz & Alexander 2013 (Environ. Model.
# Softw. 47, 16-28) saw 1278 rates of spread: 35 % is as good as models get, their weather included.
# Rates grow with the wind to a power of 1.2 to 1.6, so that these two make 0.37 together.
SPREAD_LOG_SD = 0.25
WIND_LOG_SD = 0.2  # 1 m/s of 5
# Our choice, without a source: two of three winds come from within 15 degrees of what is reported.
WIND_TURN_SD_DEG = 15.0

Floats = NDArray[np.float64]


class Arrival(NamedTuple):
    """When fire comes where: the past as it was, the future as it is expected."""

    at_s: float  # the past ends here
    until_s: float  # as late as requested, or later
    arrival_s: Floats  # (y, x); later than until_s it is known next to the fire only, else infinity
    version: int
    start_area: StartArea | None = None  # of a fire taken over, for fronts


class Member(NamedTuple):
    """When one fire comes where, in the rows and columns from ``top`` and ``left`` on."""

    top: int
    left: int
    after_s: NDArray[np.float32]  # (y, x) seconds after the ensemble set out, infinity for never


class Ensemble(NamedTuple):
    """Fires that set out alike."""

    at_s: float
    until_s: float
    shape: tuple[int, int]
    members: list[Member]
    version: int


class Perturbation(NamedTuple):
    """What is different in one of them."""

    wind_factor: float
    turn_deg: float
    spread_factor: float


def perturbations(seed: int, count: int = MEMBERS) -> list[Perturbation]:
    """Drawn in equal parts of each distribution (Latin hypercube; McKay et al. 1979).

    The same each time, so that a forecast computed again moves only as the fire does.
    """
    rng = np.random.default_rng((seed, count))
    middle = ndtri((np.arange(count) + 0.5) / count)
    wind, turn, spread = (rng.permutation(middle) for _ in range(3))
    return [
        Perturbation(float(a), float(b), float(c))
        for a, b, c in zip(
            np.exp(WIND_LOG_SD * wind),
            WIND_TURN_SD_DEG * turn,
            np.exp(SPREAD_LOG_SD * spread),
            strict=True,
        )
    ]


def burned_ahead(fire: Fire, until_s: float, version: int, seed: int) -> Arrival:
    """When a fire comes where until a time. It is burned up for that: give a copy.

    Chance, where the scheme has any, is drawn again: the fire's own is not foreseen.
    """
    at_s = fire.time_s
    fire.draw_from(np.random.default_rng((seed, 0)))
    fire.advance(max(until_s, at_s))
    return Arrival(at_s, fire.time_s, fire.expected_s(), version, fire.start_area)


def ensemble_of(
    fire: Fire, until_s: float, version: int, seed: int, go_on: Callable[[], bool] = lambda: True
) -> Ensemble:
    """A fire's ensemble until a time; the fire is left as it is. Ends early when not to go on."""
    members = []
    for number, otherwise in enumerate(perturbations(seed), start=1):
        if not go_on():
            break
        member = fire.copy()
        member.draw_from(np.random.default_rng((seed, number)))
        member.perturb(*otherwise)
        member.advance(max(until_s, fire.time_s))
        members.append(_cut(member.arrival_time_s, fire.time_s))
    return Ensemble(fire.time_s, until_s, fire.landscape.shape, members, version)


def probability_at(ensemble: Ensemble, at_s: float) -> Floats:
    """(y, x) share of an ensemble in which each cell has burned by a time."""
    burned = np.zeros(ensemble.shape)
    for top, left, after_s in ensemble.members:
        rows, cols = after_s.shape
        burned[top : top + rows, left : left + cols] += after_s <= at_s - ensemble.at_s
    return burned / max(len(ensemble.members), 1)


def _cut(arrival_s: Floats, at_s: float) -> Member:
    """What has burned, in few bytes; what had by ``at_s`` stays so exactly (0 s or less)."""
    burned = np.isfinite(arrival_s)
    rows, cols = np.flatnonzero(burned.any(axis=1)), np.flatnonzero(burned.any(axis=0))
    if not rows.size:
        return Member(0, 0, np.empty((0, 0), dtype=np.float32))
    window = arrival_s[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return Member(int(rows[0]), int(cols[0]), (window - at_s).astype(np.float32))
