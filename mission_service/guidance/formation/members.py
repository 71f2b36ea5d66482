"""The agents of a formation that one process runs: one agent, with its own map, per vehicle.

Events are the inputs of the agents. An agent's messages reach the other agents without delay, in
the order in which the scenario lists the vehicles.
"""

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.commands import BroadcastMessage
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.events import Observed
from mission_service.fire.camera import camera_of
from mission_service.fire.scenario_fire import burning_of, fire_position
from mission_service.guidance.formation.agent import STATE_EVERY_US, Agent, Intention, OwnState
from mission_service.guidance.formation.manual_control import (
    MEASURED_OVER_S,
    ObservedMotion,
    expected_orbit,
)
from mission_service.guidance.formation.map_grid import map_grid_of
from mission_service.guidance.formation.settings import NEVER_M, Airframe, Settings
from mission_service.guidance.protocol import Decision
from mission_service.peer_messages import AnyMessage, Leaving, State
from mission_service.position_fix import PositionFix

Cells = NDArray[np.int64]
BURNING = ord("b")
ASPECT_RATIO = 0.75  # height-to-width ratio of images, if the angle along the track is unknown
HOT_FOR_S = 1.5  # heat is assumed for this time after the last view of fire directly below


def settings_of(scenario: Scenario, section: VehicleSection) -> Settings:
    """Return a vehicle's settings: the scenario's values, or else those in the paper's table 1."""
    shared = scenario.formation
    camera = camera_of(section)
    if camera.along_rad is None:
        along_rad = 2.0 * math.atan(ASPECT_RATIO * math.tan(camera.across_rad / 2.0))
        camera = replace(camera, along_rad=along_rad)
    height_m = shared.vertical_separation_m
    return Settings(
        vertical_separation_m=NEVER_M if height_m is None else height_m,
        lossy_layers=shared.lossy_layers,
        monitoring_m=shared.monitoring_m,
        altitude_agl_m=section.altitude_agl_m,
        loiter_radius_m=section.loiter_radius_m,
        agent_speed_m_s=shared.agent_speed_m_s,
        safety_radius_m=shared.safety_radius_m,
        neighbourhood_m=shared.neighbourhood_m,
        range_m=shared.range_m,
        camera=camera,
        airframe=Airframe(section.min_airspeed_m_s, section.max_airspeed_m_s),
    )


def first_fire(scenario: Scenario, landscape: Landscape) -> Cells:
    """Return the indices, in ascending order, of the cells that burn on all maps at the start.

    These cells are the initial fire if the scenario defines one, or else the cell where the fire
    was reported.
    """
    burning = burning_of(scenario, landscape)
    if burning is not None:
        return np.flatnonzero(np.isfinite(burning.arrival_s)).astype(np.int64)
    row, col = landscape.row_col_of(*fire_position(scenario, landscape))
    return np.array([round(float(row)) * landscape.shape[1] + round(float(col))], dtype=np.int64)


