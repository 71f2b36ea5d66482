"""The agents of a formation in flight: one a vehicle, each on its own map, talking in one process.

Events become what an agent knows of itself; what one says the others hear at once, in the order of
the scenario.
"""

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.commands import Say
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.events import Observed
from mission_service.fire.camera import camera_of
from mission_service.fire.setup import burning_of, fire_position
from mission_service.guidance.formation.agent import STATE_EVERY_US, Agent, Intention, Own
from mission_service.guidance.formation.by_hand import MEASURED_OVER_S, Motion, expected_orbit
from mission_service.guidance.formation.grid import grid_of
from mission_service.guidance.formation.settings import NEVER_M, Airframe, Settings
from mission_service.guidance.protocol import Decision
from mission_service.peer_messages import AnyMessage, Leaving, State
from mission_service.position_fix import Here

Cells = NDArray[np.int64]
BURNING = ord("b")
FOUR_BY_THREE = 0.75  # of a camera whose angle along the track is not given
HOT_FOR_S = 1.5  # after the last look at fire straight below


def settings_of(scenario: Scenario, section: VehicleSection) -> Settings:
    """Table 1 with what the scenario says of the formation and of this vehicle."""
    told = scenario.formation
    camera = camera_of(section)
    if camera.along_rad is None:
        along_rad = 2.0 * math.atan(FOUR_BY_THREE * math.tan(camera.across_rad / 2.0))
        camera = replace(camera, along_rad=along_rad)
    airframe = Airframe(section.least_airspeed_m_s, section.most_airspeed_m_s)
    height_m = told.apart_by_height_m
    return Settings(
        apart_by_height_m=NEVER_M if height_m is None else height_m,
        monitoring_m=told.monitoring_m,
        altitude_agl_m=section.altitude_agl_m,
        loiter_radius_m=section.loiter_radius_m,
        agent_speed_m_s=told.agent_speed_m_s,
        safety_radius_m=told.safety_radius_m,
        neighbourhood_m=told.neighbourhood_m,
        range_m=told.range_m,
        camera=camera,
        airframe=airframe,
    )


def first_fire(scenario: Scenario, landscape: Landscape) -> Cells:
    """What the base knows of the fire before the mission, as numbers of cells, in rising order.

    The fire that burns at the start where the scenario gives one, else the cell where it is said
    to be.
    """
    burning = burning_of(scenario, landscape)
    if burning is not None:
        return np.flatnonzero(np.isfinite(burning.arrival_s)).astype(np.int64)
    row, col = landscape.row_col_of(*fire_position(scenario, landscape))
    return np.array([round(float(row)) * landscape.shape[1] + round(float(col))], dtype=np.int64)


