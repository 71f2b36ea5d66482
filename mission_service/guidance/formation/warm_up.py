"""Compiles the formation's kernels before flight; the first compilation takes many seconds."""

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.guidance.formation.agent import Agent, OwnState
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings
from mission_service.peer_messages import FireUpdate

STEPS = 60
STEP_US = 250_000


def warm_up(scenario: Scenario, landscape: Landscape) -> None:
    """Run three agents for a few steps near a small fire; all fire updates are lost.

    The steps call every kernel of an agent, so that each kernel is compiled or loaded from the disk
    cache. The compiler distinguishes arrays with one row from arrays with several rows. Therefore
    each agent first runs without messages, and then receives the messages of the other two.
    """
    grid = MapGrid(64, 64, 10.0, 0.0, 640.0)
    fire = np.array([32 * 64 + 32])
    avoidance = scenario.formation.avoidance
    agents = [Agent(name, Settings(), grid, fire, 0, avoidance) for name in ("one", "two", "three")]
    for step in range(1, STEPS):
        at_us = step * STEP_US
        for number, agent in enumerate(agents):
            east_m = 100.0 + 200.0 * number
            seen = fire + step + 64 * number
            agent.add_view(seen, seen + 128, at_us)
            agent.step(OwnState(at_us, east_m, 20.0 + 4.0 * step, 300.0, 0.0, 17.0, 17.0, 1.0, 1.0))
            for message in agent.messages(at_us):
                for other in agents:
                    if other is not agent and not isinstance(message, FireUpdate):
                        other.on_message(message)
