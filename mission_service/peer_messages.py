"""Defines the messages between UAVs. ``at_us`` is the sender's mission time.

A cell is given by its index ``row * cols + col`` in the landscape's grid; lists of cells are in
ascending order. The sections and messages cited are those of the virtual-agents paper.
"""

from typing import Annotated

import msgspec

# Limits are checked when a message is decoded, because kernels use 64-bit integers.
Us = Annotated[int, msgspec.Meta(ge=0, lt=2**61)]
Number = Annotated[int, msgspec.Meta(ge=0, lt=2**40)]  # index of a cell or of a tile, or a count


class Message(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """A message of the vehicle ``sender`` at mission time ``at_us``."""

    at_us: Us
    sender: str


class State(Message, frozen=True, tag=True):
    """Positions of a UAV and of its virtual agent, and the UAV's orbit (section 4, message 2).

    ``orbit_*`` is the circle that the UAV flies or approaches. The sender has checked this circle
    for conflicts with the orbits of the UAVs in the sender's peer table. A negative radius means
    anticlockwise, as in MAVLink; the paper's orbit has a radius of -150. A UAV that returns home
    has no virtual agent. A UAV is ``settled`` after some time on an unchanged orbit. ``goal_*`` is
    the goal of the virtual agent, or None for a UAV that stays on its orbit. ``planned_*`` is the
    altitude to which the UAV climbs or descends, or None if that is the current altitude.
    ``number`` counts the sender's ``State`` messages.
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
    """The goal of the sender's virtual agent; also sent to UAVs out of range of ``State``."""

    x_m: float
    y_m: float


class FireUpdate(Message, frozen=True, tag=True):
    """Cells that were observed as burning or as no longer burning (section 4, message 1).

    The message is for all UAVs. ``at_us`` is the time of the observation and serves as the version
    of these cells.
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
    """Cells that other UAVs' maps lack, run-length encoded.

    A run is (first cell, count, seen_at_us, burning). For each tile in ``whole``, the runs contain
    every known cell of the tile.
    """

    cells: tuple[tuple[Number, Number, Us, bool], ...]
    whole: tuple[Number, ...] = ()


class Leaving(Message, frozen=True, tag=True):
    """The sender flies home; its virtual agent is removed and its messages pause."""

    why: str


AnyMessage = State | Goal | FireUpdate | Digest | Difference | Leaving
