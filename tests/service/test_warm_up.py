"""The warm-up compiles all kernels that an agent uses in flight."""

import subprocess
import sys

FLIES = """
import sys

import numpy as np
from numba.core.dispatcher import Dispatcher

from mission_service.experiments.virtual_agents.ideal_world import FormationWorld, Rules
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.warm_up import warm_up


def compiled():
    of_agents = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("mission_service.guidance.formation.")
    ]
    return {
        f"{module.__name__}.{name}": len(value.signatures)
        for module in of_agents
        for name, value in vars(module).items()
        if isinstance(value, Dispatcher)
    }


if "warm" in sys.argv:
    scenario = load_scenario("virtual-agents")
    warm_up(scenario, landscape_of(scenario))
before = compiled()
arrival_s = np.full((500, 500), np.inf)
arrival_s[240:260, 240:260] = 0.0
arrival_s[260:270, 240:260] = 20.0
world = FormationWorld(arrival_s, 3, Settings(), Rules(loss_at=lambda at_s: 0.5), seed=1)
for _ in range(4 * 120):
    world.tick()
after = compiled()
print(",".join(name for name in after if after[name] != before.get(name, 0)))
"""


def compiled_in_flight(*arguments: str) -> str:
    child = subprocess.run(
        [sys.executable, "-c", FLIES, *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    return child.stdout.strip()


def test_nothing_is_compiled_in_flight() -> None:
    assert "intent" in compiled_in_flight()  # the check detects it
    assert compiled_in_flight("warm") == ""
