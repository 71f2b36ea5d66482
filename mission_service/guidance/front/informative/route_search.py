"""Lists the possible routes of one vehicle, and compares their costs by roll-outs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.informative.front_nodes import (
    LEFT_CELLS,
    MAX_NODES,
    FrontNodes,
)
from mission_service.guidance.front.informative.route_kernels import route_costs
from mission_service.guidance.front.sweeps import NEVER

Floats = NDArray[np.float64]

HORIZON_LAPS = 2.0
MAX_VISITS = 2 * MAX_NODES
# Lengths of the outbound and return legs, as fractions of a front's nodes.
OUT = (0.03, 0.07, 0.12, 0.2, 0.3, 0.4, 0.55, 0.7, 0.9)
BACK = (0.06, 0.12, 0.2, 0.3, 0.45, 0.6, 0.8)
OUT_BEFORE_HOP = (0.1, 0.25, 0.5, 0.75, 1.0)


class Route(NamedTuple):
    """A route: an outbound leg, then a turn and a return leg, or a hop to a node of another front.

    ``start`` is the first node, which the vehicle reaches after ``delay_s``. ``out`` and ``back``
    are numbers of nodes. Directions are 1 (clockwise) or -1 (anticlockwise). ``hop`` is the node
    after the hop, or -1 in a route without a hop.
    """

    start: int
    direction: int
    delay_s: float = 0.0
    out: int = NEVER
    back: int = NEVER
    hop: int = -1
    hop_direction: int = 1


class Situation(NamedTuple):
    """The fronts and the vehicle at the time of a decision.

    ``hop_s`` (n, n) is the flight time between nodes, and ``others`` (k, 2) the nodes and times
    (from now) of the expected visits by other vehicles, in chronological order.
    """

    nodes: FrontNodes
    error: Floats  # current expected error of each node, in cells
    hop_s: Floats
    turn_s: float
    others: Floats


class Search(NamedTuple):
    """The costs of routes, in the same order as the routes."""

    costs: Floats
    visits: Floats  # (k, 2) node and time of the first visits of the last route


def horizon_s(nodes: FrontNodes) -> float:
    """Return the time over which routes are compared."""
    return HORIZON_LAPS * float(nodes.ahead_s.sum() + nodes.back_s.sum()) / 2.0


def evaluate(routes: list[Route], situation: Situation) -> Search:
    """Return the costs of routes: the norm of the errors, averaged over time, in cells."""
    nodes = situation.nodes
    columns = tuple(
        np.array(column, dtype=np.float64 if name == "delay_s" else np.int64)
        for name, column in zip(Route._fields, zip(*routes, strict=True), strict=True)
    )
    of_nodes = (
        *(nodes.front, nodes.first, nodes.nodes_of_front),
        *(nodes.weight, nodes.ahead_s, nodes.growth),
    )
    costs, visits = np.zeros(len(routes)), np.full((MAX_VISITS, 2), -1.0)
    route_costs(
        columns,
        of_nodes,
        nodes.back_s,
        situation.error,
        LEFT_CELLS,
        situation.hop_s,
        situation.turn_s,
        situation.others,
        horizon_s(nodes),
        costs,
        visits,
    )
    return Search(costs, visits[visits[:, 0] >= 0.0])


def routes_along(place: int, direction: int, delay_s: float, situation: Situation) -> list[Route]:
    """Return routes from a node in one direction: laps, sweeps, and hops after part of a lap."""
    nodes = situation.nodes
    count = int(nodes.nodes_of_front[place])
    found = [Route(place, direction, delay_s)]
    outs = sorted({max(round(share * count), 1) for share in OUT})
    backs = sorted({max(round(share * count), 1) for share in BACK})
    found += [
        Route(place, direction, delay_s, out, back) for out in outs for back in (*backs, NEVER)
    ]
    for hop in entries(place, situation):
        for out in sorted({max(round(share * count), 1) for share in OUT_BEFORE_HOP}):
            found += [
                Route(place, direction, delay_s, out, NEVER, hop, turn)
                for turn in (direction, -direction)
            ]
    return found


def entries(place: int, situation: Situation) -> list[int]:
    """Return two nodes at which to join each of the other fronts: nearest and least accurate."""
    nodes, found = situation.nodes, []
    for first in np.unique(nodes.first).tolist():
        if first == nodes.first[place]:
            continue
        own = slice(first, first + int(nodes.nodes_of_front[first]))
        found.append(first + int(situation.hop_s[place, own].argmin()))
        found.append(first + int(situation.error[own].argmax()))
    return sorted(set(found))
