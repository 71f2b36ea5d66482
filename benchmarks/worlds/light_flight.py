"""Flies a random world with the core alone: no fire, no MAVLink, a planner of random paths."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.mock.kinematics import STEP_US, Wind
from benchmarks.worlds.ground import lat_lon_of, plane_m
from benchmarks.worlds.light_vehicle import LightVehicle
from benchmarks.worlds.random_world import FLIES_S, START_S, Crossing, World, landscape_of
from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import AnyCommand, Command, OrderByService
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.core.core import Core
from mission_service.fire.scenario_fire import home_of
from mission_service.guidance.front.way import front_way
from mission_service.guidance.protocol import Decision, Ground, Phase
from mission_service.guidance.way_of_flying import WayOfFlying

Floats = NDArray[np.float64]
Line = dict[str, Any]
REPORTS_EVERY_US = 1_000_000  # positions
WIND_EVERY_US, AIRCRAFT_EVERY_US = 10_000_000, 1_000_000
NEAR_M = 4000.0  # aircraft within this distance are reported
PATH_S = (90.0, 240.0)  # a planner keeps a path for a time between these
AREA_M = 1500.0  # paths stay within this distance of the fire, east and north


class RandomPaths:
    """A planner that flies random paths around the fire, each for some time."""

    phase: Phase = "monitor"
    reversals = 0

    def __init__(self, random: np.random.Generator, ground: Ground, horizon_m: float) -> None:
        self.clockwise = bool(random.random() < 0.5)
        self._random = random
        self._centre, self._cell_m = ground.centre, ground.landscape.cell_size_m
        self._horizon = horizon_m / self._cell_m
        self._until_s = -math.inf
        self._path: Floats = np.zeros((0, 2))

    def observe(self, observed: events.Observed) -> None:
        """Do nothing."""

    def correct(self, observed: events.Observed) -> None:
        """Do nothing."""

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Do nothing."""

    def left(self, at_s: float) -> None:
        """Do nothing."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Draw a new path when the last one has been kept long enough."""
        if at_s >= self._until_s:
            self._until_s = at_s + float(self._random.uniform(*PATH_S))
            reach = AREA_M / self._cell_m
            count = int(self._random.integers(2, 12))
            places = self._centre + self._random.uniform(-reach, reach, (count, 2))
            self._path = np.vstack([(row, col), places])
        return None

    def path(self, row: float, col: float) -> Floats:
        """Return the rest of the path, from the position on the path next to the vehicle."""
        here, best, rest = np.array([row, col]), math.inf, self._path
        for index in range(len(self._path) - 1):
            start, leg = self._path[index], self._path[index + 1] - self._path[index]
            share = np.clip(np.dot(here - start, leg) / max(float(np.dot(leg, leg)), 1e-9), 0, 1)
            near = start + share * leg
            away = float(np.hypot(*(here - near)))
            if away < best:
                best, rest = away, np.vstack([near, self._path[index + 1 :]])
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(rest, axis=0).T)))
        within = int(np.searchsorted(along, self._horizon))
        if within >= len(rest):
            return rest
        share = (self._horizon - along[within - 1]) / max(along[within] - along[within - 1], 1e-9)
        end = rest[within - 1] + share * (rest[within] - rest[within - 1])
        return np.vstack([rest[:within], end])

    def shape(self, row: float, col: float) -> Floats:
        """Return no front."""
        return np.full(360, np.nan)


class LightCore(Core):
    """The core with ``RandomPaths`` as planners."""

    @property
    def _way(self) -> WayOfFlying:
        return front_way("random_paths", _planner)


def _planner(scenario: Scenario, section: VehicleSection, ground: Ground) -> RandomPaths:
    random = np.random.default_rng((scenario.seed, section.system_id))
    return RandomPaths(random, ground, scenario.mission.horizon_m)


@dataclass(frozen=True)
class Fault:
    """An injected fault: changes of the scenario, of the landscape and of the core itself."""

    name: str
    scenario: Callable[[Scenario], Scenario] = lambda scenario: scenario
    landscape: Callable[[Landscape], Landscape] = lambda landscape: landscape
    core: Callable[[Core], None] = lambda core: None


SOUND = Fault("none")


def flight_of(world: World, fault: Fault = SOUND) -> Iterator[Line]:
    """Fly a world and yield its events and commands in the form of a journal's lines.

    The lines of the type ``Led`` state whether the service has control of a vehicle.
    """
    return _LightFlight(world, fault).lines()


