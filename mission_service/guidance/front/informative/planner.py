"""The planner ``informative``, which plans routes that keep the fronts' expected errors small.

The planner uses the fronts of the estimated fire: any number of closed lines, with islands and spot
fires. Each part of a front has an expected error, which grows while the part is out of view.
Whenever new fronts are estimated, the planner compares routes by roll-outs (``route_search``):
laps, sweeps of a part of a front, and flights to another front. The roll-outs include the measured
wind and the time of turns. All vehicles share the fronts, and each vehicle's planner takes the
planned visits of the other vehicles into account. A vehicle keeps its route unless another route
has a clearly lower cost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import lengths_along
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.events import FrontsEstimated, Observed
from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.front.first_lap import view_of
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.front.informative.front_nodes import (
    LEFT_CELLS,
    Front,
    FrontNodes,
    hop_times_s,
    nodes_of,
)
from mission_service.guidance.front.informative.legs import leg
from mission_service.guidance.front.informative.loop_path import path_on_loop
from mission_service.guidance.front.informative.route_search import (
    Route,
    Situation,
    entries,
    evaluate,
    routes_along,
)
from mission_service.guidance.front.informative.shared_fronts import SharedFronts
from mission_service.guidance.front.informative.wind_turns import (
    Flight,
    Pose,
    heading_on_course,
    turn_times_s,
)
from mission_service.guidance.front.planners import ground_of, path_settings
from mission_service.guidance.front.predictive_planner import RECENTRED_BASELINE_S, TURN_BACK
from mission_service.guidance.front.sweeps import NEVER
from mission_service.guidance.protocol import Decision, Ground, Phase

Floats = NDArray[np.float64]

# Fractions of the cost that another route must save: a route on the same front, and a route to
# another front. On the same front, a small fraction causes turns due to errors in the estimate
# (benchmarks.informative_routes). A vehicle on the way to another front must save MARGIN_TURN to
# fly to a third front, or back. After a whole lap of its front, any saving suffices for a flight to
# another front: on a small front another lap costs so little that the saving would never reach the
# fraction.
MARGIN_TURN, MARGIN_HOP = 0.5, 0.1
MAX_WIND = 0.95  # maximum wind speed in plans, as a fraction of the airspeed
MAX_LAP = 5.0 / 6.0  # longest path along one front, in laps; a whole lap would end at its start
IN_VIEW_CELLS = 3.0  # a front is in view at this distance or less


@dataclass(frozen=True, slots=True)
class InformativeSettings:
    """The settings of one vehicle; lengths are in cells and speeds in cells per second."""

    clockwise_first: bool
    speed_cells_s: float
    turn_radius_cells: float
    path: PathSettings

    @property
    def turn_s(self) -> float:
        """The duration of a turn back."""
        return TURN_BACK * self.turn_radius_cells / self.speed_cells_s


@dataclass(frozen=True, slots=True)
class Hop:
    """A flight to another front: arrival position (row, column) and direction after arrival."""

    row: float
    col: float
    clockwise: bool


@dataclass(frozen=True, slots=True)
class Plan:
    """The rest of a vehicle's current route, as distances along the front.

    The vehicle flies ``out_cells``, and then either makes the hop, or turns back for ``back_cells``
    and turns again. Distances may be infinite.
    """

    out_cells: float = math.inf
    back_cells: float = math.inf
    hop: Hop | None = None


class InformativePlanner:
    """An informative ``Planner``; positions are rows and columns of the landscape's grid."""

    def __init__(
        self, name: str, settings: InformativeSettings, ground: Ground, shared: SharedFronts
    ) -> None:
        """Begin the approach of the vehicle ``name``."""
        self.phase: Phase = "approach"
        self.clockwise = settings.clockwise_first
        self.reversals = 0
        self.settings = settings
        # This map is used only for the alarm about a front that no vehicle monitors.
        self.map = FireMap(
            ground.landscape.shape, *ground.centre, ground.burns_from_s, RECENTRED_BASELINE_S
        )
        self._name = name
        self._landscape = ground.landscape
        self._shared = shared
        self._plan = Plan()
        self._hops = False  # whether the vehicle flies to ``_plan.hop`` now
        self._flown_cells = 0.0  # since arrival at the current front
        self._version = 0  # version of the fronts at the last decision
        self._wind = (0.0, 0.0)  # towards north and east on the grid, in cells/s
        self._place: tuple[float, float] | None = None
        self._course = np.array([1.0, 0.0])  # course over the ground, a unit vector (north, east)
        self._sees_front = False

    def observe(self, observed: Observed) -> None:
        """Update the map for alarms; the fronts are estimated elsewhere."""
        self._sees_front |= bool(self.map.add_window(*view_of(observed)).any())

    def correct(self, observed: Observed) -> None:
        """Apply an operator's correction to the map for alarms."""
        self.map.correct_window(*view_of(observed))

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Set the measured wind, which blows from ``from_deg``, clockwise from true north."""
        toward = math.radians(float(self._landscape.grid_deg(from_deg + 180.0)))
        speed = speed_m_s / self._landscape.cell_size_m
        self._wind = (speed * math.cos(toward), speed * math.sin(toward))

    def on_fronts(self, event: FrontsEstimated) -> None:
        """Replace the fronts, for all vehicles of the run."""
        self._shared.replace_fronts(event)

    def left(self, at_s: float) -> None:
        """Remove the vehicle's planned visits, so that the other vehicles plan these visits."""
        self._shared.remove_vehicle(self._name)
        self._place, self._flown_cells = None, 0.0

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Set the vehicle's position; return a decision for new fronts or at a planned turn."""
        moved = math.dist((row, col), self._place) if self._place else 0.0
        if self._place and moved > 0.0:
            self._course = np.array([self._place[0] - row, col - self._place[1]]) / moved
        self._place = (row, col)
        if not self._shared.fronts:
            return None
        if self.phase == "approach":
            if not (self._sees_front or self._nearest(row, col)[1] <= IN_VIEW_CELLS):
                return None
            self.phase = "monitor"
        if self._fly(moved, row, col) and self._plan.hop is None:
            return self._turn(Plan(out_cells=self._plan.back_cells), 0.0, 0.0)
        if self._version != self._shared.version:
            self._version = self._shared.version
            return self._decide(row, col, at_s)
        return None

    def _fly(self, moved_cells: float, row: float, col: float) -> bool:
        """Subtract a flown distance from the plan; return whether the outbound leg ends here."""
        plan, hop = self._plan, self._plan.hop
        if self._hops and hop is not None:
            if math.dist((row, col), (hop.row, hop.col)) <= self.settings.path.lookahead_cells:
                self.clockwise, self._plan, self._hops = hop.clockwise, Plan(), False
                self._flown_cells = 0.0
            return False
        self._flown_cells += moved_cells
        self._plan = replace(plan, out_cells=plan.out_cells - moved_cells)
        if self._plan.out_cells > 0.0:
            return False
        self._hops = hop is not None
        return True

    def _turn(self, plan: Plan, cost_on: float, cost_back: float) -> Decision:
        self.clockwise, self._plan, self._hops = not self.clockwise, plan, False
        self.reversals += 1
        return self._decision(True, cost_on, cost_back)

    def _decision(self, reversed_now: bool, cost_on: float, cost_back: float) -> Decision:
        length = sum(front.length_cells for front in self._shared.fronts)
        return Decision(self.clockwise, reversed_now, cost_on, cost_back, round(length))

    def _nearest(self, row: float, col: float) -> tuple[int, float]:
        """Return the index of the front nearest to a position, and the distance in cells."""
        away = [front.nearest(row, col)[1] for front in self._shared.fronts]
        index = int(np.argmin(away))
        return index, away[index]

    # The decision ---------------------------------------------------------------------------------

    def _decide(self, row: float, col: float, at_s: float) -> Decision:
        """Compare routes; adopt the best route if it is clearly better than the current route."""
        nodes = nodes_of(self._shared.fronts, self.settings.speed_cells_s, self._wind)
        situation = self._situation(nodes, at_s)
        number, _ = self._nearest(row, col)
        own = node_at(nodes, number, self._shared.fronts[number].nearest(row, col)[0])
        direction = 1 if self.clockwise else -1
        present = self._present(own, direction, nodes)
        ways = self._ways(own, direction, situation)
        costs = evaluate([present, *ways], situation).costs
        hops = [self._is_hop(way, present, own, nodes) for way in ways]
        lapped = self._flown_cells >= self._shared.fronts[number].length_cells
        margin_hop = 0.0 if lapped and self._plan.hop is None else MARGIN_HOP
        needed = 1.0 - np.where(hops, margin_hop, MARGIN_TURN)
        best = int((costs[1:] / needed).argmin()) + 1
        chosen = present
        cost_on, cost_back = float(costs[0]), float(costs[best])
        found: Decision | None = None
        if cost_back < cost_on * needed[best - 1]:
            chosen = ways[best - 1]
            found = self._adopt(chosen, own, direction, nodes, (cost_on, cost_back))
        visits = evaluate([chosen], situation).visits
        at = visits[:, 0].astype(np.int64)
        self._shared.set_visits(
            self._name, np.column_stack([nodes.row[at], nodes.col[at], at_s + visits[:, 1]])
        )
        return found or self._decision(False, cost_on, cost_back)

    def _is_hop(self, way: Route, present: Route, own: int, nodes: FrontNodes) -> bool:
        """Return whether a route leads to another front without a turn back on the current front.

        During a hop, return whether a route leads to the destination front.
        """
        if self._hops:
            return bool(nodes.front[way.start] == nodes.front[present.start])
        turns_back = way.direction != present.direction
        return bool(nodes.front[way.start] != nodes.front[own]) or (way.hop >= 0 and not turns_back)

    def _ways(self, own: int, direction: int, situation: Situation) -> list[Route]:
        """Return the routes to compare with the current one."""
        found = []
        if not self._hops:
            found += routes_along(own, direction, 0.0, situation)
            found += routes_along(own, -direction, situation.turn_s, situation)
        goals = [
            (entry, turn)
            for entry in (*entries(own, situation), *([own] if self._hops else []))
            for turn in (direction, -direction)
        ]
        times_s = self._times_to(goals, situation.nodes)
        return found + [Route(*goal, time_s) for goal, time_s in zip(goals, times_s, strict=True)]

    def _situation(self, nodes: FrontNodes, at_s: float) -> Situation:
        others = self._shared.visits_of_others(self._name)
        others = others[others[:, 2] >= at_s]
        away = np.hypot(nodes.row[:, None] - others[:, 0], nodes.col[:, None] - others[:, 1])
        visits = np.column_stack([away.argmin(axis=0), others[:, 2] - at_s])
        return Situation(
            nodes,
            LEFT_CELLS + nodes.growth * np.maximum(at_s - nodes.seen_at_s, 0.0),
            hop_times_s(nodes, self.settings.speed_cells_s, self._wind),
            self.settings.turn_s,
            visits[np.argsort(visits[:, 1], kind="stable")],
        )

    def _times_to(self, goals: Sequence[tuple[int, int]], nodes: FrontNodes) -> list[float]:
        """Return the times of the fastest paths in the wind from the vehicle to the goals.

        A goal is a node and the direction of flight there: 1 (clockwise) or -1 (anticlockwise).
        """
        assert self._place is not None
        settings, (north, east) = self.settings, self._wind
        if not goals:
            return []
        if math.hypot(north, east) >= MAX_WIND * settings.speed_cells_s:
            north, east = 0.0, 0.0  # no path leads upwind: compare the times without wind
        flight = Flight(settings.speed_cells_s, settings.turn_radius_cells, (east, north))
        poses = [
            pose_on(nodes.row[node], nodes.col[node], turn * course_at(nodes, node), flight)
            for node, turn in goals
        ]
        start = pose_on(*self._place, self._course, flight)
        times_s = turn_times_s(np.array([start] * len(goals)), np.array(poses), flight)
        return [float(time_s) for time_s in times_s]

    def _present(self, own: int, direction: int, nodes: FrontNodes) -> Route:
        """Return the current plan as a route."""
        plan, hop = self._plan, self._plan.hop
        entry = -1
        if hop is not None:
            entry = int(np.hypot(nodes.row - hop.row, nodes.col - hop.col).argmin())
        turn = 1 if hop is not None and hop.clockwise else -1
        if self._hops and hop is not None:
            return Route(entry, turn, self._times_to([(entry, turn)], nodes)[0])
        out, back = (in_nodes(cells, nodes, own) for cells in (plan.out_cells, plan.back_cells))
        if entry >= 0 and nodes.front[entry] == nodes.front[own]:  # the fronts have merged
            return Route(own, direction)
        return Route(own, direction, 0.0, out, back, entry, turn)

    def _adopt(
        self, route: Route, own: int, direction: int, nodes: FrontNodes, costs: tuple[float, float]
    ) -> Decision | None:
        """Make a route the current plan; return the decision if the vehicle turns back."""
        if self._hops or nodes.front[route.start] != nodes.front[own]:
            place = (float(nodes.row[route.start]), float(nodes.col[route.start]))
            self._plan, self._hops = Plan(0.0, hop=Hop(*place, route.direction > 0)), True
            return None
        cells = float(nodes.weight[own])
        plan = Plan(
            math.inf if route.out == NEVER else route.out * cells,
            math.inf if route.back == NEVER else route.back * cells,
        )
        if route.hop >= 0:
            place = (float(nodes.row[route.hop]), float(nodes.col[route.hop]))
            plan = replace(plan, hop=Hop(*place, route.hop_direction > 0))
        if route.direction != direction:
            return self._turn(plan, *costs)
        self._plan = plan
        return None

    # The path -------------------------------------------------------------------------------------

    def path(self, row: float, col: float) -> Floats:
        """Return the path to fly along the front ahead: an array (n, 2) with row and column.

        The path begins at the lookahead distance, so that a vehicle in a turn need not fly back.
        """
        fronts, settings = self._shared.fronts, self.settings
        if not fronts:
            return np.empty((0, 2))
        horizon = settings.path.horizon_cells
        hop = self._plan.hop
        parts: list[Floats] = []
        if not self._hops:
            front = fronts[self._nearest(row, col)[0]]
            length = min(horizon, horizon if hop is None else max(self._plan.out_cells, 0.0))
            parts.append(self._along(front, (row, col), self.clockwise, length))
        flown = float(lengths_along(parts[0])[-1]) if parts else 0.0
        if hop is not None and flown < horizon:
            start = parts[-1][-1] if parts and len(parts[-1]) else np.array([row, col])
            goal = np.array([hop.row, hop.col])
            way = leg(start, goal, self._shared.unburned())
            parts.append(way if parts else beyond(way, settings.path.lookahead_cells))
            flown += float(lengths_along(way)[-1])
            front = fronts[self._nearest(hop.row, hop.col)[0]]
            rest = max(horizon - flown, 2.0 * settings.path.lookahead_cells)
            parts.append(self._along(front, (hop.row, hop.col), hop.clockwise, rest))
        return np.concatenate(parts)

    def _along(
        self, front: Front, place: tuple[float, float], clockwise: bool, length: float
    ) -> Floats:
        """Return the path along a front from the first point beyond the lookahead distance."""
        size, length = len(front.points), min(length, MAX_LAP * front.length_cells)
        nearest, _ = front.nearest(*place)
        order = (nearest + (1 if clockwise else -1) * np.arange(size)) % size
        away = np.hypot(*(front.points[order] - place).T)
        far = away >= self.settings.path.lookahead_cells
        start = int(order[int(far.argmax())]) if far.any() else nearest
        return path_on_loop(
            front.points, start, clockwise, length, self.settings.turn_radius_cells, front.inner
        )

    @property
    def goal(self) -> Floats | None:
        """The position (row, column) at which a flight to another front ends; None on a front."""
        hop = self._plan.hop
        return np.array([hop.row, hop.col]) if self._hops and hop is not None else None

    def distance_to_front(self, row: float, col: float) -> float:
        """Return the distance from a position to the nearest estimated front, in cells."""
        return self._nearest(row, col)[1]

    # For interfaces -------------------------------------------------------------------------------

    def shape(self, row: float, col: float) -> Floats:
        """Return the outer fronts as distances in cells from the map's centre on 360 bearings."""
        points = [front.points for front in self._shared.fronts if not front.inner]
        if not points:
            return np.zeros(BEARINGS)
        every = np.concatenate(points)
        north, east = self.map.centre_row - every[:, 0], every[:, 1] - self.map.centre_col
        bearing = np.rint(np.degrees(np.arctan2(east, north))).astype(np.int64) % BEARINGS
        distance = np.zeros(BEARINGS)
        np.maximum.at(distance, bearing, np.hypot(north, east))
        known = np.flatnonzero(distance)
        return np.interp(np.arange(BEARINGS), known, distance[known], period=BEARINGS)


