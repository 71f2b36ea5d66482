"""Rolls out (simulates) routes along the nodes of fronts, and computes the cost of each route.

The cost is the mean over time of a norm of the expected errors of all nodes. The norm is close to
the largest error, but also falls if only smaller errors fall. On a route, the vehicle flies along a
number of nodes in one direction. Then the vehicle turns back for a number of nodes and turns again,
or hops (flies to a node of another front). Afterwards the vehicle flies laps around the front. At
the end of each lap, the vehicle goes to the front with the largest errors relative to the time
needed to reach and lap that front.
"""

import numpy as np

from firemodel.compiled import compiled
from mission_service.guidance.front.sweeps import NEVER


@compiled
def _norm(start, since, growth, weight, total, now):  # type: ignore[no-untyped-def]
    """Return the weighted power mean, with exponent 8, of the errors of all nodes at ``now``."""
    most = 1e-12
    for i in range(start.size):
        most = max(most, start[i] + growth[i] * (now - since[i]))
    found = 0.0
    for i in range(start.size):
        share = (start[i] + growth[i] * (now - since[i])) / most
        share *= share
        share *= share
        found += weight[i] * share * share
    return most * np.sqrt(np.sqrt(np.sqrt(found / total)))


@compiled
def _next_front(place, now, start, since, nodes, hop_s):  # type: ignore[no-untyped-def]
    """Return the node of another front to fly to after a lap, or ``place`` to lap again."""
    front, _, count, weight, ahead_s, growth = nodes
    best, best_value = place, -1.0
    node = 0
    while node < front.size:
        own = front[node] == front[place]
        entry, entry_s = node, np.inf
        lap_s, value = 0.0, 0.0
        for i in range(node, node + count[node]):
            if hop_s[place, i] < entry_s:
                entry, entry_s = i, hop_s[place, i]
            lap_s += ahead_s[i]
            error = start[i] + growth[i] * (now - since[i])
            value += weight[i] * error * error * error
        if own:
            entry, entry_s = place, 0.0
        value /= lap_s + entry_s
        if value > best_value:
            best, best_value = entry, value
        node += count[node]
    return best


@compiled
def route_costs(routes, nodes, back_s, error, left, hop_s, turn_s, others, horizon_s, found, log):  # type: ignore[no-untyped-def]
    """Compute the cost of each route over the next ``horizon_s`` seconds, into ``found`` (m).

    ``routes`` holds arrays (m): the first node, the direction there (1 clockwise, -1
    anticlockwise), the time until the vehicle reaches the first node, the number of nodes to fly
    out, the number of nodes to fly back after a turn, the node to hop to instead of the turn (-1:
    none), and the direction after the hop. The numbers of nodes may be NEVER. ``nodes`` holds
    arrays of ``FrontNodes``: front, first, nodes_of_front, weight, ahead_s, growth. ``others``
    holds the nodes and times of visits by other vehicles, in chronological order. ``error`` (n) is
    the current error, and ``left`` the error of a node in view. ``log`` (k, 2) is filled with the
    nodes and times of the first visits of the last route; in unused rows, the node is -1.
    """
    first_node, direction, delay_s, out, back, hop, hop_direction = routes
    _, first, count, weight, ahead_s, growth = nodes
    n = error.size
    total = weight.sum()
    start, since = np.empty(n), np.empty(n)
    for route in range(first_node.size):
        start[:], since[:] = error, 0.0
        place, now = first_node[route], delay_s[route]
        step, steps = direction[route], out[route]
        leg = 2 if steps == NEVER else 0
        lapped, other, visits = 0, 0, 0
        before_s, before = 0.0, _norm(start, since, growth, weight, total, 0.0)
        cost = 0.0
        log[:, 0], log[:, 1] = -1.0, 0.0
        while True:
            until = min(now, horizon_s)
            while other < others.shape[0] and others[other, 1] <= until:
                node, at = int(others[other, 0]), others[other, 1]
                value = start[node] + growth[node] * (at - since[node])
                start[node], since[node] = min(value, left), at
                other += 1
            value = _norm(start, since, growth, weight, total, until)
            cost += 0.5 * (before + value) * (until - before_s)
            if now >= horizon_s:
                break
            value = start[place] + growth[place] * (now - since[place])
            start[place], since[place] = min(value, left), now
            if visits < log.shape[0]:
                log[visits, 0], log[visits, 1] = place, now
                visits += 1
            before_s, before = now, _norm(start, since, growth, weight, total, now)
            if steps == 0 and leg < 2:
                leg, lapped = leg + 1, 0
                if leg == 1 and hop[route] >= 0:
                    now += hop_s[place, hop[route]] + turn_s
                    place, step, leg, steps = hop[route], hop_direction[route], 2, NEVER
                    continue
                step = -step
                now += turn_s
                steps = back[route] if leg == 1 else NEVER
                leg = 2 if steps == NEVER else leg
            steps -= 1
            lapped += 1
            if leg == 2 and lapped > count[place]:
                entry = _next_front(place, now, start, since, nodes, hop_s)
                lapped = 0
                if entry != place:
                    now += hop_s[place, entry] + turn_s
                    place = entry
                    continue
            if step > 0:
                now += ahead_s[place]
                place = place + 1 if place + 1 < first[place] + count[place] else first[place]
            else:
                place = place - 1 if place > first[place] else first[place] + count[place] - 1
                now += back_s[place]
        found[route] = cost / horizon_s
