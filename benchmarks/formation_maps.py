"""Step times and traffic of the formation's maps: ``python -m benchmarks.formation_maps``.

The maps have 500 x 500 cells of 10 m and the paper's lengths. Times are the best of several
batches. The shared maps receive messages of the other maps a quarter of a second late. Two of the
maps observe new fire immediately; a cell is wrong on another map until the message about it
arrives.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import click
import msgspec
import numpy as np
from numpy.typing import NDArray

from mission_service.experiments.virtual_agents.camera_footprint import changed_cells, mark_seen
from mission_service.experiments.virtual_agents.monitoring import MonitoringArea, inaccuracy_cells
from mission_service.guidance.formation.agent_maps import AgentMaps
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.shared_map import MapMessage, SharedMap
from mission_service.peer_messages import Digest, FireUpdate

GRID = MapGrid(500, 500, 10.0, 0.0, 5000.0)
NONE = np.empty(0, dtype=np.int64)
BATCHES = 10
BURNING, NEW_S = 3000, 1.3  # initial cells, and new cells a second (experiments 2 and 3)
TICK_US = 250_000
LOST = 0.3


def rough_disc() -> NDArray[np.int64]:
    """Return the cells in the order in which a fire from the middle of the map reaches them."""
    rows, cols = np.divmod(np.arange(500 * 500), 500)
    noise = np.random.default_rng(1).normal(0.0, 1.0, 500 * 500)
    order: NDArray[np.int64] = np.argsort(np.hypot(rows - 250, cols - 250) + noise)
    return order


def each_us(function: Callable[..., object], arguments: list[tuple[Any, ...]]) -> float:
    """Return the mean time of a call in the best batch; one call for each tuple of arguments."""
    function(*arguments[0])
    best = np.inf
    size = (len(arguments) - 1) // BATCHES
    for first in range(1, 1 + BATCHES * size, size):
        began = time.perf_counter()
        for some in arguments[first : first + size]:
            function(*some)
        best = min(best, (time.perf_counter() - began) / size)
    return best * 1e6


def steps(order: NDArray[np.int64]) -> dict[str, float]:
    """Return the time of each step in microseconds."""
    settings = Settings()
    near_m, area_m = settings.augmentation_m(GRID.cell_m), settings.agent_area_m
    tens = [order[k : k + 10] for k in range(BURNING, BURNING + 2010, 10)]
    maps = AgentMaps(GRID.shape, GRID.cell_m, near_m, area_m)
    shared, digest = SharedMap("uav", GRID.shape), SharedMap("other", GRID.shape)
    for one in (shared, digest):
        one.set_initial(order[:BURNING], 0)
    (digest_message,) = digest.messages(0)
    updates = [FireUpdate(k, "other", tuple(ten.tolist())) for k, ten in enumerate(tens)]
    arrival_s = np.full(500 * 500, np.inf)
    arrival_s[order] = np.arange(500 * 500) / NEW_S
    arrival_s = arrival_s.reshape(GRID.shape)
    monitoring = MonitoringArea(GRID, near_m, settings.monitoring_m)
    monitoring.add_fire(order[:BURNING])
    agents_m = np.random.default_rng(2).uniform(2000.0, 3000.0, (8, 2))
    views = [(x_m, y_m, 1.0, 152.8, 130.0) for x_m, y_m in agents_m]
    seen_s = np.zeros(GRID.shape)
    at_s, view = BURNING / NEW_S, (2500.0, 2800.0, 1.0, 152.8, 130.0)
    fire = monitoring.fire.copy()
    on, off = [(ten, NONE) for ten in tens], [(NONE, ten) for ten in tens]
    update_calls = [(update,) for update in updates]
    times = {
        "agent maps: 10 new cells": each_us(maps.set, on),
        "agent maps: 10 cleared": each_us(maps.set, off),
        "shared map: receive the same digest": each_us(
            shared.on_message, [(digest_message,)] * 500
        ),
        "shared map: receive 10 new cells": each_us(shared.on_message, update_calls),
        "shared map: receive them again": each_us(shared.on_message, update_calls),
        "shared map: no message due": each_us(shared.messages, [(5,)] * 500),
        "look": each_us(changed_cells, [(GRID, view, arrival_s, at_s, fire)] * 500),
        "mark": each_us(mark_seen, [(GRID, view, seen_s, at_s)] * 500),
        "monitoring: 10 new cells": each_us(monitoring.add_fire, [(ten,) for ten in tens]),
        "agent coverage of 8": each_us(monitoring.agent_coverage, [(agents_m, 302.8)] * 101),
        "seen coverage": each_us(monitoring.seen_coverage, [(seen_s, at_s)] * 101),
        "efficiency of 8": each_us(monitoring.efficiency, [(views,)] * 101),
        "inaccuracy of 8": each_us(inaccuracy_cells, [(fire, [maps.fire] * 8)] * 101),
    }
    began = time.perf_counter()
    AgentMaps(GRID.shape, GRID.cell_m, near_m, area_m).set(order[:BURNING], NONE)
    times["agent maps: the first cells"] = (time.perf_counter() - began) * 1e6
    return times


def shared(order: NDArray[np.int64], count: int, loss: float, seconds: int) -> str:
    """Return a line with the wrong cells and the traffic of ``count`` shared maps."""
    rng = np.random.default_rng(count)
    team = [SharedMap(f"uav{k}", GRID.shape) for k in range(count)]
    for one in team:
        one.set_initial(order[:BURNING], 0)
    truth = np.zeros(500 * 500, dtype=np.bool_)
    truth[order[:BURNING]] = True
    burned, wrong, longest = BURNING, [], 0
    sent_bytes: dict[str, int] = defaultdict(int)
    under_way: list[tuple[int, MapMessage]] = []
    began = time.perf_counter()
    for tick in range(4 * seconds):
        arrived, under_way = under_way, []
        for receiver, message in arrived:
            team[receiver].on_message(message)
        while burned < BURNING + NEW_S * tick / 4:
            truth[order[burned]] = True
            for k in set(rng.integers(0, count, 2).tolist()):
                team[k].add_view(order[burned : burned + 1], NONE, tick * TICK_US)
            burned += 1
        for k, one in enumerate(team):
            for message in one.messages(tick * TICK_US):
                size = len(msgspec.json.encode(message))
                question = isinstance(message, Digest) and message.end == 0
                sent_bytes["question" if question else type(message).__name__] += size
                longest = max(longest, size)
                receivers = np.flatnonzero(rng.random(count) >= loss).tolist()
                under_way += [(i, message) for i in receivers if i != k]
        if tick % 4 == 3:
            maps = [one.fire for one in team]
            wrong.append(inaccuracy_cells(truth.reshape(GRID.shape), maps))
    took_s = time.perf_counter() - began
    kinds = ", ".join(f"{kind} {size / seconds / count:.0f}" for kind, size in sent_bytes.items())
    return (
        f"{count:3d} UAVs, {loss:4.0%} lost: {np.mean(wrong[10:]):5.2f} cells wrong, "
        f"{sum(sent_bytes.values()) / seconds / count:4.0f} bytes/s each "
        f"({kinds}; longest {longest}), {seconds / took_s:.0f} x real time"
    )


def main() -> None:
    """Print the step times and the lines of all simulations."""
    order = rough_disc()
    for name, us in steps(order).items():
        click.echo(f"{us:10.1f} us  {name}")
    for count in (2, 8, 64):
        for loss in (0.0, LOST):
            click.echo(shared(order, count, loss, 120 if count < 64 else 60))


if __name__ == "__main__":
    main()
