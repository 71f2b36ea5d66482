"""The agent of one UAV in the formation: the maps, the virtual agent, and the intended orbit.

Each UAV has one agent. The inputs of an agent are the views from the UAV's camera and the messages
received. ``step`` is called for each position of the UAV, and returns an ``Intention``, which is an
orbit and an airspeed. An ideal simulation computes the motion on this orbit. In flight, the orbit
is sent to the autopilot as an orbit command, or as a loiter item in a mission.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.formation.agent_maps import AgentMaps
from mission_service.guidance.formation.coverage import AgentMover
from mission_service.guidance.formation.intent_avoidance import (
    AdoptedOrbit,
    IntendedOrbit,
    OwnMotion,
    avoidance_rules,
    choose_orbit,
    layer_m,
    layered_rules,
)
from mission_service.guidance.formation.link_quality import LinkQuality
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.orbit_phase_kernels import (
    airspeed_in_phase_m_s,
    is_on_orbit,
)
from mission_service.guidance.formation.peer_table import PeerTable, priority_key, recent
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.shared_map import SharedMap
from mission_service.peer_messages import AnyMessage, Goal, Leaving, State

Floats = NDArray[np.float64]
Cells = NDArray[np.int64]
NO_CELLS: Cells = np.empty(0, dtype=np.int64)
Avoidance = Literal["intent", "rvo", "none"]

STATE_EVERY_US = 500_000
GOAL_EVERY_US = 5_000_000
RESEND_M = 20.0  # if the orbit moves farther, the state is sent at once
MAX_STEP_S = 1.0
MAX_WAIT_US = 30_000_000
SETTLED_M, SETTLED_FOR_S = 10.0, 20.0
NOWHERE = (math.nan, math.nan)
COOL_FOR_S = 20.0  # time at the higher altitude after heat was last detected


@dataclass(frozen=True, slots=True)
class OwnState:
    """The state of the agent's own UAV.

    The velocity is over the ground. The wind is the velocity of the air. Both have x (east) and y
    (north) components.
    """

    at_us: int
    x_m: float
    y_m: float
    altitude_amsl_m: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    airspeed_m_s: float
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0
    hot: bool = False


@dataclass(frozen=True, slots=True)
class Intention:
    """The orbit and the airspeed that a UAV intends to fly.

    The radius is signed as in MAVLink (negative: anticlockwise). ``climb_m`` is the height above
    the normal altitude, to avoid heat or to fly in an altitude layer. ``settled`` is true if the
    UAV has been on the same orbit for ``SETTLED_FOR_S``. During a return home the virtual agent's
    position is NaN.
    """

    orbit_x_m: float
    orbit_y_m: float
    orbit_radius_m: float
    airspeed_m_s: float
    climb_m: float
    settled: bool
    agent_x_m: float
    agent_y_m: float
    in_conflict: bool = False  # another UAV prevents the desired orbit


class Agent:
    """The agent of one UAV; ``name`` determines the priority in a conflict between two UAVs."""

    def __init__(
        self,
        name: str,
        settings: Settings,
        grid: MapGrid,
        fire: Cells,
        at_us: int,
        avoidance: Avoidance = "intent",
        synchronises: bool = True,
        team: Sequence[str] = (),
    ) -> None:
        """Create an agent; ``fire`` holds the cells that burn on the maps of all UAVs at ``at_us``.

        ``team`` lists all UAVs in the order of their altitude layers, lowest first. The layers are
        used while many messages are lost. Raises MissionServiceError if a cell is not on the grid.
        """
        self.name = name
        self.settings = settings
        self.grid = grid
        self.peers = PeerTable()
        self.map = SharedMap(name, grid.shape)
        self.maps = AgentMaps(
            grid.shape,
            grid.cell_m,
            settings.augmentation_m(grid.cell_m),
            settings.agent_area_m,
            settings.monitoring_m,
        )
        self.avoidance = avoidance
        self.synchronises = synchronises
        self.agent_m: tuple[float, float] | None = None
        self.home_m: tuple[float, float] | None = None  # set during the return home
        # The avoidance rules for good links, and for lossy links.
        self._rules = avoidance_rules(settings), layered_rules(settings)
        self._key = priority_key(name)
        self._mover = AgentMover(settings, grid, self._key)
        self._choice: AdoptedOrbit | None = None
        self._settled_m = (math.inf, math.inf)
        self._settled_at_us = at_us
        self._stepped_at_us = at_us
        self._state_due_us = self._goal_due_us = at_us
        self._step_s = 0.0
        self._cool_at_us = at_us
        self._climb_m = 0.0
        self._links = LinkQuality()
        layer = team.index(name) % settings.lossy_layers if name in team else 0
        self._layer_m = layer * layer_m(settings)
        self._layer_climb_m = 0.0
        self._states_sent = 0
        self._awaited: set[str] = set()
        self._wait_until_us: int | None = None
        self._sent_orbit_m = (math.inf, math.inf)
        self._sent_goal_m: tuple[float, float] | None = None
        self._outbox: list[AnyMessage] = []
        self.map.set_initial(fire, at_us)
        self.maps.set(fire, NO_CELLS)

    def wait_for(self, names: Collection[str]) -> None:
        """Keep the virtual agent in place until each of these other UAVs has sent a message.

        The agent waits for at most ``MAX_WAIT_US`` after its first step.
        """
        self._awaited = set(names) - {self.name}

    # Inputs -----------------------------------------------------------------------------------

    def on_message(self, message: AnyMessage) -> None:
        """Apply a message from another UAV."""
        self._awaited.discard(message.sender)
        match message:
            case State():
                self.peers.apply_state(message)
                self._links.store(message)
            case Goal():
                self.peers.apply_goal(message)
            case Leaving():
                self.peers.remove(message.sender)
            case _:
                self.maps.set(*self.map.on_message(message))

    def add_view(self, burning: Cells, unburned: Cells, at_us: int) -> None:
        """Apply a camera view, given as the indices of the burning and of the unburned cells."""
        self.maps.set(*self.map.add_view(burning, unburned, at_us))

    # Outputs ----------------------------------------------------------------------------------

    def step(self, own: OwnState) -> Intention:
        """Advance the agent to the UAV's current state; return the UAV's intention."""
        self._step_s = min((own.at_us - self._stepped_at_us) / 1e6, MAX_STEP_S)
        self._stepped_at_us = own.at_us
        peers = self.peers.rows(own.at_us)
        if self.home_m is None:
            self._move_agent(own)
        return self._intend(own, peers)

    def messages(self, at_us: int) -> list[AnyMessage]:
        """Return the messages to send now."""
        outbox, self._outbox = self._outbox, []
        return [*outbox, *self.map.messages(at_us)]

    def leave(self, at_us: int, why: str) -> None:
        """Leave the formation until the next ``step``; ``why`` is sent to the other UAVs."""
        self.agent_m = self._choice = None
        self._outbox.append(Leaving(at_us, self.name, why))

    def go_home(self, x_m: float, y_m: float) -> None:
        """Intend an orbit around home (x, y) from now on, without a virtual agent."""
        self.home_m, self.agent_m = (x_m, y_m), None

    def come_back(self) -> None:
        """End ``go_home``: the virtual agent starts again near the UAV."""
        self.home_m = None

    # The virtual agent ------------------------------------------------------------------------

    def _move_agent(self, own: OwnState) -> None:
        """Start the virtual agent ahead of its UAV if necessary, and move it (eqs. 4 and 12)."""
        settings, agent_m, step_s = self.settings, self.agent_m, self._step_s
        if agent_m is None or math.dist(agent_m, (own.x_m, own.y_m)) > settings.restart_m:
            yaw_rad = math.atan2(own.velocity_y_m_s, own.velocity_x_m_s)
            agent_m = (
                own.x_m + settings.loiter_radius_m * math.cos(yaw_rad),
                own.y_m + settings.loiter_radius_m * math.sin(yaw_rad),
            )
        if self._waits_for_team(own.at_us):
            self.agent_m = agent_m
            return
        others = self.peers.goals(own.at_us)
        east_m_s, north_m_s = self._mover.velocity(
            own.at_us / 1e6, *agent_m, others, self.maps, step_s
        )
        self.agent_m = (agent_m[0] + east_m_s * step_s, agent_m[1] + north_m_s * step_s)

    def _waits_for_team(self, at_us: int) -> bool:
        """Return whether the agent is waiting for the first states from its team."""
        if self._wait_until_us is None:
            self._wait_until_us = at_us + MAX_WAIT_US
        return bool(self._awaited) and at_us < self._wait_until_us

    # Intention --------------------------------------------------------------------------------

    def _intend(self, own: OwnState, peers: Floats) -> Intention:
        climb_m = self._climb(own)
        orbit, conflict = self._orbit(own, peers), False
        if self.avoidance == "intent":
            heading_rad = math.atan2(
                own.velocity_y_m_s - own.wind_y_m_s, own.velocity_x_m_s - own.wind_x_m_s
            )
            motion = OwnMotion(
                *(self._key, own.x_m, own.y_m, own.altitude_amsl_m, self._planned_m(own)),
                *(heading_rad, own.airspeed_m_s, own.wind_x_m_s, own.wind_y_m_s),
            )
            held = self._choice or AdoptedOrbit(orbit)
            self._choice = choose_orbit(
                *(own.at_us / 1e6, motion, orbit, held, peers, self._rules[self._links.lossy]),
                self._waits_for_team(own.at_us),
            )
            orbit, conflict = self._choice.orbit, self._choice.in_conflict
        intention = Intention(
            orbit.x_m,
            orbit.y_m,
            orbit.radius_m,
            orbit.airspeed_m_s,
            climb_m,
            self._is_settled(own, orbit),
            *(self.agent_m or NOWHERE),
            conflict,
        )
        self._queue_state(own, intention)
        return intention

    def _orbit(self, own: OwnState, peers: Floats) -> IntendedOrbit:
        """Return the orbit around the virtual agent, in phase with other UAVs (section 5.3.2)."""
        airframe, radius_m = self.settings.airframe, -self.settings.loiter_radius_m
        centre_m = self.home_m or self.agent_m
        assert centre_m is not None
        airspeed_m_s = airframe.cruise_m_s
        if self.synchronises and not self._waits_for_team(own.at_us):
            airspeed_m_s = airspeed_in_phase_m_s(
                *(own.x_m, own.y_m, *centre_m, radius_m),
                *(self._key, recent(peers), self.settings.range_m),
                *(airframe.min_airspeed_m_s, airframe.max_airspeed_m_s),
                math.hypot(own.wind_x_m_s, own.wind_y_m_s),
            )
        return IntendedOrbit(*centre_m, radius_m, airspeed_m_s)

    def _climb(self, own: OwnState) -> float:
        """Return the height above the normal altitude: for heat (section 5.3.3) and for layers."""
        step_m = self.settings.airframe.climb_m_s * self._step_s
        if own.hot:
            self._cool_at_us = own.at_us + round(COOL_FOR_S * 1e6)
        if own.at_us < self._cool_at_us:
            self._climb_m += step_m if own.hot else 0.0
        else:
            self._climb_m = max(self._climb_m - step_m, 0.0)
        off_m = self._layer_target_m - self._layer_climb_m
        self._layer_climb_m += min(max(off_m, -step_m), step_m)
        return self._climb_m + self._layer_climb_m

    @property
    def _layer_target_m(self) -> float:
        return self._layer_m if self._links.lossy else 0.0

    def _planned_m(self, own: OwnState) -> float:
        """Return the UAV's altitude once it has reached its layer."""
        return own.altitude_amsl_m + self._layer_target_m - self._layer_climb_m

    def _is_settled(self, own: OwnState, orbit: IntendedOrbit) -> bool:
        if math.dist(self._settled_m, (orbit.x_m, orbit.y_m)) > SETTLED_M:
            self._settled_m, self._settled_at_us = (orbit.x_m, orbit.y_m), own.at_us
        if not is_on_orbit(own.x_m, own.y_m, orbit.x_m, orbit.y_m, orbit.radius_m):
            self._settled_at_us = own.at_us
        return own.at_us - self._settled_at_us >= SETTLED_FOR_S * 1e6

    def _queue_state(self, own: OwnState, intention: Intention) -> None:
        """Queue the state if it is due, or at once if the orbit or the goal has changed."""
        orbit_m = (intention.orbit_x_m, intention.orbit_y_m)
        goal_m = self.agent_m and self._mover.goal_m
        goal_changed = goal_m != self._sent_goal_m
        changed = math.dist(self._sent_orbit_m, orbit_m) > RESEND_M or goal_changed
        if own.at_us < self._state_due_us and not changed:
            return
        self._sent_orbit_m, self._sent_goal_m = orbit_m, goal_m
        self._state_due_us = own.at_us + STATE_EVERY_US
        agent_x_m, agent_y_m = self.agent_m or (None, None)
        goal_x_m, goal_y_m = goal_m or (None, None)
        state = State(
            *(own.at_us, self.name, own.x_m, own.y_m, own.altitude_amsl_m),
            *(own.velocity_x_m_s, own.velocity_y_m_s, agent_x_m, agent_y_m),
            *(*orbit_m, intention.orbit_radius_m, intention.airspeed_m_s),
            intention.settled,
            goal_x_m=goal_x_m,
            goal_y_m=goal_y_m,
            planned_altitude_amsl_m=self._planned_m(own),
            number=self._states_sent,
        )
        self._states_sent += 1
        self._outbox.append(state)
        if goal_m and (goal_changed or own.at_us >= self._goal_due_us):
            self._goal_due_us = own.at_us + GOAL_EVERY_US
            self._outbox.append(Goal(own.at_us, self.name, *goal_m))
