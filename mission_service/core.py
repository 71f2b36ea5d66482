"""The core: events in, commands out. No clock, no network, no randomness.

Simulation, live flight, replay and tests all run this and feed it from different sources.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    Decided,
    Direction,
    Hold,
    StartMission,
    UploadMission,
)
from mission_service.config import Scenario
from mission_service.config_sections import VehicleSection
from mission_service.events import (
    AnyEvent,
    CommandFinished,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Observed,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
)
from mission_service.landing import landing_of, needs_landing
from mission_service.planners.following import PathSettings
from mission_service.planners.perimeter import PerimeterPlanner, PerimeterSettings
from mission_service.planners.protocol import Decision, Planner
from mission_service.translate import mission_along

Floats = NDArray[np.float64]

AIRBORNE_M = 15.0
# A new path is compared with the one being flown over this share of the horizon ...
COMPARED_SHARE = 0.25
# ... and a mission is extended when less than this share of the horizon is left.
LEFT_SHARE = 0.4
RETRY_S = 5.0
START_AGAIN_S = 10.0
CHECK_EVERY_S = 2.0
LINE_TOLERANCE_M = 5.0


@dataclass
class Pending:
    """A mission on its way to the vehicle."""

    mission_id: int
    line: shapely.LineString


@dataclass
class Vehicle:
    """What the core knows of one vehicle."""

    section: VehicleSection
    planner: Planner
    landing: tuple[MissionItem, ...] = ()
    online: bool = False
    atomic_upload: bool = False
    deployed: bool = False
    started: bool = False
    holding: bool = False
    start_again_at_s: float | None = None
    airborne: bool = False
    pending: Pending | None = None
    flown_line: shapely.LineString | None = None
    uploaded_at_s: float = -1e9
    not_before_s: float = -1e9
    phase: str = ""
    turned: bool = False


class Core:
    """Folds events into vehicles' states and answers with what is to be done."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        self.scenario = scenario
        self.landscape = landscape
        self._next_mission_id = 1
        self.vehicles = {
            section.name: Vehicle(
                section,
                planner_of(scenario, section, landscape),
                landing_of_vehicle(scenario, section, landscape),
            )
            for section in scenario.vehicles
        }

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        """Take in one event; returns the commands it causes, in order.

        Raises KeyError for a vehicle the scenario does not name.
        """
        vehicle = self.vehicles[event.vehicle]
        match event:
            case Telemetry():
                return self._moved(vehicle, event)
            case Observed():
                vehicle.planner.observe(event)
                return []
            case UploadFinished():
                return self._upload_finished(vehicle, event)
            case VehicleConnected():
                vehicle.online = True
                vehicle.atomic_upload = event.atomic_upload
                return [_say(vehicle, f"connected ({event.stack})")]
            case LinkLost():
                vehicle.online = False
                return [
                    _say(
                        vehicle,
                        f"no heartbeat for {event.silent_s:.1f} s: link lost; the mission on board "
                        "ends in a loiter",
                        warning=True,
                    )
                ]
            case LinkRestored():
                vehicle.online = True
                vehicle.flown_line = None  # a new mission is due: the front has moved on
                return [_say(vehicle, "link restored")]
            case VehicleRebooted():
                return self._rebooted(vehicle)
            case CommandFinished():
                return self._command_finished(vehicle, event)
            case ModeChanged():
                vehicle.airborne &= event.armed
                return []
            case MissionProgress():
                return []  # for people and the journal

    def _moved(self, vehicle: Vehicle, here: Telemetry) -> list[AnyCommand]:
        at_s = here.at_us / 1e6
        # Home may lie on a hill: once up, a vehicle flies until it disarms.
        vehicle.airborne |= here.altitude_relative_m >= AIRBORNE_M
        if not vehicle.online or at_s < self.scenario.deploy_at_s:
            return []
        if not vehicle.deployed:
            return self._deploy(vehicle, here)
        if not vehicle.airborne:
            if vehicle.start_again_at_s is not None and at_s >= vehicle.start_again_at_s:
                vehicle.start_again_at_s = None
                return [StartMission(vehicle.section.name)]
            return self._deploy(vehicle, here) if self._due(vehicle, at_s) else []
        x_m, y_m = self.landscape.xy_of_lat_lon(here.lat_deg, here.lon_deg)
        row, col = (float(value) for value in self.landscape.row_col_of(x_m, y_m))
        decision = vehicle.planner.at(row, col, at_s)
        commands: list[AnyCommand] = []
        if vehicle.planner.phase != vehicle.phase:
            vehicle.phase = vehicle.planner.phase
            commands.append(_say(vehicle, f"phase: {vehicle.phase}"))
        if decision is not None:
            commands.append(_decided(vehicle, decision))
            vehicle.turned |= decision.reversed
        if vehicle.pending is None and (vehicle.turned or at_s >= vehicle.not_before_s):
            vehicle.not_before_s = at_s + CHECK_EVERY_S
            commands += self._follow(vehicle, x_m, y_m, row, col, at_s)
        return commands

    def _due(self, vehicle: Vehicle, at_s: float) -> bool:
        """A vehicle on the ground without a mission is sent one (again)."""
        return (
            vehicle.pending is None and vehicle.flown_line is None and at_s >= vehicle.not_before_s
        )

    def _deploy(self, vehicle: Vehicle, here: Telemetry) -> list[AnyCommand]:
        """Send the vehicle to the fire; it finds the front on its way."""
        vehicle.deployed = True
        at_s = here.at_us / 1e6
        start = self.landscape.xy_of_lat_lon(here.lat_deg, here.lon_deg)
        path = approach_path(self.scenario, self.landscape, start)
        return [self._upload(vehicle, path, at_s, "fly to the fire")]

    def _follow(
        self, vehicle: Vehicle, x_m: float, y_m: float, row: float, col: float, at_s: float
    ) -> list[AnyCommand]:
        """Renew the rolling mission when it is no longer what the vehicle should fly."""
        if vehicle.planner.phase == "approach":
            if vehicle.flown_line is not None:
                return []
            path = approach_path(self.scenario, self.landscape, (x_m, y_m))
            return [self._upload(vehicle, path, at_s, "fly to the fire")]
        settings = self.scenario.mission
        if not vehicle.turned and at_s - vehicle.uploaded_at_s < settings.least_upload_interval_s:
            return []
        cells = vehicle.planner.path(row, col)
        if len(cells) < 2:
            return []
        path = np.column_stack(self.landscape.xy_of(cells[:, 0], cells[:, 1]))
        why = self._why_renew(vehicle, path, x_m, y_m)
        if why is None:
            return []
        vehicle.turned = False
        return [self._upload(vehicle, path, at_s, why)]

    def _why_renew(self, vehicle: Vehicle, path: Floats, x_m: float, y_m: float) -> str | None:
        settings = self.scenario.mission
        line = vehicle.flown_line
        if line is None:
            return "no trusted mission on board"
        if vehicle.turned:
            return "turn back"
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        near = path[along <= COMPARED_SHARE * settings.horizon_m]
        if float(shapely.distance(shapely.points(near), line).max()) > settings.path_tolerance_m:
            return "the front is not where the mission leads"
        left_m = line.length - line.project(shapely.Point(x_m, y_m))
        if left_m < LEFT_SHARE * settings.horizon_m:
            return "the mission is nearly flown"
        return None

    def _upload(self, vehicle: Vehicle, path: Floats, at_s: float, why: str) -> UploadMission:
        items = mission_along(
            path,
            vehicle.planner.clockwise,
            vehicle.section,
            self.landscape,
            from_ground=not vehicle.airborne,
            landing=vehicle.landing,
        )
        mission_id = self._next_mission_id
        self._next_mission_id += 1
        line = shapely.simplify(shapely.LineString(path), LINE_TOLERANCE_M)
        vehicle.pending = Pending(mission_id, shapely.LineString(shapely.get_coordinates(line)))
        vehicle.uploaded_at_s = at_s
        return UploadMission(vehicle.section.name, mission_id, why, items)

    def _upload_finished(self, vehicle: Vehicle, event: UploadFinished) -> list[AnyCommand]:
        if vehicle.pending is None or vehicle.pending.mission_id != event.mission_id:
            return []
        pending, vehicle.pending = vehicle.pending, None
        if event.outcome == "accepted":
            return self._accepted(vehicle, pending)
        vehicle.flown_line = None
        vehicle.not_before_s = event.at_us / 1e6 + RETRY_S
        commands: list[AnyCommand] = [
            _say(
                vehicle,
                f"mission {event.mission_id} {event.outcome}: {event.reason}; "
                f"trying again in {RETRY_S:.0f} s",
                warning=True,
            )
        ]
        if vehicle.airborne and vehicle.started:
            # PX4 loiters by itself if what came is nothing it would fly. On ArduPilot what is on
            # board may be half the old mission and half the new one.
            vehicle.holding = True
            if not vehicle.atomic_upload:
                commands.append(Hold(vehicle.section.name))
        return commands

    def _accepted(self, vehicle: Vehicle, pending: Pending) -> list[AnyCommand]:
        vehicle.flown_line = pending.line
        first_start = not vehicle.started and vehicle.section.autostart
        if first_start or vehicle.holding:
            vehicle.started = True
            vehicle.holding = False
            return [StartMission(vehicle.section.name)]
        return []

    def _command_finished(self, vehicle: Vehicle, event: CommandFinished) -> list[AnyCommand]:
        if event.accepted:
            return [_say(vehicle, f"{event.command}: accepted")]
        if event.command != "start mission":
            return [_say(vehicle, f"{event.command} refused: {event.reason}", warning=True)]
        # Autopilots refuse to arm until they know where they are: ask again.
        vehicle.start_again_at_s = event.at_us / 1e6 + START_AGAIN_S
        return [
            _say(
                vehicle,
                f"start mission refused: {event.reason}; trying again in {START_AGAIN_S:.0f} s",
                warning=True,
            )
        ]

    def _rebooted(self, vehicle: Vehicle) -> list[AnyCommand]:
        """A restarted autopilot may hold any mission or none: begin with it anew."""
        vehicle.deployed = vehicle.started = vehicle.holding = vehicle.airborne = False
        vehicle.pending = vehicle.flown_line = vehicle.start_again_at_s = None
        return [_say(vehicle, "autopilot restarted: sending it to the fire again", warning=True)]


