"""A vehicle's progress along a plan's path, and the times of the rest of the path."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOOKS_AHEAD_M = 30.0  # the progress of one update, at most


class PathProgress:
    """A path (n, 3) x, y, altitude in metres, flown at times (n,) after its begin."""

    def __init__(self, points_m: Floats, after_s: Floats) -> None:
        self.points_m = points_m
        self._after_s = after_s
        steps = np.diff(points_m, axis=0)
        self._lengths_m = np.sqrt((steps * steps).sum(axis=1))
        self._along_m = np.concatenate([[0.0], np.cumsum(self._lengths_m)])
        self.progress_m = 0.0  # along the path; never decreases

    @property
    def length_m(self) -> float:
        """Length of the whole path, climbs and descents included."""
        return float(self._along_m[-1])

    @property
    def left_m(self) -> float:
        """Length still to be flown."""
        return self.length_m - self.progress_m

    @property
    def after_s(self) -> float:
        """The plan's time, after its begin, at the present progress."""
        return float(np.interp(self.progress_m, self._along_m, self._after_s))

    def update(self, place_m: Floats) -> float:
        """Set the vehicle's place (3,); returns its distance from the path, in metres."""
        first = max(int(np.searchsorted(self._along_m, self.progress_m, side="right")) - 1, 0)
        last = int(np.searchsorted(self._along_m, self.progress_m + LOOKS_AHEAD_M))
        off_m, progress_m = np.inf, self.progress_m
        for leg in range(first, min(last, len(self._lengths_m))):
            start, length = self.points_m[leg], self._lengths_m[leg]
            way = self.points_m[leg + 1] - start
            share = 0.0 if length == 0.0 else float((place_m - start) @ way) / float(length**2)
            low = (
                (self.progress_m - self._along_m[leg]) / length if leg == first and length else 0.0
            )
            share = min(max(share, low), 1.0)
            far_m = float(np.linalg.norm(start + share * way - place_m))
            if far_m < off_m - 1e-6:
                off_m, progress_m = far_m, float(self._along_m[leg] + share * length)
        self.progress_m = min(progress_m, self.progress_m + LOOKS_AHEAD_M)
        return off_m

    def ahead(self, now_s: float) -> Floats:
        """The rest of the path: (k, 4) x, y, altitude, at_s."""
        rest = self._along_m > self.progress_m
        here = [np.interp(self.progress_m, self._along_m, axis) for axis in self.points_m.T]
        points = np.vstack([here, self.points_m[rest]])
        late_s = now_s - self.after_s
        times = np.concatenate([[now_s], self._after_s[rest] + late_s])
        return np.column_stack([points, times])