class FormationMember:
    """One vehicle of the formation: its agent, and the vehicle's state as reported by events."""

    def __init__(self, agent: Agent, formation: "Formation") -> None:
        self.agent = agent
        self.wind_m_s = (0.0, 0.0)  # wind towards (x, y)
        self.hot_until_s = -math.inf
        self.fix: PositionFix | None = None
        self.flies = False
        self.state: State | None = None  # last state sent
        self.manual_control = False  # whether the vehicle flies without control by its agent
        self.recent: deque[ObservedMotion] = deque()  # motion during the last ``MEASURED_OVER_S``
        self._formation = formation

    def observe(self, observed: Observed) -> None:
        """Update the agent's map from a camera window; fire directly below counts as heat.

        The view replaces the outside temperature, which autopilots do not report.
        """
        self.correct(observed)
        below = observed.cells[len(observed.cells) // 2][len(observed.cells[0]) // 2]
        if ord(below) == BURNING:
            self.hot_until_s = observed.at_us / 1e6 + HOT_FOR_S

    def correct(self, observed: Observed) -> None:
        """Apply an operator's correction to the agent's map."""
        codes = np.frombuffer("".join(observed.cells).encode("ascii"), dtype=np.uint8)
        places = np.flatnonzero(codes != ord("."))
        rows, columns = np.divmod(places, len(observed.cells[0]))
        cells = (observed.row + rows) * self._formation.cols + observed.col + columns
        burns = codes[places] == BURNING
        self.agent.add_view(cells[burns], cells[~burns], observed.at_us)
        self._formation.burns(cells[burns])

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Set the measured wind, converted from true north to the grid's axes."""
        towards = math.radians(from_deg + 180.0)
        true_m_s = (speed_m_s * math.sin(towards), speed_m_s * math.cos(towards))
        self.wind_m_s = self._formation.on_grid(*true_m_s)

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Do nothing: ``Formation.step_agent`` receives the positions."""
        return None

    def left(self, at_s: float) -> None:
        """Leave the formation until the next ``Formation.step_agent``."""
        if self.flies:
            self.flies = False
            self._formation.leave(self.agent.name, at_s)


class Formation:
    """The formation, with all agents of a scenario."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        grid, fire = map_grid_of(landscape), first_fire(scenario, landscape)
        self.cols = grid.cols
        rows, columns = np.divmod(fire, grid.cols)
        self._centre_row_col = (float(rows.mean()), float(columns.mean()))
        self._cell_m = grid.cell_m
        self.centre_m = grid.xy_of(*self._centre_row_col)
        self.reach_m = self._cell_m
        self.burns(fire)
        turn = math.radians(landscape.grid_convergence_deg)
        self._cos, self._sin = math.cos(turn), math.sin(turn)
        shared = scenario.formation
        self._range_m, self._near_m = shared.range_m, shared.neighbourhood_m
        self._peer_messaging = shared.peer_messaging
        self._outgoing: list[BroadcastMessage] = []
        self._lost: set[str] = set()
        at_us = round(scenario.start_s * 1e6)
        team = [section.name for section in scenario.vehicles]
        self.members: dict[str, FormationMember] = {
            section.name: FormationMember(
                Agent(
                    *(section.name, settings_of(scenario, section), grid, fire, at_us),
                    *(shared.avoidance, shared.synchronises, team),
                ),
                self,
            )
            for section in scenario.flown
        }
        if shared.peer_messaging:
            for member in self.members.values():
                member.agent.wait_for(set(team) - set(self.members))

    def burns(self, cells: Cells) -> None:
        """Extend ``reach_m``, the greatest distance of fire from ``centre_m``, to include cells."""
        if cells.size:
            rows, cols = np.divmod(cells, self.cols)
            off = np.hypot(rows - self._centre_row_col[0], cols - self._centre_row_col[1])
            self.reach_m = max(self.reach_m, float(off.max()) * self._cell_m)

    def on_grid(self, east_m_s: float, north_m_s: float) -> tuple[float, float]:
        """Convert a velocity relative to true north to the grid's axes (x, y)."""
        return (
            east_m_s * self._cos - north_m_s * self._sin,
            east_m_s * self._sin + north_m_s * self._cos,
        )

    def step_agent(self, name: str, fix: PositionFix) -> Intention:
        """Advance a vehicle's agent, and send its messages; return the agent's intention."""
        member = self.members[name]
        member.fix, member.flies, member.manual_control = fix, True, False
        velocity_m_s = self.on_grid(fix.east_m_s, fix.north_m_s)
        own = OwnState(
            *(round(fix.at_s * 1e6), fix.x_m, fix.y_m, fix.altitude_m),
            *velocity_m_s,
            math.dist(velocity_m_s, member.wind_m_s),
            *member.wind_m_s,
            fix.at_s < member.hot_until_s,
        )
        self._lost.discard(name)
        intention = member.agent.step(own)
        self._publish(member, own.at_us)
        return intention

    def track_manual(self, name: str, fix: PositionFix) -> None:
        """Send the state of a manually controlled vehicle to the others, at most twice a second."""
        member = self.members[name]
        velocity_m_s = self.on_grid(fix.east_m_s, fix.north_m_s)
        if not member.manual_control:
            member.left(fix.at_s)
            member.manual_control, member.state = True, None
            member.recent.clear()
        member.fix = fix
        member.recent.append((fix.at_s, fix.x_m, fix.y_m, *velocity_m_s))
        while len(member.recent) > 2 and member.recent[1][0] <= fix.at_s - MEASURED_OVER_S:
            member.recent.popleft()
        at_us = round(fix.at_s * 1e6)
        if member.state is not None and at_us - member.state.at_us < STATE_EVERY_US:
            return
        radius_m = member.agent.settings.loiter_radius_m
        orbit = expected_orbit(member.recent[0], member.recent[-1], radius_m)
        speed_m_s = math.dist(velocity_m_s, member.wind_m_s)
        place = (fix.x_m, fix.y_m, fix.altitude_m, *velocity_m_s)
        member.state = State(at_us, name, *place, None, None, *orbit, speed_m_s, settled=False)
        self._send(member, member.state)

    def is_near_others(self, name: str) -> bool:
        """Return whether another vehicle of the formation is in this vehicle's neighbourhood."""
        fix = self.members[name].fix
        return fix is not None and any(
            (other.flies or other.manual_control)
            and other.fix is not None
            and name != other_name
            and math.dist((fix.x_m, fix.y_m), (other.fix.x_m, other.fix.y_m)) < self._near_m
            for other_name, other in self.members.items()
        )

    def leave(self, name: str, at_s: float) -> None:
        """Remove a vehicle that is lost, on the ground, or in its autopilot's return mode."""
        member, at_us = self.members[name], round(at_s * 1e6)
        member.agent.leave(at_us, "left")
        self._publish(member, at_us)

    def on_link_lost(self, name: str) -> None:
        """Send the last state of a vehicle, so that the others avoid it by dead reckoning."""
        state = self.members[name].state
        if state is not None:
            self._lost.add(name)
            self._send(self.members[name], state)

    def end_tracking(self, name: str, at_us: int) -> None:
        """End the dead reckoning and the manual tracking of a vehicle."""
        member = self.members[name]
        if name in self._lost or member.manual_control:
            self._lost.discard(name)
            member.manual_control = False
            self._send(member, Leaving(at_us, name, "tracking ended"))

    def deliver(self, name: str, message: AnyMessage) -> None:
        """Deliver a message to a vehicle's agent, except a state from beyond radio range.

        Raises MissionServiceError, and changes nothing, if a cell is not on the map.
        """
        member = self.members[name]
        if isinstance(message, State) and member.fix is not None:
            distance_m = math.dist((member.fix.x_m, member.fix.y_m), (message.x_m, message.y_m))
            if distance_m > self._range_m:
                return
        member.agent.on_message(message)

    def outgoing(self) -> list[BroadcastMessage]:
        """Return the messages to other processes that have been sent since the last call."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def _publish(self, member: FormationMember, at_us: int) -> None:
        """Send the messages of a member's agent to all other agents."""
        for message in member.agent.messages(at_us):
            if isinstance(message, State):
                member.state = message
            self._send(member, message)

    def _send(self, member: FormationMember, message: AnyMessage) -> None:
        if self._peer_messaging:
            self._outgoing.append(BroadcastMessage(member.agent.name, message))
        for name, other in self.members.items():
            if other is not member:
                self.deliver(name, message)
