"""The daemon with ``backend = "mavsdk"`` and a mock in two processes over UDP."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mission_service.config.scenario import load_scenario
from mission_service.errors import ScenarioError
from mission_service.replay.verification import verify
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_live import CLI, free_port, process

SPEEDUP = "60"


@pytest.mark.long
def test_a_vehicle_flown_through_mavsdk_circles_the_fire_once(tmp_path: Path) -> None:
    port = free_port()
    log = tmp_path / "daemon.log"
    daemon_arguments = [
        *("run", "default", "--json", "--out", str(tmp_path)),
        *("--set", 'vehicles.0.backend="mavsdk"'),
        *("--set", f'vehicles.0.link="udpin:127.0.0.1:{port}"'),
        *("--set", "start_s=3600", "--set", "duration_s=100000"),
        *("--tlog", str(tmp_path / "flight.tlog")),
    ]
    mock = ["mock", "default", "--link", f"udpout:127.0.0.1:{port}", "--speedup", SPEEDUP]
    journal = tmp_path / "journal.jsonl"

    def phase(name: str) -> bool:
        return journal.exists() and f"phase: {name}" in journal.read_text(encoding="utf-8")

    with log.open("wb") as errors:
        daemon = subprocess.Popen(
            [*CLI, *daemon_arguments], stdout=subprocess.PIPE, stderr=errors, text=True
        )
    try:
        with process(mock, tmp_path / "mock.log"):
            wait_until(lambda: phase("initial circle"))
            wait_until(lambda: phase("monitor"))
            daemon.send_signal(signal.SIGTERM)
            output, _ = daemon.communicate(timeout=PATIENCE_S)
    finally:
        daemon.kill()
        daemon.wait(timeout=PATIENCE_S)
    assert daemon.returncode == 0
    summary = json.loads(output)  # MAVSDK's own log is not mixed with the output
    # With this speed-up the mock aborts an upload after 80 ms: on a busy machine some may fail.
    assert summary["vehicles"][0]["uploads"]["accepted"] >= 1
    assert "Traceback" not in log.read_text(encoding="utf-8")
    assert (tmp_path / "flight.tlog").stat().st_size > 10_000
    assert verify(journal).difference is None


def test_mavsdk_is_imported_only_when_asked_for() -> None:
    code = "import sys, mission_service.live.daemon; print('mavsdk' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"


SECOND = {
    "name": "second",
    "link": "udpin:127.0.0.1:14551",
    "home_lat_deg": 36.6,
    "home_lon_deg": -84.2,
}


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({}, "needs a link with a separate port"),
        ({"link": "udpin:127.0.0.1"}, "write it as udpin:HOST:PORT"),
        ({"link": "udpin:0.0.0.0:14551"}, "have the same port"),
    ],
)
def test_a_missing_port_or_the_same_twice_is_reported_in_one_line(
    tmp_path: Path, changes: dict[str, str], named: str
) -> None:
    scenario = load_scenario("default")
    first = scenario.vehicles[0]
    values = {"backend": "mavsdk", **changes}
    tables = [
        {"name": "first", "home_lat_deg": first.home_lat_deg, "home_lon_deg": first.home_lon_deg}
        | values,
        SECOND,
    ]
    lines = ['name = "two"', "duration_s = 3600"]
    lines += ["[[weather]]", "at_s = 0", "wind_speed_m_s = 3", "wind_from_deg = 200"]
    lines += ["[[ignition]]", "lat_deg = 36.6", "lon_deg = -84.2"]
    for table in tables:
        lines += ["[[vehicles]]", *(f"{key} = {json.dumps(value)}" for key, value in table.items())]
    path = tmp_path / "two.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ScenarioError, match=named) as raised:
        load_scenario(str(path))
    assert "\n" not in str(raised.value)
