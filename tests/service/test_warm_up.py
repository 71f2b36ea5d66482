"""The warm-ups compile all kernels that an agent or the estimate uses in flight."""

import re
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest

from mission_service.config.scenario import load_scenario
from mission_service.fire import warm_up as fire_warm_up
from mission_service.live import compile_progress, daemon
from tests.patience import PATIENCE_S

COMPILED = """
import sys

import numpy as np
from numba.core.dispatcher import Dispatcher


def compiled(package):
    return {
        f"{module.__name__}.{name}": len(value.signatures)
        for module in [sys.modules[name] for name in sys.modules if name.startswith(package)]
        for name, value in vars(module).items()
        if isinstance(value, Dispatcher)
    }


"""
FLIES = """
from mission_service.experiments.virtual_agents.ideal_world import FormationWorld, Rules
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.warm_up import warm_up


if "warm" in sys.argv:
    scenario = load_scenario("virtual-agents")
    warm_up(scenario, landscape_of(scenario))
package = "mission_service.guidance.formation."
before = compiled(package)
arrival_s = np.full((500, 500), np.inf)
arrival_s[240:260, 240:260] = 0.0
arrival_s[260:270, 240:260] = 20.0
world = FormationWorld(arrival_s, 3, Settings(), Rules(loss_at=lambda at_s: 0.5), seed=1)
for _ in range(4 * 120):
    world.tick()
after = compiled(package)
print(",".join(name for name in after if after[name] != before.get(name, 0)))
"""


BURNS = """
from mission_service.config.scenario import load_scenario
from mission_service.events import Corrected, Telemetry, WindSet
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import fire_position, landscape_of
from mission_service.fire.simulated_cameras import cameras_of
from mission_service.fire.warm_up import warm_up

scenario = load_scenario("default", (f"fire.scheme={sys.argv[1]}",))
warm_up(scenario)
before = compiled("firemodel.spread.")
landscape = landscape_of(scenario)
estimate, cameras = RunEstimate(scenario, landscape), cameras_of(scenario, landscape)
place = landscape.lat_lon_of(*fire_position(scenario, landscape))
near = tuple((place[0] + north, place[1] + east) for north, east in ((0, 0), (5e-3, 0), (0, 5e-3)))
for at_s in range(3600, 7800, 60):
    at_us = at_s * 1_000_000
    fix = Telemetry(at_us, "hawk", *place, 700.0, 150.0, 15.0, 0.0, 0.0)
    estimate.on_event(fix)
    estimate.on_event(cameras.seen_from(fix))
    estimate.advance(at_us)
    if at_s == 4800:
        estimate.apply_report(Corrected(at_us, "ann", "", "burned", "polygon", near, at_us))
    if at_s == 6000:
        estimate.apply_report(WindSet(at_us, "ann", "", 3.0, 90.0))
estimate.fire.front(estimate.fire.time_s)
after = compiled("firemodel.spread.")
print(",".join(name for name in before if before[name]))
print(",".join(name for name in after if after[name] != before.get(name, 0)))
"""

CORRECTS = """
from mission_service.guidance.registry import way_of
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import Observed
from mission_service.fire.scenario_fire import fire_position, landscape_of

scenario = load_scenario("default", (f'planner.rule="{sys.argv[1]}"',))
landscape = landscape_of(scenario)
if "warm" in sys.argv:
    way_of(scenario).warm_up(scenario, landscape)
before = compiled("mission_service.")
middle = landscape.row_col_of(*fire_position(scenario, landscape))
row, col = (round(float(value)) - 6 for value in middle)
core = Core(scenario, landscape)
for fire in "bu":  # an operator adds burned ground, then removes it
    core.handle(Observed(3_600_000_000, "hawk", row, col, (fire * 12,) * 12, corrects=True))
after = compiled("mission_service.")
print(",".join(name for name in after if after[name] != before.get(name, 0)))
"""


def compiled_in_flight(code: str, *arguments: str) -> str:
    child = subprocess.run(
        [sys.executable, "-c", COMPILED + code, *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    return child.stdout.strip()


def test_nothing_is_compiled_in_flight() -> None:
    assert "intent" in compiled_in_flight(FLIES)  # the check detects it
    assert compiled_in_flight(FLIES, "warm") == ""


@pytest.mark.parametrize("rule", ["predictive", "islam_hu_damped"])
def test_nothing_is_compiled_when_an_operator_corrects_the_fire(rule: str) -> None:
    assert "taken_back" in compiled_in_flight(CORRECTS, rule)  # the check detects it
    assert compiled_in_flight(CORRECTS, rule, "warm") == ""


LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("scheme", "kernel"),
    [
        ("anyangle", "burn_until"),
        pytest.param("devs8", "devs8_kernels", marks=LONG),
        pytest.param("probabilistic", "probabilistic_kernels", marks=LONG),
    ],
)
def test_nothing_is_compiled_while_the_estimate_burns(scheme: str, kernel: str) -> None:
    before, *in_flight = compiled_in_flight(BURNS, scheme).split("\n")
    assert kernel in before
    assert in_flight == []


def test_a_start_that_takes_long_is_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    shown = threading.Event()

    def notice(line: str) -> None:
        lines.append(line)
        if len(lines) == 2:
            shown.set()

    scenario = load_scenario("default")
    monkeypatch.setattr(compile_progress, "NOTICE_AFTER_S", 0.0)
    monkeypatch.setattr(compile_progress, "PROGRESS_EVERY_S", 0.001)
    monkeypatch.setattr(daemon, "way_of", lambda scenario: SimpleNamespace(warm_up=print))
    monkeypatch.setattr(daemon, "warm_up_fire", lambda scenario: shown.wait(PATIENCE_S))
    daemon._warm_up(scenario, None, notice)  # type: ignore[arg-type]
    assert lines[0] == compile_progress.LOADS
    found = re.fullmatch(r"compiled (\d+) of about (\d+) functions", lines[1])
    assert found is not None
    assert 0 <= int(found[1]) <= int(found[2]) > 50
    lines.clear()
    monkeypatch.setattr(compile_progress, "NOTICE_AFTER_S", PATIENCE_S)
    monkeypatch.setattr(daemon, "warm_up_fire", lambda scenario: None)
    daemon._warm_up(scenario, None, notice)  # type: ignore[arg-type]
    assert lines == []


def test_the_small_fire_has_a_control_line_of_its_own() -> None:
    """The lines of the scenario are elsewhere, so that the run would not start."""
    lines = ("suppression=[{points = [[36.36, -84.15], [36.37, -84.15]]}]",)
    scenario = load_scenario("default", lines)
    assert scenario.suppression
    fire_warm_up.warm_up(scenario)
    assert not fire_warm_up._small(load_scenario("default")).suppression


def test_the_small_fire_has_trees_if_the_scenario_has_crown_fire() -> None:
    """A level landscape has no layers of trees, so that the run would not start."""
    fire_warm_up.warm_up(load_scenario("default", ("fire.crown=rothermel",)))
