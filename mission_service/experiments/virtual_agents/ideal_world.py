"""Simulate a formation in an ideal world, with equations of motion and a radio but no autopilots.

Agents receive inputs only from their cameras and the radio. The six metrics of the paper (section
6.2) are computed from the true fire and the true positions.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mission_service.experiments.virtual_agents.camera_footprint import (
    Footprint,
    changed_cells,
    mark_seen,
)
from mission_service.experiments.virtual_agents.ideal_world_kernels import (
    count_meetings,
    desired_headings,
    fly_all,
)
from mission_service.experiments.virtual_agents.monitoring import MonitoringArea, inaccuracy_cells
from mission_service.experiments.virtual_agents.rvo_kernels import clear_heading_rad
from mission_service.experiments.virtual_agents.scenarios import CELL_M
from mission_service.guidance.formation.agent import Agent, Avoidance, Intention, OwnState
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.peer_table import recent
from mission_service.guidance.formation.settings import Settings
from mission_service.peer_messages import AnyMessage, State

Floats = NDArray[np.float64]

TICK_S = 0.25
LOOK_EVERY_S = 1.0
MEASURE_EVERY_S = 5.0
TRACK_EVERY_S = 1.0
BASE_M = (-1400.0, -1400.0)  # start of the first UAV, relative to the map's centre
QUEUE_M = 70.0  # spacing of UAVs in a queue, and of queues
QUEUE = 8  # number of UAVs in a queue


@dataclass(frozen=True, slots=True)
class Rules:
    """The differences between a flight and the paper's nominal flight."""

    avoidance: Avoidance = "intent"
    synchronises: bool = True
    # Fraction of messages that are lost, per receiver.
    loss_at: Callable[[float], float] = lambda at_s: 0.0
    delay_s: float = TICK_S
    wind_m_s: tuple[float, float] = (0.0, 0.0)  # velocity of the air towards (east, north)
    duration_s: float = 1200.0
    # The start and the end of each UAV's absence from the formation.
    away_s: dict[int, tuple[float, float]] = field(default_factory=dict)
    # The time at which each UAV's agent fails.
    dead_from_s: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Flight:
    """The measurements of a flight.

    ``series`` contains each metric by name at the times ``series_s``; counts are cumulative.
    """

    arrival_s: Floats
    series_s: Floats
    series: dict[str, Floats]
    track_s: Floats
    uavs_m: Floats  # (times, UAVs, 2) positions relative to the map's centre
    agents_m: Floats
    closest_m: float

    def at_end(self, name: str, last_s: float) -> float:
        """Return the mean of a metric over the last ``last_s`` seconds."""
        return float(self.series[name][self.series_s >= self.series_s[-1] - last_s].mean())


class Radio:
    """The messages in transit.

    A state reaches the receivers in range; any other message reaches every receiver.
    """

    def __init__(self, count: int, rules: Rules, range_m: float, seed: int) -> None:
        self._uavs = np.arange(count)
        self._rules = rules
        self._range_m = range_m
        self._rng = np.random.default_rng((seed, 1))
        self._in_transit: deque[tuple[float, AnyMessage, list[int]]] = deque()

    def transmit(self, sender: int, message: AnyMessage, at_s: float, places_m: Floats) -> None:
        """Send a message from a UAV; ``places_m`` (n, 2) are the positions of all UAVs."""
        receives = self._uavs != sender
        if isinstance(message, State):
            off_m = places_m - places_m[sender]
            receives &= np.hypot(off_m[:, 0], off_m[:, 1]) <= self._range_m
        loss = self._rules.loss_at(at_s)
        if loss > 0.0:
            receives &= self._rng.random(len(receives)) >= loss
        receivers = np.flatnonzero(receives).tolist()
        self._in_transit.append((at_s + self._rules.delay_s, message, receivers))

    def arrived(self, at_s: float) -> Iterator[tuple[int, AnyMessage]]:
        """Yield the receiver and the message for each message that arrives now."""
        while self._in_transit and self._in_transit[0][0] <= at_s + 1e-9:
            _, message, receivers = self._in_transit.popleft()
            for receiver in receivers:
                yield receiver, message


class Safety:
    """The counts of conflicts and collisions between pairs of UAVs (section 5.3.3).

    A conflict or a collision is counted when it begins. In a conflict, the velocity with which one
    UAV would follow its virtual agent is inside the reciprocal velocity obstacle of the other UAV.
    In a collision, the distance between the two UAVs is less than twice the safety radius.
    """

    def __init__(self, uavs: int, settings: Settings) -> None:
        self._settings = settings
        self._in_conflict_s = np.full((uavs, uavs), -np.inf)
        self._together = np.zeros((uavs, uavs), dtype=np.bool_)
        self.conflicts = 0
        self.collisions = 0
        self.closest_m = math.inf

    def look(self, at_s: float, places_m: Floats, velocities_m_s: Floats, desired_m_s: Floats,
        heights_m: Floats) -> None:  # fmt: skip
        """Count the conflicts and collisions that begin now; arrays have one row per vehicle."""
        conflicts, collisions, closest_m = count_meetings(
            at_s, places_m, velocities_m_s, desired_m_s, heights_m,
            2.0 * self._settings.safety_radius_m, self._settings.neighbourhood_m,
            self._in_conflict_s, self._together,
        )  # fmt: skip
        self.conflicts += conflicts
        self.collisions += collisions
        self.closest_m = min(self.closest_m, closest_m)


