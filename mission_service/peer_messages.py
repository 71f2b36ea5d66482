"""Defines the messages between UAVs. ``at_us`` is the sender's mission time.

A cell is the number ``row * cols + col`` in the landscape's grid; cells are in ascending order.
"""

from typing import Annotated

import msgspec

# Limits are checked when a message is decoded, because kernels compute with 64 bits.
Us = Annotated[int, msgspec.Meta(ge=0, lt=2**61)]
Number = Annotated[int, msgspec.Meta(ge=0, lt=2**40)]  # number of a cell or of a tile, or a count


class Message(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """A message of the vehicle ``sender`` at mission time ``at_us``."""

    at_us: Us
    sender: str


class State(Message, frozen=True, tag=True):
    """Position of a UAV and its virtual agent, and its intended orbit (section 4, message 2).

    ``orbit_*`` is the circle that the UAV flies or approaches. The sender has checked this circle
    for conflicts with the orbits of the UAVs in the sender's peer table. A negative radius means
    anticlockwise, as in MAVLink; the paper's orbit has a radius of -150. A returning UAV has no
    virtual agent. ``goal_*`` is None for a UAV that stays on its orbit. ``planned_*`` is the
    altitude to which the UAV climbs or descends; None if it is the present altitude. ``number``
    counts the sender's states.
    """

    x_m: float
    y_m: float
    altitude_amsl_m: float
    velocity_x_m_s: float  # velocity over the ground
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
    planned_altitude_amsl_m: float | None = None
    number: Number = 0


class Goal(Message, frozen=True, tag=True):
    """The goal of the sender's virtual agent, for all UAVs, also beyond the range of states."""

    x_m: float
    y_m: float


class FireUpdate(Message, frozen=True, tag=True):
    """Cells observed as burning or no longer burning, for all UAVs (section 4, message 1).

    ``at_us`` is the time of the observation and serves as the version of these cells.
    """

    burning: tuple[Number, ...]
    cleared: tuple[Number, ...] = ()


class Digest(Message, frozen=True, tag=True):
    """The checksums of tiles in the sender's fire map, as (tile, checksum).

    Unlisted tiles from ``first`` up to ``end`` are empty in the sender's map. With an empty range
    the digest requests the cells of the listed tiles, whose checksums on the sender's map differ
    from the checksums on the receiver's map.
    """

    tiles: tuple[tuple[Number, Number], ...]
    first: Number = 0
    end: Number = 0


class Difference(Message, frozen=True, tag=True):
    """Cells that other UAVs' maps lack, as runs: (first cell, count, seen_at_us, burning).

    For each tile in ``whole``, the runs contain every known cell of the tile.
    """

    cells: tuple[tuple[Number, Number, Us, bool], ...]
    whole: tuple[Number, ...] = ()


class Leaving(Message, frozen=True, tag=True):
    """The sender flies home, removes its virtual agent and pauses its messages."""

    why: str


AnyMessage = State | Goal | FireUpdate | Digest | Difference | Leaving
