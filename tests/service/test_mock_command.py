"""The command ``mock`` as a process, and its errors of one line."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from mission_service.config.scenario import scenario_path
from mission_service.errors import MissionServiceError
from mission_service.simulation.mock_processes import (
    MockEnvironment,
    by_hand,
    from_scenario,
    listening,
    read_wind,
    run,
)
from tests.patience import PATIENCE_S
from tests.service.test_cli import call
from tests.service.test_live import CLI, free_port


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--wind", "5"), "--wind 5: write it as FROM_DEG,SPEED_M_S"),
        (("--wind", "240,x"), "FROM_DEG,SPEED_M_S"),
        (("--wind", "240,nan"), "nan is not between 0 and 60"),
        (("--home", "95,0,0"), "95 is not between -90 and 90"),
        (("--terrain", "301"), "is below the ground"),
        (("--fault", "rebot@3"), "unknown fault; the faults are loss=SHARE"),
        (("--fault", "refuse=3:0"), "a whole number from 1 to 15"),
        (("--listen", "udpout:127.0.0.1:9"), "not a listening link"),
        (("--listen", "127.0.0.1"), "write it as udpin:HOST:PORT"),
    ],
)
def test_bad_words_get_one_line_and_exit_code_1(arguments: tuple[str, ...], words: str) -> None:
    result = call("mock", *arguments)
    assert result.exit_code == 1
    assert words in result.stderr
    assert result.stderr.count("\n") == 1


def test_without_a_scenario_the_vehicle_is_a_kind() -> None:
    result = call("mock", "--vehicle", "owl")
    assert result.exit_code == 2
    assert "without a scenario, use plane, vtol or copter" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("default", "--stack", "px4"),
        ("default", "--home", "36,-84,300"),
        ("default", "--system-id", "3"),
        ("--listen", "127.0.0.1:9", "--link", "udpout:127.0.0.1:9"),
    ],
)
def test_options_without_effect_are_refused(arguments: tuple[str, ...]) -> None:
    result = call("mock", *arguments)
    assert result.exit_code == 2
    assert arguments[-2] in result.stderr


def test_links_to_listen_on() -> None:
    assert listening("127.0.0.1:9") == "udpin:127.0.0.1:9"
    assert listening("tcpin:127.0.0.1:9") == "tcpin:127.0.0.1:9"


def test_a_fleet_by_hand_has_all_it_was_ordered() -> None:
    around = MockEnvironment(read_wind("270,4"), 20.0, 250.0, ("loss=0.5",), 7)
    fleet = by_hand("ardupilot", "copter", 5, "36.5,-84,300", 3, around)
    assert [mock.system_id for mock in fleet.mocks] == [5, 6, 7]
    assert [round(mock.flight.frame.lon_deg, 6) for mock in fleet.mocks] == [
        -84.0,
        -83.999,
        -83.998,
    ]
    last = fleet.mocks[2]
    assert (last.stack.name, last.stack.vehicle) == ("ardupilot", "copter")
    assert (last.flight.wind.speed_m_s, last.flight.ground_amsl_m) == (4.0, 250.0)
    assert (last.battery_percent, last.missions.faults.loss) == (100.0, 0.5)


@pytest.fixture
def with_batteries(tmp_path: Path) -> str:
    """Return the path of a scenario with simulated batteries, which are replaced at once."""
    text = scenario_path("team").read_text().replace("\nstack =", "\nendurance_s = 1800\nstack =")
    path = tmp_path / "batteries.toml"
    path.write_text(f"{text}\n[simulation.batteries]\npacks = 1\nswap_s = 0\n")
    return str(path)


def test_the_mocks_of_a_scenario_have_its_batteries_and_one_crew(with_batteries: str) -> None:
    mocks = from_scenario(with_batteries, None, (), MockEnvironment())
    assert [each.fleet.mocks[0].battery_percent for each in mocks] == [100.0] * 4
    assert len({each.crew for each in mocks}) == 1
    assert mocks[0].crew is not None
    for each in from_scenario("team", None, (), MockEnvironment()):
        assert (each.crew, each.fleet.mocks[0].battery_percent) == (None, None)
    with pytest.raises(MissionServiceError, match="team has the table"):
        from_scenario(with_batteries, None, (), MockEnvironment(battery_minutes=20.0))


def test_the_process_of_the_mocks_replaces_used_batteries(with_batteries: str) -> None:
    (hawk,) = from_scenario(
        with_batteries, "hawk", (f"udpout:127.0.0.1:{free_port()}",), MockEnvironment()
    )
    (mock,) = hawk.fleet.mocks
    mock.battery_percent = 40.0
    end_s = time.monotonic() + PATIENCE_S

    def end_when_replaced(_line: str = "") -> None:
        if mock.battery_percent == 100.0 or time.monotonic() > end_s:
            os.kill(os.getpid(), signal.SIGTERM)
        else:
            asyncio.get_running_loop().call_later(0.01, end_when_replaced)

    run([hawk], 20.0, False, end_when_replaced)
    assert mock.battery_percent == 100.0


def system_ids_received(station: socket.socket, address: tuple[str, int]) -> set[int]:
    """Return the system ids that reply to a ground station's heartbeats."""
    codec = Codec(255, 190)
    found: set[int] = set()
    beat: Any = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    end = time.monotonic() + PATIENCE_S
    station.settimeout(0.2)
    while time.monotonic() < end and len(found) < 2:
        station.sendto(codec.encode(beat), address)
        try:
            for message in codec.decode(station.recv(2048)):
                found.add(message.get_srcSystem())
        except TimeoutError:
            continue
    return found


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_mocks_listen_report_themselves_and_end_cleanly(
    number: signal.Signals, tmp_path: Path
) -> None:
    port = free_port()
    words = ("mock", "--stack", "ardupilot", "--vehicle", "copter", "--count", "2", "--json")
    more = ("--listen", f"127.0.0.1:{port}", "--wind", "240,5")
    with (tmp_path / "errors").open("w") as errors:
        process = subprocess.Popen(
            [*CLI, *words, *more], stdout=subprocess.PIPE, stderr=errors, text=True
        )
    assert process.stdout is not None
    try:
        with process.stdout as output, socket.socket(type=socket.SOCK_DGRAM) as station:
            reports = [json.loads(output.readline()) for _ in range(2)]
            assert system_ids_received(station, ("127.0.0.1", port)) == {1, 2}
            process.send_signal(number)
            assert process.wait(timeout=PATIENCE_S) == 0
            assert output.read() == ""
    finally:
        process.kill()
        process.wait(timeout=PATIENCE_S)
    assert (tmp_path / "errors").read_text() == ""
    assert [one["system_id"] for one in reports] == [1, 2]
    assert {(one["stack"], one["vehicle"], one["wind_speed_m_s"]) for one in reports} == {
        ("ardupilot", "copter", 5.0)
    }
    assert reports[0]["link"] == f"udpin:127.0.0.1:{port}"


def test_it_does_not_outlive_the_process_at_the_other_end_of_its_standard_input() -> None:
    command = [*CLI, "mock", "--until-eof", "--link", f"udpout:127.0.0.1:{free_port()}"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as mock:
        assert mock.stdin is not None
        assert mock.stdout is not None
        assert mock.stdout.readline().startswith(b"mock ")
        assert mock.poll() is None
        mock.stdin.close()
        assert mock.wait(timeout=PATIENCE_S) == 0
