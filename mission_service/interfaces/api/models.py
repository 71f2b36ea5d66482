"""Defines the API responses that are not states in the state view."""

from typing import Any

import msgspec

from mission_service.fire_arrival.arrival_times import FireArrival
from mission_service.missions.mission_figures import Figures
from mission_service.requests import Role
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.published_states import (
    AirspaceStatus,
    Alarm,
    Announcement,
    ItemState,
    MissionState,
    NearbyAircraft,
    Record,
    SourceState,
    TelemetryState,
    VehicleState,
)
from mission_service.runtime.run_context import RunContext


class Error(msgspec.Struct):
    """The reason why a request was refused, in one line."""

    error: str


class RequestResult(msgspec.Struct):
    """The result of a request: mission time, event type and the resulting announcements.

    For a correction of the fire (correct, erase, undo, redo), the result also contains the areas
    burned before and after the correction. In a burn, these areas are missing, because a correction
    changes the burn's own estimate of the fire.
    """

    ok: bool
    at_s: float
    event: str
    messages: list[str]
    confirm: bool = False  # not carried out: the operator must send it again with ``confirmed``
    burned_ha_before: float | None = None
    burned_ha_after: float | None = None


class StatusState(msgspec.Struct, tag="run/1", tag_field="schema"):
    """The run's status. ``not_ready`` lists the conditions that are not met yet."""

    at_us: int
    time_unix_us: int
    scenario: str
    rule: str
    duration_s: float
    not_ready: list[str]
    stopping: bool


class LandscapeExtent(msgspec.Struct):
    """The landscape's extent (west, south, east, north) and corners (NW, NE, SE, SW; lon, lat)."""

    bounds: tuple[float, float, float, float]
    corners_lon_lat: tuple[tuple[float, float], ...]
    cell_size_m: float
    rows: int
    cols: int


class FullState(msgspec.Struct):
    """The complete state; ``/live?since=version`` streams the later changes."""

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
    announcements: list[Announcement]
    landscape: LandscapeExtent
    rule: str
    planner: dict[str, Any]
    replay: ReplayState | None = None  # None: a live run
    sources: list[SourceState] = []
    airspace: AirspaceStatus | None = None
    aircraft: list[NearbyAircraft] = []
    records: list[Record] = []
    fire_arrivals: list[FireArrival] = []


class MissionDifference(msgspec.Struct):
    """The difference from an earlier mission: equal items at the beginning, and moved positions."""

    alike_first: int
    added: int
    removed: int
    farthest_moved_m: float


class Preview(msgspec.Struct):
    """The mission that would be sent now, and its difference from the mission on board."""

    at_us: int
    vehicle: str
    mission_hash: str
    items: tuple[ItemState, ...]
    figures: Figures
    difference: MissionDifference


class Importance(msgspec.Struct):
    """The importances that the planner compares.

    ``cells`` lie along the estimated front, from the vehicle backwards. Each cell is (lat_deg,
    lon_deg, importance), in the planner's unit.
    """

    at_us: int
    vehicle: str
    rule: str
    importance_back: float
    importance_front: float
    cells: list[tuple[float, float, float]]


class Health(msgspec.Struct):
    """The health of the service. ``not_ready`` lists the conditions that are not met yet."""

    ok: bool
    not_ready: list[str] = []


def status_of(context: RunContext, time_unix_us: int) -> StatusState:
    """Return the status of the run."""
    scenario = context.scenario
    return StatusState(
        context.clock.now_us,
        time_unix_us,
        scenario.name,
        scenario.planner.rule,
        scenario.duration_s,
        context.ready(),
        context.stopping,
    )


def land_of(context: RunContext) -> LandscapeExtent:
    """Return the extent of the landscape."""
    land = context.landscape
    rows, cols = land.shape
    ends = [(-0.5, -0.5), (-0.5, cols - 0.5), (rows - 0.5, cols - 0.5), (rows - 0.5, -0.5)]
    points = (land.lat_lon_of(*land.xy_of(row, col)) for row, col in ends)
    corners = tuple((float(land.unwrapped_deg(lon)), float(lat)) for lat, lon in points)
    lons, lats = zip(*corners, strict=True)
    bounds = (min(lons), min(lats), max(lons), max(lats))
    return LandscapeExtent(bounds, corners, land.cell_size_m, rows, cols)