def planner_of(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> PerimeterPlanner:
    """The planner of one vehicle, in the units of the landscape's grid."""
    planner, cell_m = scenario.planner, landscape.cell_size_m
    settings = PerimeterSettings(
        rule=planner.rule,
        alpha=planner.alpha,
        clockwise_first=planner.first_direction == "clockwise",
        ignition_known=planner.ignition_known,
        baseline_s=planner.baseline_s,
        smoothing_deg=planner.smoothing_deg,
        reversal_margin=planner.reversal_margin,
        least_gain_cells=planner.least_gain_cells,
        dwell_s=planner.dwell_s,
        speed_cells_s=section.airspeed_m_s / cell_m,
        path=PathSettings(
            horizon_cells=scenario.mission.horizon_m / cell_m,
            lead_cells=scenario.mission.lead_m / cell_m,
        ),
    )
    row, col = landscape.row_col_of(*_fire_position(scenario, landscape))
    # An ignition is known as a cell; so is the centre the angles are counted from.
    centre = (float(round(float(row))), float(round(float(col))))
    return PerimeterPlanner(settings, landscape.shape, centre, _burns_from_s(scenario))


def _burns_from_s(scenario: Scenario) -> float:
    return scenario.ignition[0].at_s if scenario.ignition else scenario.fire.burning_at_s


def _fire_position(scenario: Scenario, landscape: Landscape) -> tuple[float, float]:
    """Where the crew says the fire is: the ignition point, or a point reported inside the fire."""
    planner = scenario.planner
    if planner.ignition_known:
        first = scenario.ignition[0]
        return landscape.xy_of_lat_lon(first.lat_deg, first.lon_deg)
    return landscape.xy_of_lat_lon(planner.reported_lat_deg, planner.reported_lon_deg)


def approach_path(scenario: Scenario, landscape: Landscape, start_m: tuple[float, float]) -> Floats:
    """A straight line from where the vehicle is to where the fire is said to be."""
    return np.array([start_m, _fire_position(scenario, landscape)])


def approach_mission(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """The first mission of a vehicle: take off, fly to the fire, loiter there."""
    home = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    return mission_along(
        approach_path(scenario, landscape, home),
        scenario.planner.first_direction == "clockwise",
        section,
        landscape,
        from_ground=True,
        landing=landing_of_vehicle(scenario, section, landscape),
    )


def landing_of_vehicle(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """The landing that a vehicle's missions end with, if they must; into the first wind given."""
    if not needs_landing(section):
        return ()
    wind_from_deg = scenario.weather[0].wind_from_deg if scenario.weather else 0.0
    return landing_of(section, landscape, wind_from_deg)


def _decided(vehicle: Vehicle, decision: Decision) -> Decided:
    direction: Direction = "clockwise" if decision.clockwise else "anticlockwise"
    return Decided(
        vehicle.section.name,
        direction,
        decision.reversed,
        vehicle.planner.reversals,
        decision.importance_back,
        decision.importance_front,
        decision.front_cells,
    )


def _say(vehicle: Vehicle, text: str, warning: bool = False) -> Announce:
    return Announce(vehicle.section.name, text, "warning" if warning else "info")