class Seat:
    """What one vehicle's events do to its agent."""

    def __init__(self, agent: Agent, formation: "Formation") -> None:
        self.agent = agent
        self.wind_m_s = (0.0, 0.0)  # it blows towards (x, y)
        self.hot_until_s = -math.inf
        self.here: Here | None = None
        self.flies = False
        self.state: State | None = None  # said last
        self.by_hand = False  # in the air, and flown by somebody else
        self.moved: deque[Motion] = deque()  # by hand, over the last second or so
        self._formation = formation

    def observe(self, observed: Observed) -> None:
        """Cells seen burning and unburned; fire straight below counts as heat.

        No autopilot tells the temperature outside.
        """
        self.correct(observed)
        middle = observed.cells[len(observed.cells) // 2][len(observed.cells[0]) // 2]
        if ord(middle) == BURNING:
            self.hot_until_s = observed.at_us / 1e6 + HOT_FOR_S

    def correct(self, observed: Observed) -> None:
        """The same by people's word; a map of burning cells takes none of them back."""
        text = "".join(observed.cells).encode("ascii")
        codes = np.frombuffer(text, dtype=np.uint8)
        width, cols = len(observed.cells[0]), self._formation.cols
        places = np.flatnonzero(codes != ord("."))
        rows, columns = np.divmod(places, width)
        cells = (observed.row + rows) * cols + observed.col + columns
        burns = codes[places] == BURNING
        self.agent.see(cells[burns], cells[~burns], observed.at_us)
        self._formation.burns(cells[burns])

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """The wind as the grid has it."""
        towards = math.radians(from_deg + 180.0)
        true_m_s = (speed_m_s * math.sin(towards), speed_m_s * math.cos(towards))
        self.wind_m_s = self._formation.on_grid(*true_m_s)

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Nothing: where it is, is for ``Formation.step``."""
        return None

    def left(self, at_s: float) -> None:
        """It has no virtual agent until it steps again."""
        if self.flies:
            self.flies = False
            self._formation.leave(self.agent.name, at_s)


class Formation:
    """All agents of a scenario."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        grid, fire = grid_of(landscape), first_fire(scenario, landscape)
        self.cols = grid.cols
        rows, columns = np.divmod(fire, grid.cols)
        self._middle = (float(rows.mean()), float(columns.mean()))
        self._cell_m = grid.cell_m
        self.centre_m = grid.xy_of(*self._middle)
        self.reach_m = self._cell_m
        self.burns(fire)
        turn = math.radians(landscape.grid_convergence_deg)
        self._cos, self._sin = math.cos(turn), math.sin(turn)
        told = scenario.formation
        self._range_m, self._near_m = told.range_m, told.neighbourhood_m
        self._talks = told.talks
        self._said: list[Say] = []
        self._lost: set[str] = set()
        at_us = round(scenario.start_s * 1e6)
        self.seats: dict[str, Seat] = {
            section.name: Seat(
                Agent(
                    section.name,
                    settings_of(scenario, section),
                    grid,
                    fire,
                    at_us,
                    told.avoidance,
                    told.synchronises,
                ),
                self,
            )
            for section in scenario.flown
        }

    def burns(self, cells: Cells) -> None:
        """Cells that burn: ``reach_m`` is how far from ``centre_m`` the fire is known to be."""
        if cells.size:
            rows, cols = np.divmod(cells, self.cols)
            off = np.hypot(rows - self._middle[0], cols - self._middle[1])
            self.reach_m = max(self.reach_m, float(off.max()) * self._cell_m)

    def on_grid(self, east_m_s: float, north_m_s: float) -> tuple[float, float]:
        """A velocity by true north as (x, y) of the grid, whose north may be another."""
        return (
            east_m_s * self._cos - north_m_s * self._sin,
            east_m_s * self._sin + north_m_s * self._cos,
        )

    def step(self, name: str, here: Here) -> Intention:
        """A vehicle of the formation is here now; what it means to fly, told to the others."""
        seat = self.seats[name]
        seat.here, seat.flies, seat.by_hand = here, True, False
        velocity_m_s = self.on_grid(here.east_m_s, here.north_m_s)
        own = Own(
            round(here.at_s * 1e6),
            here.x_m,
            here.y_m,
            here.altitude_m,
            *velocity_m_s,
            math.dist(velocity_m_s, seat.wind_m_s),
            *seat.wind_m_s,
            here.at_s < seat.hot_until_s,
        )
        self._lost.discard(name)
        intention = seat.agent.step(own)
        self._hand_on(seat, own.at_us)
        return intention

    def watch(self, name: str, here: Here) -> None:
        """Somebody else flies this vehicle: the others are told where, twice a second."""
        seat = self.seats[name]
        velocity_m_s = self.on_grid(here.east_m_s, here.north_m_s)
        if not seat.by_hand:
            seat.left(here.at_s)
            seat.by_hand, seat.state = True, None
            seat.moved.clear()
        seat.here = here
        seat.moved.append((here.at_s, here.x_m, here.y_m, *velocity_m_s))
        while len(seat.moved) > 2 and seat.moved[1][0] <= here.at_s - MEASURED_OVER_S:
            seat.moved.popleft()
        at_us = round(here.at_s * 1e6)
        if seat.state is not None and at_us - seat.state.at_us < STATE_EVERY_US:
            return
        radius_m = seat.agent.settings.loiter_radius_m
        orbit = expected_orbit(seat.moved[0], seat.moved[-1], radius_m)
        speed_m_s = math.dist(velocity_m_s, seat.wind_m_s)
        place = (here.x_m, here.y_m, here.altitude_m, *velocity_m_s)
        seat.state = State(at_us, name, *place, None, None, *orbit, speed_m_s, settled=False)
        self._tell(seat, seat.state)

    def is_near_others(self, name: str) -> bool:
        """Whether another of the formation is in its neighbourhood."""
        here = self.seats[name].here
        return here is not None and any(
            (other.flies or other.by_hand)
            and other.here is not None
            and name != other_name
            and math.dist((here.x_m, here.y_m), (other.here.x_m, other.here.y_m)) < self._near_m
            for other_name, other in self.seats.items()
        )

    def leave(self, name: str, at_s: float) -> None:
        """A vehicle is not of the formation now: on its way home, lost, or on the ground."""
        seat, at_us = self.seats[name], round(at_s * 1e6)
        seat.agent.leave(at_us, "left")
        self._hand_on(seat, at_us)

    def lost(self, name: str) -> None:
        """The link of a vehicle is lost: it has no agent, but the others mind where it must be."""
        state = self.seats[name].state
        if state is not None:
            self._lost.add(name)
            self._tell(self.seats[name], state)

    def not_lost(self, name: str, at_us: int) -> None:
        """It is known to fly otherwise, or not at all."""
        seat = self.seats[name]
        if name in self._lost or seat.by_hand:
            self._lost.discard(name)
            seat.by_hand = False
            self._tell(seat, Leaving(at_us, name, "flies otherwise"))

    def hear(self, name: str, message: AnyMessage) -> None:
        """A vehicle hears another: everything, but of states only those within range.

        Raises MissionServiceError for cells that are not on the map: then nothing has changed.
        """
        seat = self.seats[name]
        if isinstance(message, State) and seat.here is not None:
            here_m = (seat.here.x_m, seat.here.y_m)
            if math.dist(here_m, (message.x_m, message.y_m)) > self._range_m:
                return
        seat.agent.hear(message)

    def said(self) -> list[Say]:
        """What those of other processes are to be told since the last call."""
        said, self._said = self._said, []
        return said

    def _hand_on(self, seat: Seat, at_us: int) -> None:
        """What its agent has to say, to all others."""
        for message in seat.agent.messages(at_us):
            if isinstance(message, State):
                seat.state = message
            self._tell(seat, message)

    def _tell(self, seat: Seat, message: AnyMessage) -> None:
        if self._talks:
            self._said.append(Say(seat.agent.name, message))
        for name, other in self.seats.items():
            if other is not seat:
                self.hear(name, message)
