"""What the API answers beyond the picture's own states."""

from typing import Any

import msgspec

from mission_service.interfaces.api.access.auth import Role
from mission_service.missions.mission_figures import Figures
from mission_service.runtime.hub import Hub
from mission_service.runtime.picture import (
    Alarm,
    ItemState,
    MissionState,
    NewsLine,
    TelemetryState,
    VehicleState,
)
from mission_service.runtime.play_head import ReplayState


class Error(msgspec.Struct):
    """Why there is no answer, in one line."""

    error: str


class Told(msgspec.Struct):
    """What was done: mission time, the event it became, and what the service said to it.

    For a correction of the fire (correct, erase, undo, redo) also the area burned before and after;
    absent in a burn, where a correction changes the estimated fire.
    """

    ok: bool
    at_s: float
    event: str
    said: list[str]
    confirm: bool = False  # not carried out: ask the operator, then send it ``confirmed``
    burned_ha_before: float | None = None
    burned_ha_after: float | None = None


class StatusState(msgspec.Struct, tag="run/1", tag_field="schema"):
    """The run as a whole. ``not_ready``: what it lacks before it does its work."""

    at_us: int
    time_unix_us: int
    scenario: str
    rule: str
    duration_s: float
    not_ready: list[str]
    stopping: bool


class Land(msgspec.Struct):
    """Where the landscape lies: west, south, east, north; corners NW, NE, SE, SW as lon, lat."""

    bounds: tuple[float, float, float, float]
    corners_lon_lat: tuple[tuple[float, float], ...]
    cell_size_m: float
    rows: int
    cols: int


class State(msgspec.Struct):
    """Everything for a new page; ``/live?since=version`` goes on from here."""

    version: int
    status: StatusState
    roles: tuple[Role, ...]
    by: str
    vehicles: list[VehicleState]
    telemetry: list[TelemetryState]
    missions: list[MissionState]
    fire: dict[str, Any]
    burn: dict[str, Any] | None
    alarms: list[Alarm]
    news: list[NewsLine]
    landscape: Land
    rule: str
    planner: dict[str, Any]
    replay: ReplayState | None = None  # None: it is happening


class Difference(msgspec.Struct):
    """What changes with a mission: items alike at its beginning, and the places that move."""

    alike_first: int
    added: int
    removed: int
    farthest_moved_m: float


class Preview(msgspec.Struct):
    """What would be sent now, and how it differs from what is on board."""

    at_us: int
    vehicle: str
    mission_hash: str
    items: tuple[ItemState, ...]
    figures: Figures
    difference: Difference


class Importance(msgspec.Struct):
    """What the planner compares; ``cells`` along the believed front from the vehicle backwards.

    Each cell is (lat_deg, lon_deg, importance), in the planner's unit.
    """

    at_us: int
    vehicle: str
    rule: str
    importance_back: float
    importance_front: float
    cells: list[tuple[float, float, float]]


class Health(msgspec.Struct):
    """Whether the service lives, or what it lacks."""

    ok: bool
    not_ready: list[str] = []


def status_of(hub: Hub, time_unix_us: int) -> StatusState:
    """The run as a whole."""
    scenario = hub.scenario
    return StatusState(
        hub.clock.now_us,
        time_unix_us,
        scenario.name,
        scenario.planner.rule,
        scenario.duration_s,
        hub.ready(),
        hub.stopping,
    )


def land_of(hub: Hub) -> Land:
    """Where the landscape lies."""
    land = hub.landscape
    rows, cols = land.shape
    ends = [(-0.5, -0.5), (-0.5, cols - 0.5), (rows - 0.5, cols - 0.5), (rows - 0.5, -0.5)]
    corners = []
    for row, col in ends:
        lat, lon = land.lat_lon_of(*land.xy_of(row, col))
        corners.append((float(lon), float(lat)))
    lons, lats = [lon for lon, _ in corners], [lat for _, lat in corners]
    bounds = (min(lons), min(lats), max(lons), max(lats))
    return Land(bounds, tuple(corners), land.cell_size_m, rows, cols)
