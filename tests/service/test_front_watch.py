"""The part of a front that a vehicle no longer observes."""

import pytest

from mission_service.guidance.front.unmonitored import nearest_bearings


@pytest.mark.parametrize(
    ("own_deg", "others_deg", "first", "last", "count"),
    [
        (90.0, [], 0, 359, 360),
        (90.0, [270.0], 0, 180, 181),
        (0.0, [90.0, 270.0], 315, 45, 91),
        (90.0, [90.0], 0, 359, 360),  # another vehicle is at the same bearing
        (10.4, [10.3, 10.5], 10, 10, 1),  # other vehicles are nearer to every whole degree
        (359.7, [359.6, 359.8], 0, 0, 1),
    ],
)
def test_a_vehicle_leaves_the_bearings_to_which_no_other_is_nearer(
    own_deg: float, others_deg: list[float], first: int, last: int, count: int
) -> None:
    found = nearest_bearings(own_deg, others_deg)
    assert (found[0], found[-1], found.size) == (first, last, count)
