"""Encode and decode windows of cells as in the event ``Observed``."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Mask
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.spread.fire_scheme import Fire

AROUND_CELLS = 3  # margin of a reported window, which includes the edge of the change
STATE_OF_LETTER = np.full(256, UNSEEN, dtype=np.uint8)
STATE_OF_LETTER[ord("b")], STATE_OF_LETTER[ord("u")] = BURNED, UNBURNED


class Window(NamedTuple):
    """A window of cells, encoded as in ``Observed``."""

    row: int
    col: int
    cells: tuple[str, ...]


def window_of_change(before: Fire, after: Fire) -> Window | None:
    """Return the window around the cells that have burned in only one of two fires, or None."""
    changed = after.burned() != before.burned()
    return window_around(changed, after) if changed.any() else None


def window_around(cells: Mask, fire: Fire) -> Window:
    """Return the present states of a fire in the window around the cells of a mask (y, x)."""
    burned = fire.burned()
    rows, cols = np.nonzero(cells)
    top, left = (max(int(each.min()) - AROUND_CELLS, 0) for each in (rows, cols))
    below, right = (int(each.max()) + AROUND_CELLS + 1 for each in (rows, cols))
    shown = burned[top:below, left:right]
    return Window(top, left, in_letters(np.where(shown, ord("b"), ord("u"))))


def in_letters(codes: NDArray[Any]) -> tuple[str, ...]:
    """Return character codes (y, x) as one string for each row."""
    text = codes.astype(np.uint8).tobytes().decode("ascii")
    width = codes.shape[1]
    return tuple(text[start : start + width] for start in range(0, len(text), width))


def states_in(cells: Sequence[str]) -> NDArray[np.uint8]:
    """Return the states (y, x) of a window's cells: UNSEEN, UNBURNED or BURNED."""
    codes = np.frombuffer("".join(cells).encode("ascii"), dtype=np.uint8)
    return STATE_OF_LETTER[codes].reshape(len(cells), -1)
