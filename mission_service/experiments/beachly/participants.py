"""Simulate the participants of Beachly's study, and measure the errors of simulated fronts."""

from typing import Any, NamedTuple

import contourpy
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED, Simulation
from firemodel.landscape.landscape import Landscape

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # west, south, east, north in metres

APART_M = 1.0  # spacing of points on a front, as in the paper's grid
FARTHEST_M = 150.0
NEVER_S = 1e6  # time after ``at_s`` assigned to unburned cells for drawing contours


class Watching(NamedTuple):
    """The parameters of a study, such as the paper's five segments of three minutes."""

    begins_s: tuple[float, ...]
    segment_s: float
    step_s: float = 20.0  # interval between observations
    look_s: float = 60.0  # interval between changes of the camera's view
    view_m: float = 120.0  # radius of the view around a point of the front
    wrong_m: float = 40.0  # maximum distance of burned and unburned observations from the front
    burning_share: float = 0.7  # fraction of observations that are marked as burning
    place_sd_m: float = 5.0  # random error of each observation
    offset_sd_m: float = 3.0  # constant error of a participant, like the error of a fish-eye lens


def front_points(
    arrival_s: Floats, at_s: float, landscape: Landscape, apart_m: float = APART_M
) -> Floats:
    """Return points (n, 2) on the fire's edge at a given time, from arrival times (y, x)."""
    finite_s = np.where(np.isfinite(arrival_s), arrival_s, at_s + NEVER_S)
    lines: Any = contourpy.contour_generator(z=finite_s).lines(at_s)
    found = [np.empty((0, 2))]
    for line in lines:
        x_m, y_m = landscape.xy_of(line[:, 1], line[:, 0])
        along_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
        at_m = np.arange(0.0, along_m[-1], apart_m)
        found.append(np.column_stack([np.interp(at_m, along_m, z) for z in (x_m, y_m)]))
    return np.concatenate(found)


def inside(points: Floats, box: Box) -> NDArray[np.bool_]:
    """Return a mask that is True for each of the points (n, 2) inside a box."""
    west, south, east, north = box
    x_m, y_m = points.T
    return np.asarray((x_m >= west) & (x_m <= east) & (y_m >= south) & (y_m <= north))


def front_error_m(true_front: Floats, found_front: Floats, max_m: float = FARTHEST_M) -> float:
    """Return the mean distance from the true front to the closest point of the found front.

    The error is defined as in section VII.B, with each distance limited to ``max_m``. Without a
    found front, the result is ``max_m``; without a true front, the result is NaN.
    """
    if not true_front.size:
        return float("nan")
    if not found_front.size:
        return max_m
    distance_m, _ = cKDTree(found_front).query(true_front)
    return float(np.minimum(distance_m, max_m).mean())


def random_observations(
    rng: np.random.Generator,
    count: int,
    watching: Watching,
    arrival_s: Floats,
    model: Simulation,
    landscape: Landscape,
    box: Box,
) -> Floats:
    """Return about ``count`` observations (n, 4) of one participant in time order.

    In each segment the camera shows a part of the front. Most observations are ``burning`` and lie
    on the true front. The others are ``burned`` behind the front or ``unburned`` ahead of the
    front, at places where the uncorrected simulation is wrong. These places do not depend on the
    correction method, so the observations are the same for every method. All positions have the
    participant's constant offset and a random error.
    """
    row, col = np.indices(arrival_s.shape)
    x_m, y_m = landscape.xy_of(row, col)
    cells = np.column_stack([x_m.ravel(), y_m.ravel()])
    within = inside(cells, box).reshape(arrival_s.shape)
    model_s = model.ignition_time_s(cells).reshape(arrival_s.shape)
    offset_m = watching.offset_sd_m * rng.standard_normal(2)
    steps = round(watching.segment_s / watching.step_s)
    share = rng.multinomial(
        count, np.full(len(watching.begins_s) * steps, 1.0) / (len(watching.begins_s) * steps)
    )
    found: list[tuple[float, float, float, int]] = []
    for number, observations in enumerate(share):
        segment, step = divmod(number, steps)
        at_s = watching.begins_s[segment] + (step + 1) * watching.step_s
        front = front_points(arrival_s, at_s, landscape)
        front = front[inside(front, box)]
        if not front.size:
            continue
        if step % round(watching.look_s / watching.step_s) == 0 or not found:
            look_at = front[rng.integers(len(front))]
        seen = front[np.hypot(*(front - look_at).T) <= watching.view_m]
        if not seen.size:
            look_at = front[rng.integers(len(front))]
            seen = front[np.hypot(*(front - look_at).T) <= watching.view_m]
        burned = arrival_s <= at_s
        in_view = within & (np.hypot(x_m - look_at[0], y_m - look_at[1]) <= watching.view_m)
        near = {
            BURNED: burned
            & (distance_transform_edt(burned) * landscape.cell_size_m <= watching.wrong_m)
            & (model_s > at_s),
            UNBURNED: ~burned
            & (distance_transform_edt(~burned) * landscape.cell_size_m <= watching.wrong_m)
            & (model_s <= at_s),
        }
        for _ in range(observations):
            state = BURNING
            if rng.random() >= watching.burning_share:
                state = BURNED if rng.random() < 0.5 else UNBURNED
            places = seen if state == BURNING else cells[(near[state] & in_view).ravel()]
            if not places.size:
                state, places = BURNING, seen
            place = places[rng.integers(len(places))]
            place = place + offset_m + watching.place_sd_m * rng.standard_normal(2)
            found.append((*place, at_s, state))
    return np.array(found).reshape(-1, 4)