class FormationWorld:
    """The fire, the vehicles, their agents and the radio.

    ``tick`` advances the whole world by a quarter of a second.
    """

    def __init__(
        self, arrival_s: Floats, uavs: int, settings: Settings, rules: Rules, seed: int
    ) -> None:
        """Set up the world from the arrival times (y, x) of the fire.

        Cells that burn at the start have arrival times of 0 or less. The UAVs are in the air, in
        queues of eight, and fly towards the centre of the map. Cells have the paper's size. All
        maps contain the cells that burn at 0 s, as if the ground base had sent these cells.
        """
        self.grid = world_grid(arrival_s.shape)
        self.arrival_s = arrival_s
        self.settings = settings
        self.rules = rules
        self.at_s = 0.0
        self.ticks = 0
        burning = np.flatnonzero(arrival_s <= 0.0)
        names = [f"uav{number}" for number in range(uavs)]
        nominal = (settings, self.grid, burning, 0, rules.avoidance, rules.synchronises)
        self.agents = [Agent(name, *nominal, names) for name in names]
        for agent in self.agents:
            agent.wait_for(names)
        self.radio = Radio(uavs, rules, settings.range_m, seed)
        self.places_m = np.array([_start(number) for number in range(uavs)])
        self.motion = np.tile([math.pi / 4.0, settings.airframe.cruise_m_s], (uavs, 1))
        through_air_m_s = np.full((uavs, 2), settings.airframe.cruise_m_s * math.sqrt(0.5))
        self.velocities_m_s = through_air_m_s + rules.wind_m_s
        self.layers_m = np.zeros(uavs)  # height of each UAV above the common altitude
        self.heights_m = np.full(uavs, settings.altitude_agl_m)
        self.intentions: list[Intention] = []
        self.safety = Safety(uavs, settings)
        self.seen_s = np.full(arrival_s.shape, -np.inf)

    def tick(self) -> None:
        """Advance the world by a quarter of a second: receive, observe, decide, send, fly."""
        self.ticks += 1
        self.at_s = self.ticks * TICK_S
        at_us = round(self.at_s * 1e6)
        for receiver, message in self.radio.arrived(self.at_s):
            if not self._is_dead(receiver):
                self.agents[receiver].on_message(message)
        looks = round(LOOK_EVERY_S / TICK_S)
        before, self.intentions = self.intentions, []
        for number, agent in enumerate(self.agents):
            if self._is_dead(number):
                self.intentions.append(replace(before[number], agent_x_m=math.nan))
                continue
            self._send_away(number, agent)
            if (self.ticks + number) % looks == 0:
                self._look(number, agent, at_us)
            self.intentions.append(agent.step(self._own(number, at_us)))
            for message in agent.messages(at_us):
                self.radio.transmit(number, message, self.at_s, self.places_m)
        self._fly()
        self._look_at_safety()

    def _is_dead(self, number: int) -> bool:
        return self.at_s >= self.rules.dead_from_s.get(number, math.inf)

    def _send_away(self, number: int, agent: Agent) -> None:
        """Send a UAV to its base, or back to the formation, at the times in ``Rules.away_s``."""
        from_s, until_s = self.rules.away_s.get(number, (math.inf, math.inf))
        if from_s <= self.at_s < until_s and agent.home_m is None:
            agent.go_home(*_start(number))
        elif self.at_s >= until_s and agent.home_m is not None:
            agent.come_back()

    def _own(self, number: int, at_us: int) -> OwnState:
        x_m, y_m = self.places_m[number].tolist()
        vx, vy = self.velocities_m_s[number].tolist()
        height_m, airspeed_m_s = float(self.heights_m[number]), float(self.motion[number, 1])
        return OwnState(at_us, x_m, y_m, height_m, vx, vy, airspeed_m_s, *self.rules.wind_m_s)

    def view(self, number: int) -> Footprint:
        """Return the current footprint of a UAV's camera (see ``camera_footprint``)."""
        camera, height_m = self.settings.camera, float(self.heights_m[number])
        x_m, y_m = self.places_m[number].tolist()
        vx, vy = self.velocities_m_s[number].tolist()
        footprint_m = camera.half_width_m(height_m), camera.half_length_m(height_m)
        return x_m, y_m, math.atan2(vy, vx), *footprint_m

    def _look(self, number: int, agent: Agent, at_us: int) -> None:
        view = self.view(number)
        mark_seen(self.grid, view, self.seen_s, self.at_s)
        burning, unburned = changed_cells(
            self.grid, view, self.arrival_s, self.at_s, agent.maps.fire
        )
        if len(burning) or len(unburned):
            agent.add_view(burning, unburned, at_us)

    def _fly(self) -> None:
        """Move all vehicles by one tick along their intended orbits."""
        orbits = np.array(
            [(i.orbit_x_m, i.orbit_y_m, i.orbit_radius_m, i.airspeed_m_s) for i in self.intentions]
        )
        wind, bank_rad = self.rules.wind_m_s, self.settings.airframe.bank_rad
        headings_rad = np.empty(len(orbits))
        desired_headings(self.places_m, self.motion, orbits, *wind, TICK_S, bank_rad, headings_rad)
        if self.rules.avoidance == "rvo":
            for number, agent in enumerate(self.agents):
                headings_rad[number] = self._clear_heading(number, agent, headings_rad[number])
        fly_all(
            self.places_m, self.motion, headings_rad, orbits[:, 3], *wind, TICK_S, bank_rad,
            self.velocities_m_s,
        )  # fmt: skip
        climbs_m = [intention.climb_m for intention in self.intentions]
        self.heights_m[:] = self.settings.altitude_agl_m + self.layers_m + climbs_m

    def agents_m(self) -> Floats:
        """Return the positions (n, 2) of the virtual agents, NaN for a UAV without an agent."""
        return np.array([(i.agent_x_m, i.agent_y_m) for i in self.intentions])

    def _look_at_safety(self) -> None:
        """Count conflicts and collisions, with the desired velocities of eqs. 14 and 15."""
        radius_m, wind = -self.settings.loiter_radius_m, self.rules.wind_m_s
        orbits = np.array(
            [
                (i.orbit_x_m, i.orbit_y_m, i.orbit_radius_m)
                if math.isnan(i.agent_x_m)
                else (i.agent_x_m, i.agent_y_m, radius_m)
                for i in self.intentions
            ]
        )
        headings_rad = np.empty(len(orbits))
        bank_rad = self.settings.airframe.bank_rad
        desired_headings(self.places_m, self.motion, orbits, *wind, TICK_S, bank_rad, headings_rad)
        directions = np.column_stack([np.cos(headings_rad), np.sin(headings_rad)])
        desired_m_s = self.motion[:, 1:] * directions + wind
        self.safety.look(self.at_s, self.places_m, self.velocities_m_s, desired_m_s, self.heights_m)

    def _clear_heading(self, number: int, agent: Agent, desired_rad: float) -> float:
        """Return the heading that the paper's avoidance chooses from the other UAVs' states."""
        intention = self.intentions[number]
        heading_rad, _ = clear_heading_rad(
            *self.places_m[number],
            *self.velocities_m_s[number],
            desired_rad,
            intention.airspeed_m_s,
            *self.rules.wind_m_s,
            recent(agent.peers.rows(round(self.at_s * 1e6))),
            2.0 * self.settings.safety_radius_m,
            self.settings.neighbourhood_m,
        )
        return float(heading_rad)


