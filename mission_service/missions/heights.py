"""Computes the maximum altitudes of other vehicles near given points, for ``separation.py``."""

from firemodel.compiled import kernel


@kernel
def heights_near(points_m, others_m, highest_m, near_m, found_m):  # type: ignore[no-untyped-def]
    """Raise ``found_m`` (n,) to the highest altitude of other vehicles near each point.

    A position in ``others_m`` (m, 2), with its altitude in ``highest_m`` (m,), is near a point in
    ``points_m`` (n, 2) if the distance between them is at most ``near_m``.
    """
    for point in range(points_m.shape[0]):
        x_m, y_m = points_m[point, 0], points_m[point, 1]
        for other in range(others_m.shape[0]):
            east_m, north_m = others_m[other, 0] - x_m, others_m[other, 1] - y_m
            if highest_m[other] > found_m[point] and (
                east_m * east_m + north_m * north_m <= near_m * near_m
            ):
                found_m[point] = highest_m[other]
