"""Heights of lower tracks: the fast method gives the same as a check of every pair of points."""

import numpy as np
import pytest

from mission_service.missions.separation import NEAR_M, Floats, Track, heights_below


def plainly(points_m: Floats, tracks: list[Track]) -> Floats:
    found = np.full(len(points_m), -np.inf)
    for track in tracks:
        for place, (x_m, y_m) in enumerate(points_m):
            far_m = np.hypot(x_m - track.points_m[:, 0], y_m - track.points_m[:, 1])
            if (far_m <= NEAR_M).any():
                found[place] = max(found[place], track.highest_m[far_m <= NEAR_M].max())
    return found


@pytest.mark.parametrize("seed", range(5))
def test_no_track_is_passed_over(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks = []
    for _ in range(30):
        count = int(rng.integers(1, 20))
        points = rng.uniform(-1500, 1500, 2) + rng.uniform(-400, 400, (count, 2))
        heights = rng.uniform(0, 500, count)
        tracks.append(Track(points, heights, heights + 10.0))
    # A point at exactly the maximum distance, to the east.
    edge = tracks[0].points_m[0] + np.array([NEAR_M, 0.0])
    points = np.vstack([rng.uniform(-1000, 1000, (20, 2)), edge])
    found = heights_below(points, tracks)
    assert np.array_equal(found, plainly(points, tracks))
    assert np.isfinite(found).any()
    assert np.isinf(heights_below(points + 1e5, tracks)).all()
    assert len(heights_below(points[:0], tracks)) == 0