class _LightFlight:
    def __init__(self, world: World, fault: Fault) -> None:
        landscape = landscape_of(world.terrain)
        self.world = world
        self.core = LightCore(fault.scenario(world.scenario), fault.landscape(landscape))
        fault.core(self.core)
        weather = world.scenario.weather[0]
        self.wind = Wind(weather.wind_from_deg, weather.wind_speed_m_s)
        self.vehicles = {
            section.name: LightVehicle(
                section,
                home_of(section, landscape)[2],
                self.wind,
                [trouble for trouble in world.troubles if trouble.vehicle == section.name],
                np.random.default_rng((world.seed, 1, section.system_id)),
            )
            for section in world.scenario.vehicles
        }
        self.requests = deque(world.requests)
        self.now_us = round(START_S * 1e6)
        self._led: dict[str, bool] = {}
        self._with_aircraft: set[str] = set()

    def lines(self) -> Iterator[Line]:
        """Fly, and yield the lines."""
        for vehicle in self.vehicles.values():
            yield from self._handle(vehicle.connected(self.now_us))
        end_us = round((START_S + FLIES_S) * 1e6)
        while self.now_us < end_us:
            self.now_us += STEP_US
            yield from self._step()

    def _step(self) -> Iterator[Line]:
        now_us = self.now_us
        while self.requests and self.requests[0].at_us <= now_us:
            due = msgspec.structs.replace(self.requests.popleft(), at_us=now_us)
            if isinstance(due, events.AirspaceClosed) and due.name in self.world.over:
                due = self._in_front(due)
            yield from self._handle(due)
        for vehicle in self.vehicles.values():
            for event in vehicle.step(now_us / 1e6):
                yield from self._handle(event)
            if self._led.get(vehicle.name) != vehicle.is_led:
                self._led[vehicle.name] = vehicle.is_led
                yield {
                    "truth": {
                        "type": "Led",
                        "at_us": now_us,
                        "vehicle": vehicle.name,
                        "led": vehicle.is_led,
                    }
                }
            if now_us % REPORTS_EVERY_US == 0:
                yield from self._reports(vehicle)

    def _in_front(self, closed: events.AirspaceClosed) -> events.AirspaceClosed:
        """Return a volume that people close in front of a vehicle."""
        name, ahead_m = self.world.over[closed.name]
        vehicle = self.vehicles[name]
        place = vehicle.flight.frame.global_position(vehicle.flight.motion)
        course_rad = vehicle.flight.motion.course_rad
        east_m, north_m = plane_m(*place)
        east_m, north_m = (
            east_m + ahead_m * math.sin(course_rad),
            north_m + ahead_m * math.cos(course_rad),
        )
        offsets = [plane_m(*corner) for corner in closed.corners]
        corners = tuple(lat_lon_of(east_m + x_m, north_m + y_m) for x_m, y_m in offsets)
        return msgspec.structs.replace(closed, corners=corners)

    def _reports(self, vehicle: LightVehicle) -> Iterator[Line]:
        report = vehicle.telemetry(self.now_us)
        if not vehicle.linked:
            yield {"truth": {**msgspec.to_builtins(report), "type": "Position"}}
            return
        yield from self._handle(report)
        if self.now_us % WIND_EVERY_US == 0 and vehicle.flight.airborne:
            wind = self.wind
            measured = events.WindMeasured(
                self.now_us, vehicle.name, wind.speed_m_s, wind.from_deg % 360.0
            )
            yield from self._handle(measured)
        if self.world.aircraft and self.now_us % AIRCRAFT_EVERY_US == 0:
            yield from self._aircraft(vehicle, report)

    def _aircraft(self, vehicle: LightVehicle, report: events.Telemetry) -> Iterator[Line]:
        place_m = plane_m(report.lat_deg, report.lon_deg)
        states = [_state(each, self.now_us / 1e6) for each in self.world.aircraft]
        near = tuple(
            state
            for state in states
            if math.dist(plane_m(state.lat_deg, state.lon_deg), place_m) < NEAR_M
        )
        if near or vehicle.name in self._with_aircraft:
            (self._with_aircraft.add if near else self._with_aircraft.discard)(vehicle.name)
            yield from self._handle(events.AircraftReported(self.now_us, vehicle.name, near))

    def _handle(self, event: events.AnyEvent) -> Iterator[Line]:
        yield {"event": msgspec.to_builtins(event)}
        for command in self.core.handle(event):
            yield {"command": _builtins(command)}
            if isinstance(command, OrderByService):
                order = events.OrderGiven(
                    *(self.now_us, events.SERVICE, "", command.vehicle, command.order),
                    hold_at=command.hold_at,
                )
                self.requests.appendleft(order)
            elif command.vehicle in self.vehicles:
                self.vehicles[command.vehicle].execute(command, self.now_us / 1e6)


def _builtins(command: AnyCommand) -> Line:
    """Return a command as in a journal; items are dataclasses."""
    assert isinstance(command, Command)
    found: Line = msgspec.to_builtins(command)
    return found


def _state(aircraft: Crossing, at_s: float) -> events.AircraftState:
    """Return an aircraft at a mission time."""
    since_s = at_s - aircraft.at_s
    lat_deg, lon_deg = lat_lon_of(
        aircraft.place_m[0] + since_s * aircraft.east_m_s,
        aircraft.place_m[1] + since_s * aircraft.north_m_s,
    )
    return events.AircraftState(
        *(aircraft.name, "", lat_deg, lon_deg),
        aircraft.altitude_amsl_m + since_s * aircraft.climb_m_s,
        *(aircraft.north_m_s, aircraft.east_m_s, aircraft.climb_m_s),
        age_s=0.5,
        source="adsb",
    )
