"""Encode and decode windows of cells as in the event ``Observed``."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Mask
from firemodel.assimilation.observation import (
    BURNED,
    UNBURNED,
    UNSEEN,
    Observation,
    despeckled,
)
from firemodel.spread.fire_scheme import Fire
from mission_service.events import Observed

AROUND_CELLS = 3  # margin around the changed cells in a reported window
STATE_OF_LETTER = np.full(256, UNSEEN, dtype=np.uint8)
STATE_OF_LETTER[ord("b")], STATE_OF_LETTER[ord("u")] = BURNED, UNBURNED

LETTERS = np.frombuffer(b".ub", dtype=np.uint8)  # the letter of each state


class Window(NamedTuple):
    """A window of cells, encoded as in ``Observed``."""

    row: int
    col: int
    cells: tuple[str, ...]


def window_of_change(before: Fire, after: Fire) -> Window | None:
    """Return the window around the cells burned in only one of two fires, or None."""
    changed = after.burned() != before.burned()
    return window_around(changed, after) if changed.any() else None


def window_around(cells: Mask, fire: Fire) -> Window:
    """Return a fire's current states in the window around the cells of a mask (y, x)."""
    burned = fire.burned()
    rows, cols = np.nonzero(cells)
    top, left = (max(int(each.min()) - AROUND_CELLS, 0) for each in (rows, cols))
    below, right = (int(each.max()) + AROUND_CELLS + 1 for each in (rows, cols))
    shown = burned[top:below, left:right]
    return Window(top, left, in_letters(np.where(shown, ord("b"), ord("u"))))


def observation_in(image: Observed) -> Observation:
    """Return a camera's image as an observation without detection errors.

    A majority filter removes these errors if the sensor makes any.
    """
    seen = Observation(
        image.at_us / 1e6,
        image.row,
        image.col,
        states_in(image.cells),
        image.position_sd_m,
        image.missed,
        image.false_alarms,
        image.source or image.vehicle,
    )
    return seen._replace(state=despeckled(seen), missed=0.0, false_alarms=0.0)


def without_speckles(image: Observed) -> Observed:
    """Return an image after a majority filter if its sensor makes detection errors."""
    if not (image.missed or image.false_alarms):
        return image
    codes = LETTERS[observation_in(image).state]
    return msgspec.structs.replace(image, cells=in_letters(codes), missed=0.0, false_alarms=0.0)


def in_letters(codes: NDArray[Any]) -> tuple[str, ...]:
    """Return character codes (y, x) as one string for each row."""
    text = codes.astype(np.uint8).tobytes().decode("ascii")
    width = codes.shape[1]
    return tuple(text[start : start + width] for start in range(0, len(text), width))


def states_in(cells: Sequence[str]) -> NDArray[np.uint8]:
    """Return the states (y, x) of a window's cells: UNSEEN, UNBURNED or BURNED."""
    codes = np.frombuffer("".join(cells).encode("ascii"), dtype=np.uint8)
    return STATE_OF_LETTER[codes].reshape(len(cells), -1)