def world_grid(shape: tuple[int, int]) -> MapGrid:
    """Return a grid of the paper's cells, centred on (0, 0)."""
    rows, cols = shape
    return MapGrid(rows, cols, CELL_M, -cols * CELL_M / 2.0, rows * CELL_M / 2.0)


def _start(number: int) -> tuple[float, float]:
    """Return the start position of a UAV; UAVs start in queues of eight."""
    queue, place = divmod(number, QUEUE)
    along, across = place * QUEUE_M * math.sqrt(0.5), queue * QUEUE_M * math.sqrt(0.5)
    return BASE_M[0] - along + across, BASE_M[1] - along - across


def fly(world: FormationWorld) -> Flight:
    """Advance a world to the end of its flight, and return the measurements (section 6.2)."""
    grid, settings = world.grid, world.settings
    area = MonitoringArea(grid, settings.augmentation_m(grid.cell_m), settings.monitoring_m)
    measured: list[tuple[float, ...]] = []
    track: list[tuple[float, Floats, Floats]] = []
    measure_every, track_every = round(MEASURE_EVERY_S / TICK_S), round(TRACK_EVERY_S / TICK_S)
    for _ in range(round(world.rules.duration_s / TICK_S)):
        world.tick()
        if world.ticks % track_every == 0:
            track.append((world.at_s, world.places_m.copy(), world.agents_m()))
        if world.ticks % measure_every == 0:
            area.burn(world.arrival_s, world.at_s)
            measured.append(_measured(world, area))
    track_s, uavs_m, agents_m = zip(*track, strict=True)
    columns = np.array(measured).T
    return Flight(
        world.arrival_s,
        columns[0],
        dict(zip(MEASURES, columns[1:], strict=True)),
        np.array(track_s),
        np.array(uavs_m),
        np.array(agents_m),
        world.safety.closest_m,
    )


MEASURES = ("va_coverage", "uav_coverage", "efficiency", "inaccuracy", "conflicts", "collisions")


def _measured(world: FormationWorld, area: MonitoringArea) -> tuple[float, ...]:
    agents_m = world.agents_m()
    return (
        world.at_s,
        area.agent_coverage(agents_m, world.settings.coverage_radius_m),
        area.seen_coverage(world.seen_s, world.at_s),
        area.efficiency([world.view(number) for number in range(len(world.agents))]),
        inaccuracy_cells(area.fire, [agent.maps.fire for agent in world.agents]),
        float(world.safety.conflicts),
        float(world.safety.collisions),
    )
