"""The repository's rules for imports."""

import ast
import subprocess
import sys
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
# The modules that may use clocks, sockets and processes.
SHELL = {
    "autopilot_bridge/links/asyncio_connection.py",
    "autopilot_bridge/links/memory_link.py",  # a seeded random.Random, given as a seed
    "autopilot_bridge/clients/mavsdk.py",
    "autopilot_bridge/clients/mavsdk_system.py",
    "autopilot_bridge/mock/serving.py",
    "autopilot_bridge/links/sockets.py",
    "autopilot_bridge/links/reconnection.py",
    "autopilot_bridge/links/streams.py",
    "autopilot_bridge/links/udp.py",
    "mission_service/interfaces/api/responses.py",
    "mission_service/interfaces/api/context.py",
    "mission_service/interfaces/api/listener.py",
    "mission_service/interfaces/api/fire_routes.py",
    "mission_service/interfaces/api/access/guard.py",
    "mission_service/interfaces/api/journal_routes.py",
    "mission_service/interfaces/api/journal_lines.py",
    "mission_service/interfaces/api/live_stream.py",
    "mission_service/interfaces/api/mission_routes.py",
    "mission_service/interfaces/api/perimeter_routes.py",  # a separate process
    "mission_service/interfaces/api/server.py",
    "mission_service/cli/bench_commands.py",
    "mission_service/cli/burn_commands.py",
    "mission_service/cli/main.py",
    "mission_service/cli/satellite_command.py",  # the age of detections
    "mission_service/interfaces/api/app.py",  # computations run in threads
    "mission_service/runtime/clocks.py",
    "mission_service/interfaces/incident_form/form_server.py",  # a command of its own
    "mission_service/interfaces/control/control_server.py",
    "mission_service/interfaces/control/control_client.py",
    "mission_service/live/daemon.py",
    "mission_service/live/compile_progress.py",
    "mission_service/live/aircraft_sources.py",
    "mission_service/live/estimate_worker.py",
    "mission_service/live/fire_arrival_watch.py",
    "mission_service/sensors/thermal/image_folder.py",  # images have calendar times
    "mission_service/sensors/files/observation_folder.py",  # files have calendar times
    "mission_service/sensors/threaded_sensor.py",  # a thread
    "mission_service/sensors/watched_folder.py",  # measures the time of a listing
    "mission_service/sensors/video/thermal_video.py",  # images have calendar times
    "mission_service/sensors/video/video_sources.py",  # a socket
    "mission_service/simulation/demo.py",
    "mission_service/interfaces/cot/cot_sender.py",
    "mission_service/interfaces/cot/event_receiver.py",
    "mission_service/interfaces/cot/tak_connections.py",
    "mission_service/interfaces/cot/tak_endpoint.py",
    "mission_service/replay/flights/replay_server.py",
    "mission_service/cli/replay_live.py",
    "mission_service/interfaces/mqtt/peer_exchange.py",
    "mission_service/runtime/run_context.py",
    "mission_service/runtime/journal_retention.py",
    "mission_service/runtime/vehicle_links.py",
    "mission_service/runtime/service_log.py",  # adds the time to lines
    "mission_service/fire/burn_forecast.py",
    "mission_service/fire/forecast.py",
    "mission_service/simulation/mock_processes.py",
    "mission_service/interfaces/mqtt/broker_connection.py",
    "mission_service/interfaces/maps/worker_run.py",
    "mission_service/interfaces/maps/run_fronts.py",  # runs in a thread
    "mission_service/interfaces/mqtt/command_inbox.py",
    "mission_service/interfaces/mqtt/publisher.py",
    "mission_service/interfaces/notifications/notifier.py",
    "mission_service/runtime/systemd_notify.py",
    "mission_service/cli/mission_transfers.py",
    "mission_service/experiments/tuning.py",  # DEAP uses the global random generator
}


def modules() -> list[Path]:
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
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


# Modules that are slow to import. Each takes a tenth of a second or more.
SCIPY = {"scipy.linalg", "scipy.ndimage", "scipy.sparse", "scipy.spatial", "scipy.special"}
SLOW = {*SCIPY, "matplotlib.figure", "fastapi", "jinja2", "rasterio", "pyogrio"}


def loaded_by(code: str) -> set[str]:
    """Return the modules that a new process has loaded after ``code``."""
    shown = f"import sys\n{code}\nprint('\\n'.join(sys.modules))"
    arguments = [sys.executable, "-c", shown]
    done = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines())


def test_daemon_and_simulation_begin_without_slow_modules() -> None:
    modules = ("live.daemon", "simulation.sim", "replay.decisions", "runtime.run_outputs")
    code = "".join(f"import mission_service.{module}\n" for module in modules)
    loaded = loaded_by(code)
    assert "mission_service.core.core" in loaded
    assert not loaded & SLOW


def test_config_check_loads_no_compiler_and_no_core() -> None:
    loaded = loaded_by(
        "from mission_service.cli.main import main\n"
        "main(['config', 'check', 'default'], standalone_mode=False)\n"
    )
    assert "mission_service.config.scenario" in loaded
    assert not loaded & {*SLOW, "numba", "matplotlib", "rich", "mission_service.core.core"}
