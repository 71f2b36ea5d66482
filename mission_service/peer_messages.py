"""What UAVs tell each other. Data only; ``at_us`` is mission time, the sender's own.

Cells are numbers ``row * cols + col`` of the landscape's grid, in rising order.
"""

from typing import Annotated

import msgspec

# Checked where messages are decoded: kernels reckon with 64 bits.
Us = Annotated[int, msgspec.Meta(ge=0, lt=2**61)]
Number = Annotated[int, msgspec.Meta(ge=0, lt=2**40)]  # of a cell, of a tile, of how many


class Message(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """Said by the vehicle ``sender`` at mission time ``at_us``."""

    at_us: Us
    sender: str


class State(Message, frozen=True, tag=True):
    """Where a UAV and its virtual agent are, and what it is about to fly (section 4, message 2).

    ``orbit_*`` is the circle the UAV flies to or on: its intention, checked by the sender against
    all it knew of. A negative radius is anticlockwise, as in MAVLink: the paper's orbit has -150.
    On the way home there is no virtual agent. ``goal_*`` is where it is going; none: it stays.
    """

    x_m: float
    y_m: float
    altitude_amsl_m: float
    velocity_x_m_s: float  # over the ground
    velocity_y_m_s: float
    agent_x_m: float | None
    agent_y_m: float | None
    orbit_x_m: float
    orbit_y_m: float
    orbit_radius_m: float
    airspeed_m_s: float
    settled: bool
    goal_x_m: float | None = None
    goal_y_m: float | None = None


class FireUpdate(Message, frozen=True, tag=True):
    """Cells that were seen to burn, and no longer to (section 4, message 1); for everybody.

    ``at_us`` is when they were seen, and with that the version of these cells.
    """

    burning: tuple[Number, ...]
    cleared: tuple[Number, ...] = ()


class Digest(Message, frozen=True, tag=True):
    """What the sender's fire map holds: (tile, checksum).

    Tiles from ``first`` up to ``end`` that are not listed are empty there. Without such tiles it is
    a question: others have more or other cells in the tiles listed; which?
    """

    tiles: tuple[tuple[Number, Number], ...]
    first: Number = 0
    end: Number = 0


class Difference(Message, frozen=True, tag=True):
    """Cells that others seem to lack, as runs: (first cell, how many, seen_at_us, burning).

    Of the tiles in ``whole`` they are all that the sender knows.
    """

    cells: tuple[tuple[Number, Number, Us, bool], ...]
    whole: tuple[Number, ...] = ()


class Leaving(Message, frozen=True, tag=True):
    """The sender goes home: its virtual agent is no more; it speaks again when it is back."""

    why: str


AnyMessage = State | FireUpdate | Digest | Difference | Leaving
