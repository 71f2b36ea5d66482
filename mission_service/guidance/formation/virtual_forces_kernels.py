"""Computes the paper's virtual forces on one agent, in compiled code (section 5.2, eqs. 5 to 13).

Forces are velocities of the virtual agent in m/s. Distances between agents are in the paper's cells
of 10 m (``PAPER_CELL_M``), so that the constants have the same meaning on every map. Where the
paper is incomplete, these rules apply:

- Eq. 7 raises a negative number to the power e3. The magnitude of this number, which is the overlap
  of the two agents, is used instead. The force is repulsive, as the text states.
- For two agents at the same position, or for an agent at the fire's centre, the paper's direction
  is undefined. The direction is then ``tie_rad``, which must differ between vehicles.
- In a local minimum, the escape force (eq. 13) replaces the sum of the other forces. The escape
  leads anticlockwise around the fire, the direction in which UAVs loiter.

``constants`` is the result of ``constants_array``. A map is an array (rows, cols) with row 0 in the
north. A cell is set if its value is not 0; cells outside the map are not set. ``west_m`` and
``north_m`` are the coordinates of the map's north-west corner.
"""

import math

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.guidance.formation.settings import PAPER_CELL_M, Constants

NAMES = ("c1", "c2", "c3", "c4", "c5", "e3", "t1", "t2")  # the order of ``constants``
C1, C2, C3, C4, C5, E3, T1, T2 = range(8)
SAME_PLACE_M = 1e-6


def constants_array(constants: Constants) -> NDArray[np.float64]:
    """Return the eight constants as an array in the order of ``NAMES``."""
    return np.array([getattr(constants, name) for name in NAMES], dtype=np.float64)


def tie_rad(number: int) -> float:
    """Return a direction for a vehicle's number: the number times the golden angle.

    Different vehicles have different directions.
    """
    return number * 2.399963229728653 % (2.0 * math.pi)


@kernel
def is_set(bitmap, x_m, y_m, west_m, north_m, cell_m):  # type: ignore[no-untyped-def]
    """Return whether the cell of a map at a position is set."""
    row = math.floor((north_m - y_m) / cell_m)
    col = math.floor((x_m - west_m) / cell_m)
    rows, cols = bitmap.shape
    return 0 <= row < rows and 0 <= col < cols and bitmap[row, col] != 0


@kernel
def unit_vector(from_x_m, from_y_m, to_x_m, to_y_m, tie_rad):  # type: ignore[no-untyped-def]
    """Return the unit vector from one position to another, and the distance between the positions.

    If both positions are the same, the vector has the direction ``tie_rad``, and the distance is 0.
    """
    east, north = to_x_m - from_x_m, to_y_m - from_y_m
    distance_m = math.hypot(east, north)
    if distance_m < SAME_PLACE_M:
        return math.cos(tie_rad), math.sin(tie_rad), 0.0
    return east / distance_m, north / distance_m, distance_m


@kernel
def attraction(in_area, constants):  # type: ignore[no-untyped-def]
    """Return the attraction of an agent to the fire's centre in m/s (eq. 5)."""
    return constants[C1] if in_area else constants[C2]


@kernel
def avoidance(in_augmentation, constants):  # type: ignore[no-untyped-def]
    """Return the repulsion of an agent from the fire's centre in m/s (eq. 9)."""
    return constants[C4] if in_augmentation else 0.0


@kernel
def formation(x_m, y_m, others_x_m, others_y_m, spacing_m, constants, tie_rad):  # type: ignore[no-untyped-def]
    """Return the repulsion (m/s) from the n other agents within the spacing (eqs. 6 to 8)."""
    east, north = 0.0, 0.0
    for j in range(others_x_m.size):
        e, n, distance_m = unit_vector(others_x_m[j], others_y_m[j], x_m, y_m, tie_rad)
        if distance_m < spacing_m:
            force = constants[C3] * ((spacing_m - distance_m) / PAPER_CELL_M) ** constants[E3]
            east += force * e
            north += force * n
    return east, north


@kernel
def in_local_minimum(force, formation_force, constants):  # type: ignore[no-untyped-def]
    """Return whether the forces cancel despite strong repulsion from agents (section 5.2.5)."""
    return force < constants[T1] and formation_force > constants[T2]


@kernel
def velocity_of_forces(  # type: ignore[no-untyped-def]
    x_m, y_m, others_x_m, others_y_m, centre_x_m, centre_y_m, augmentation, area,
    west_m, north_m, cell_m, constants, spacing_m, max_m_s, tie_rad,
):  # fmt: skip
    """Compute the velocity (east, north; m/s) of a virtual agent at (x, y) (eqs. 10 to 13).

    ``others_x_m`` and ``others_y_m`` (n) are the positions of the other agents in range.
    ``centre_x_m`` and ``centre_y_m`` are the fire's centre of gravity. ``spacing_m`` is d in eq. 8,
    and ``max_m_s`` is vel_max.
    """
    # At the centre all directions lead outwards: the inward direction is set opposite to tie_rad.
    in_e, in_n, _ = unit_vector(x_m, y_m, centre_x_m, centre_y_m, tie_rad + math.pi)
    in_area = is_set(area, x_m, y_m, west_m, north_m, cell_m)
    in_augmentation = is_set(augmentation, x_m, y_m, west_m, north_m, cell_m)
    inwards = attraction(in_area, constants) - avoidance(in_augmentation, constants)
    push_e, push_n = formation(x_m, y_m, others_x_m, others_y_m, spacing_m, constants, tie_rad)
    east, north = inwards * in_e + push_e, inwards * in_n + push_n
    force = math.hypot(east, north)
    if in_local_minimum(force, math.hypot(push_e, push_n), constants):
        # Anticlockwise around the centre: the inward direction, turned right.
        east, north, force = constants[C5] * in_n, -constants[C5] * in_e, constants[C5]
    elif force < constants[T1]:
        return 0.0, 0.0
    capped = min(force, max_m_s)
    if force <= 0.0:
        return 0.0, 0.0
    return east / force * capped, north / force * capped
