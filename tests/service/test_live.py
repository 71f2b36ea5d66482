"""The daemon and the mock in two processes over UDP."""

import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from mission_service.interfaces.control.control_client import ControlClient
from mission_service.replay.verification import verify
from tests.patience import PATIENCE_S, wait_until

CLI = [sys.executable, "-m", "mission_service.cli"]
SPEEDUP = 20


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port: int = sock.getsockname()[1]
        return port


@contextmanager
def process(arguments: list[str], log: Path) -> Iterator["subprocess.Popen[bytes]"]:
    with log.open("wb") as output:
        child = subprocess.Popen([*CLI, *arguments], stdout=output, stderr=subprocess.STDOUT)
        try:
            yield child
        finally:
            if child.poll() is None:
                child.kill()
            child.wait(timeout=PATIENCE_S)


def mock(port: int, log: Path) -> AbstractContextManager["subprocess.Popen[bytes]"]:
    link = f"udpout:127.0.0.1:{port}"
    return process(["mock", "default", "--link", link, "--speedup", str(SPEEDUP)], log)


@pytest.fixture
def daemon_arguments(tmp_path: Path) -> tuple[int, list[str]]:
    port = free_port()
    return port, [
        *("run", "default", "--out", str(tmp_path)),
        *("--set", f'vehicles.0.link="udpin:127.0.0.1:{port}"'),
        *("--set", "start_s=3600", "--set", "duration_s=100000"),
    ]


def uploads_accepted(log: Path) -> int:
    """Return the number of accepted uploads in the last line about the progress."""
    counts = re.findall(r"(\d+) uploads accepted", log.read_text(encoding="utf-8"))
    return int(counts[-1]) if counts else 0


def test_daemon_and_mock_do_the_job_and_survive_the_loss_of_the_mock(
    tmp_path: Path, daemon_arguments: tuple[int, list[str]]
) -> None:
    port, arguments = daemon_arguments
    log = tmp_path / "daemon.log"

    def logged(words: str, times: int = 1) -> Callable[[], bool]:
        return lambda: log.read_text(encoding="utf-8").count(words) >= times

    with process(arguments, log) as daemon:
        with mock(port, tmp_path / "mock1.log"):
            wait_until(logged("connected (px4 plane)"))
            wait_until(logged("start mission: accepted"))
            wait_until(logged("phase: monitor"))
        wait_until(logged("link lost"))
        with mock(port, tmp_path / "mock2.log"):
            wait_until(logged("link restored"))
            wait_until(logged("autopilot restarted: it waits for an operator's order to start"))
            wait_until(logged("on the ground: it waits for an operator's order to start"))
            assert not logged("start mission: accepted", times=2)()
            with ControlClient(tmp_path) as operator:
                operator.ask(do="start", vehicle="hawk", by="ann", station="desk")
            wait_until(logged("start mission: accepted", times=2))
            wait_until(lambda: uploads_accepted(log) > 5)
            daemon.send_signal(signal.SIGTERM)
            assert daemon.wait(timeout=PATIENCE_S) == 0
    text = log.read_text(encoding="utf-8")
    assert "Traceback" not in text
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    (vehicle,) = summary["vehicles"]
    assert vehicle["uploads"]["accepted"] > 5
    missions = vehicle["missions"]
    assert missions["sent"] >= missions["accepted"] == vehicle["uploads"]["accepted"]
    assert 0 < missions["flown"] <= missions["accepted"]
    assert vehicle["takeoffs"] >= 1
    assert vehicle["in_air_s"] > 60.0
    assert vehicle["flown_km"] > 1.0
    assert vehicle["commands"]["StartMission"] >= 2
    assert vehicle["modes"]["mission"] >= 2
    assert vehicle["link_losses"] >= 1
    assert vehicle["autopilot_restarts"] >= 1
    assert vehicle["announcements"]["warning"] >= 2
    assert summary["alarms"]["link"] >= 1
    assert (summary["requests"], summary["service_restarts"]) == ({"OrderGiven": 1}, 0)
    # After a restart it continues with its earlier counts.
    went_on = logged("resumes the run of")
    with process(arguments, log) as daemon:
        wait_until(went_on)
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(timeout=PATIENCE_S) == 0
    again = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert again["service_restarts"] == 1
    for name in ("missions", "takeoffs", "in_air_s", "flown_km", "decisions", "commands", "modes"):
        assert again["vehicles"][0][name] == vehicle[name]
    result = verify(tmp_path / "journal.jsonl")
    assert (result.difference, result.cut_at_line) == (None, None)


def test_a_vehicle_that_never_answers_is_named(
    tmp_path: Path, daemon_arguments: tuple[int, list[str]]
) -> None:
    port, arguments = daemon_arguments
    log = tmp_path / "daemon.log"
    with process(arguments, log) as daemon:
        wait_until(lambda: f"no heartbeat on udpin:127.0.0.1:{port}" in log.read_text("utf-8"))
        daemon.send_signal(signal.SIGINT)
        assert daemon.wait(timeout=PATIENCE_S) == 0
    assert "the run has ended; the next start begins a new run" in log.read_text("utf-8")


def test_an_autopilot_with_another_system_id_is_named(
    tmp_path: Path, daemon_arguments: tuple[int, list[str]]
) -> None:
    port, arguments = daemon_arguments
    log = tmp_path / "daemon.log"
    plane = (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 0)
    heartbeat = Codec(7, 1).encode(mavlink.MAVLink_heartbeat_message(*plane, 3))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock,
        process(arguments, log) as daemon,
    ):

        def is_named() -> bool:
            sock.sendto(heartbeat, ("127.0.0.1", port))
            return "received instead: system 7 (px4 plane)" in log.read_text("utf-8")

        wait_until(is_named)
        daemon.send_signal(signal.SIGINT)
        assert daemon.wait(timeout=PATIENCE_S) == 0


def test_a_port_in_use_is_reported_and_an_earlier_journal_survives(
    tmp_path: Path, daemon_arguments: tuple[int, list[str]]
) -> None:
    port, arguments = daemon_arguments
    journal = tmp_path / "journal.jsonl"
    journal.write_text("an earlier run\n", encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", port))
        found = subprocess.run(
            [*CLI, *arguments], capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
    assert found.returncode == 1
    (*_, line) = found.stderr.splitlines()  # progress may come before it
    assert line.startswith("Error: ")
    assert f"127.0.0.1:{port}" in line
    assert found.stderr.count("Error") == 1
    assert journal.read_text(encoding="utf-8") == "an earlier run\n"


def test_a_recording_in_which_vehicles_look_alike_is_reported(tmp_path: Path) -> None:
    log, tlog = tmp_path / "daemon.log", tmp_path / "both.tlog"
    links = [f'vehicles.{n}.link="udpin:127.0.0.1:{free_port()}"' for n in (0, 1)]
    ids = [f"vehicles.{n}.system_id=1" for n in (0, 1)]
    http = 'service.http.listen="127.0.0.1:0"'  # another service may use the port of the scenario
    changes = [word for change in (*links, *ids, http) for word in ("--set", change)]
    arguments = ["run", "demo", "--out", str(tmp_path), "--tlog", str(tlog), *changes]
    with process(arguments, log) as daemon:
        wait_until(lambda: "cannot be distinguished in it" in log.read_text("utf-8"))
        daemon.send_signal(signal.SIGINT)
        assert daemon.wait(timeout=PATIENCE_S) == 0
