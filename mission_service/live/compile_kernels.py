"""Compile the kernels for all rules: ``python -m mission_service.live.compile_kernels``.

A run that starts later loads the kernels from the disk cache. The container image and the tests
use this command.
"""

import numpy as np

from firemodel.spread.schemes import SCHEMES
from firemodel.wind import REFERENCE_M, surface_of_height, terrain_wind
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.warm_up import warm_up as warm_up_fire
from mission_service.guidance.registry import way_of

# Shipped scenarios and rules that together use the planners of all ways of flying.
RULES_OF = {
    "demo": ("predictive", "islam_hu_damped", "informative"),
    "team": ("team.balanced", "team.circling"),
    "virtual-agents": ("formation",),
    "burn": ("burn",),
}


def main() -> None:
    """Run the warm-ups of the rules in ``RULES_OF``, of all spread schemes and of the wind."""
    for name, rules in RULES_OF.items():
        for rule in rules:
            scenario = load_scenario(name, (f'planner.rule="{rule}"',))
            way_of(scenario).warm_up(scenario, landscape_of(scenario))
    for scheme in SCHEMES:
        warm_up_fire(load_scenario("demo", (f'fire.scheme="{scheme}"',)))
    slope = np.add.outer(np.arange(4.0), np.arange(4.0))
    terrain_wind(slope, 30.0, surface_of_height(np.ones(slope.shape))).responses(REFERENCE_M)


if __name__ == "__main__":
    main()
