"""Store the fire of an ensemble member, and the arrival times that images have changed."""

from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.spread.anyangle import AnyAngleFire


class MemberFire(NamedTuple):
    """The fire of one member at the time of the estimate.

    An image changes only ``arrival_s``. The changes are written into ``fire`` before it next
    advances.
    """

    fire: AnyAngleFire
    arrival_s: Floats  # (y, x) expected arrival times of the fire, with all changes
    changed: Mask | None = None  # (y, x) cells whose times differ from those of the fire

    def with_times(self, arrival_s: Floats, changed: Mask) -> "MemberFire":
        """Return this fire with new arrival times (y, x), which differ in the cells ``changed``."""
        before = self.changed
        return MemberFire(self.fire, arrival_s, changed if before is None else changed | before)

    def burns(self, at_s: float) -> bool:
        """Return True if some cells, but not all, have burned by the given time."""
        burned = self.arrival_s <= at_s
        return bool(burned.any() and not burned.all())

    def current(self) -> AnyAngleFire:
        """Return the fire with all changes; the caller must not change it."""
        if self.changed is None:
            return self.fire
        return self.fire.rewritten(np.asarray(self.arrival_s), self.changed)
