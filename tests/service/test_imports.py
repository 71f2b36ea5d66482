"""The house rules on who may import what."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("firemodel", "autopilot_bridge", "mission_service")
MAY_IMPORT = {
    "firemodel": {"firemodel"},
    "autopilot_bridge": {"autopilot_bridge"},
    "mission_service": set(PACKAGES),
}
IMPURE = {"time", "random", "asyncio", "socket", "selectors", "threading"}
CLOCKS = {"now", "utcnow", "today", "fromtimestamp"}
# The thin shell: what touches clocks, sockets and processes.
SHELL = {
    "autopilot_bridge/connection.py",
    "autopilot_bridge/link.py",  # a seeded random.Random, given as a seed
    "autopilot_bridge/mavsdk_vehicle.py",
    "autopilot_bridge/mock/process.py",
    "autopilot_bridge/sockets.py",
    "autopilot_bridge/wires.py",
    "mission_service/api/answers.py",
    "mission_service/api/context.py",
    "mission_service/api/door.py",
    "mission_service/api/fire.py",
    "mission_service/api/guard.py",
    "mission_service/api/journal.py",
    "mission_service/api/journal_lines.py",
    "mission_service/api/live.py",
    "mission_service/api/missions.py",
    "mission_service/api/perimeter.py",  # a process of its own
    "mission_service/api/server.py",
    "mission_service/bench.py",
    "mission_service/burn_cli.py",
    "mission_service/cli.py",
    "mission_service/api/app.py",  # what is heavy goes to threads
    "mission_service/clocks.py",
    "mission_service/control.py",
    "mission_service/control_client.py",
    "mission_service/daemon.py",
    "mission_service/demo.py",
    "mission_service/feeds/cot_sender.py",
    "mission_service/flights/live.py",
    "mission_service/flights/live_cli.py",
    "mission_service/formation_mqtt.py",
    "mission_service/hub.py",
    "mission_service/keeping.py",
    "mission_service/links.py",
    "mission_service/logs.py",  # says when a line was written
    "mission_service/maps/believed.py",
    "mission_service/maps/forecast.py",
    "mission_service/mocks.py",
    "mission_service/mqtt/connection.py",
    "mission_service/maps/of_run.py",  # in a thread
    "mission_service/mqtt/inbox.py",
    "mission_service/mqtt/publisher.py",
    "mission_service/notify.py",
    "mission_service/transfers.py",
    "mission_service/tuning.py",  # DEAP draws from the one random generator, seeded there
}


def modules() -> list[Path]:
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute here"
            names.add((node.module or "").split(".")[0])
    return names


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_run_one_way_and_the_core_is_pure(path: Path) -> None:
    name = str(path.relative_to(ROOT))
    found = imported(path)
    assert found & set(PACKAGES) <= MAY_IMPORT[name.split("/")[0]]
    if name not in SHELL:
        assert not found & IMPURE, f"{name} imports {sorted(found & IMPURE)}"


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_only_the_shell_asks_what_time_it_is(path: Path) -> None:
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    asked = {node.attr for node in nodes if isinstance(node, ast.Attribute)} & CLOCKS
    if str(path.relative_to(ROOT)) not in SHELL:
        assert not asked, f"{path} asks for {sorted(asked)}"


def test_the_packages_are_found() -> None:
    assert len(modules()) > 30