def beyond(way: Floats, distance_cells: float) -> Floats:
    """Return the part of a path (n, 2) beyond a distance from its start; at least its end."""
    along = lengths_along(way)
    if distance_cells >= along[-1]:
        return way[-1:]
    first = [np.interp(distance_cells, along, column) for column in way.T]
    return np.array([first, *way[along > distance_cells]])


def node_at(nodes: FrontNodes, front: int, point: int) -> int:
    """Return the node that contains a point of a front."""
    own = np.flatnonzero(nodes.front == front)
    return int(own[max(int(np.searchsorted(nodes.point[own], point, side="right")) - 1, 0)])


def course_at(nodes: FrontNodes, node: int) -> Floats:
    """Return the clockwise direction of a front at a node, as a unit vector (north, east)."""
    first, count = int(nodes.first[node]), int(nodes.nodes_of_front[node])
    after = first + (node - first + 1) % count
    step = np.array([nodes.row[node] - nodes.row[after], nodes.col[after] - nodes.col[node]])
    return np.asarray(step / max(float(np.hypot(*step)), 1e-9))


def pose_on(row: float, col: float, course: Floats, flight: Flight) -> Pose:
    """Return the pose of a vehicle on a course (north, east) over the ground; x is the column."""
    heading_rad = heading_on_course(math.atan2(course[0], course[1]), flight)
    return float(col), -float(row), heading_rad


def in_nodes(cells: float, nodes: FrontNodes, own: int) -> int:
    """Convert a distance in cells to nodes of the front that contains the node ``own``."""
    return NEVER if math.isinf(cells) else max(round(cells / float(nodes.weight[own])), 1)


def planners_of(scenario: Scenario, landscape: Landscape) -> dict[str, InformativePlanner]:
    """Return the planners of a scenario's vehicles, by name; all planners share the fronts."""
    ground, shared = ground_of(scenario, landscape), SharedFronts(landscape.cell_size_m)
    return {
        section.name: InformativePlanner(
            section.name, settings_of(scenario, section, landscape), ground, shared
        )
        for section in scenario.vehicles
    }


def settings_of(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> InformativeSettings:
    """Return the settings of one vehicle of a scenario."""
    cell_m = landscape.cell_size_m
    return InformativeSettings(
        clockwise_first=scenario.planner.first_direction == "clockwise",
        speed_cells_s=section.airspeed_m_s / cell_m,
        turn_radius_cells=section.turn_radius_m / cell_m,
        path=path_settings(scenario, cell_m),
    )
