"""Forged frames on unsigned links, with the real daemon and real UDP sockets."""

import json
import select
import signal
import socket
import subprocess
import threading
import time
import urllib.request
from collections.abc import Callable
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.links.framing import V2
from mission_service.replay.verification import verify
from tests.patience import PATIENCE_S
from tests.service.test_live import free_port, mock, process

DAYS_30_MS = 30 * 24 * 3600 * 1000
FAR_LAT_DEG = 36.50  # 14 km from the home of the vehicle
LON_DEG = -84.132


class Run:
    """A daemon with its HTTP interface, observed from outside."""

    def __init__(self, folder: Path, scenario: str = "default", *changes: str) -> None:
        self.port, self.http = free_port(), free_port()
        self.folder = folder
        self.log = folder / "daemon.log"
        self.daemon: subprocess.Popen[bytes] | None = None
        self.arguments = ["run", scenario, "--out", str(folder)]
        for change in (
            "start_s=3600",
            "duration_s=1000000",
            f'vehicles.0.link="udpin:127.0.0.1:{self.port}"',
            f'service.http.listen="127.0.0.1:{self.http}"',
            *changes,
        ):
            self.arguments += ["--set", change]

    def wait_for(self, what: Callable[[], bool], within_s: float = 300.0) -> None:
        """Wait for a condition; fail if the daemon ends or if it takes too long."""
        assert self.daemon is not None
        end_s = time.monotonic() + within_s
        while not what():
            text = self.log.read_text(encoding="utf-8")
            assert self.daemon.poll() is None, text
            assert time.monotonic() < end_s, text[-2000:]
            time.sleep(0.05)

    def logged(self, words: str, times: int = 1) -> Callable[[], bool]:
        return lambda: self.log.read_text(encoding="utf-8").count(words) >= times

    def alarms(self) -> set[str]:
        token = (self.folder / "token").read_text(encoding="utf-8").strip()
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.http}/api/v1/state",
            headers={"Authorization": f"Bearer {token}"},
        )
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return {alarm["alarm"] for alarm in json.load(answer)["alarms"]}

    def events(self, kind: str) -> list[dict[str, Any]]:
        journal = self.folder / "journal.jsonl"
        lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)[1:]
        recorded = (json.loads(line).get("event", {}) for line in lines if line.endswith("\n"))
        return [event for event in recorded if event.get("type") == kind]

    def flies_on(self, positions: int) -> None:
        """Wait until this number of further positions was used."""
        before = len(self.events("Telemetry"))
        self.wait_for(lambda: len(self.events("Telemetry")) >= before + positions)

    def stop(self) -> None:
        assert self.daemon is not None
        self.daemon.send_signal(signal.SIGINT)
        assert self.daemon.wait(timeout=300) == 0
        assert "Traceback" not in self.log.read_text(encoding="utf-8")

    def check_places_and_times(self) -> None:
        """Check that no forged position or time was used, and that no restart was detected."""
        places = self.events("Telemetry")
        assert all(place["at_us"] < 100_000 * 1e6 for place in places)
        assert all(abs(place["lat_deg"] - FAR_LAT_DEG) > 1e-4 for place in places)
        steps_us = [b["at_us"] - a["at_us"] for a, b in pairwise(places)]
        assert max(steps_us) < 100e6
        assert not self.events("VehicleRebooted")


class Forger:
    """Sends frames as a vehicle from a separate socket."""

    def __init__(self, port: int, system_id: int = 1) -> None:
        self._codec = Codec(system_id, 1)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._to = ("127.0.0.1", port)
        self.address = "{}:{}".format(*self._socket.getsockname())

    def send(self, message: Message) -> None:
        self._socket.sendto(self._codec.encode(message), self._to)

    def close(self) -> None:
        self._socket.close()


class Relay:
    """A relay between a vehicle and the daemon; forged frames have the vehicle's own remote."""

    def __init__(self, port: int) -> None:
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicles = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for each in (self._socket, self._vehicles):
            each.bind(("127.0.0.1", 0))
        self.port: int = self._vehicles.getsockname()[1]
        self._codec = Codec(1, 1)
        self._vehicle: Any = None
        self._ends = threading.Event()
        self.boot_ms = 0
        self.positions = 0  # frames of the vehicle so far
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ends.is_set():
            for ready in select.select([self._socket, self._vehicles], [], [], 0.1)[0]:
                data, address = ready.recvfrom(65536)
                if ready is self._socket and self._vehicle is not None:
                    self._vehicles.sendto(data, self._vehicle)
                elif ready is self._vehicles:
                    self._vehicle = address
                    self._socket.sendto(data, self._to)
                    if data[0] == V2 and data[7] == mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
                        (message,) = self._codec.decode(data)
                        self.boot_ms = message.time_boot_ms
                        self.positions += 1

    def send(self, message: Message) -> None:
        self._socket.sendto(self._codec.encode(message), self._to)

    def close(self) -> None:
        self._ends.set()
        self._thread.join(10)
        self._socket.close()
        self._vehicles.close()


class Passed:
    """Whether the relay has passed on this number of the vehicle's positions since then."""

    def __init__(self, relay: Relay, count: int) -> None:
        self._relay = relay
        self._until = relay.positions + count

    def __call__(self) -> bool:
        return self._relay.positions >= self._until


def position(boot_ms: int, lat_deg: float = FAR_LAT_DEG, altitude_m: float = 600.0) -> Message:
    where = (round(lat_deg * 1e7), round(LON_DEG * 1e7), round(altitude_m * 1e3), 150_000)
    return mavlink.MAVLink_global_position_int_message(boot_ms % 2**32, *where, 0, 0, 0, 0)


def heartbeat(armed: bool) -> Message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4, 128 if armed else 1, 0, 4, 3
    )


@pytest.mark.long
@pytest.mark.parametrize("backend", ["native", "mavsdk"])
def test_what_another_remote_sends_as_the_vehicle_is_not_used(tmp_path: Path, backend: str) -> None:
    run = Run(tmp_path, "default", f'vehicles.0.backend="{backend}"')
    with process(run.arguments, run.log) as run.daemon, mock(run.port, tmp_path / "mock.log"):
        run.wait_for(run.logged("start mission: accepted"))
        with closing(Forger(run.port)) as forger:
            for number in range(20):
                forger.send(heartbeat(armed=False))
                forger.send(position(DAYS_30_MS + 5000 * number))
                forger.send(position(0))
            run.wait_for(lambda: "source/hawk" in run.alarms())
            run.wait_for(run.logged(f"the messages of {forger.address} are discarded"))
            run.flies_on(50)
        run.wait_for(lambda: "source/hawk" not in run.alarms())
        run.stop()
    run.check_places_and_times()
    assert run.log.read_text(encoding="utf-8").count("are discarded") == 1
    assert verify(tmp_path / "journal.jsonl").difference is None


@pytest.mark.long
def test_what_cannot_be_of_the_vehicles_own_remote_is_not_used(tmp_path: Path) -> None:
    run = Run(tmp_path)
    with (
        process(run.arguments, run.log) as run.daemon,
        closing(Relay(run.port)) as relay,
        mock(relay.port, tmp_path / "mock.log"),
    ):
        run.wait_for(run.logged("start mission: accepted"))
        run.flies_on(200)
        relay.send(position(DAYS_30_MS))  # a single message
        for number in range(10):
            relay.send(position(relay.boot_ms + DAYS_30_MS + 5000 * number))
            relay.send(position(0))
            relay.send(position(relay.boot_ms + 30_000))
            run.wait_for(Passed(relay, 2))
        relay.send(mavlink.MAVLink_wind_cov_message(0, float("nan"), 1e38, 0, 0, 0, 0, 0, 0))
        run.wait_for(lambda: {"clock/hawk", "jump/hawk", "value/hawk"} <= run.alarms())
        run.wait_for(lambda: not run.alarms() & {"clock/hawk", "jump/hawk", "value/hawk"})
        run.stop()
    run.check_places_and_times()
    assert "source/" not in run.log.read_text(encoding="utf-8")
    assert verify(tmp_path / "journal.jsonl").difference is None


@pytest.mark.parametrize("backend", ["native", pytest.param("mavsdk", marks=pytest.mark.long)])
def test_a_takeover_of_a_silent_vehicle_raises_an_alarm(tmp_path: Path, backend: str) -> None:
    run = Run(tmp_path, "default", f'vehicles.0.backend="{backend}"')
    with process(run.arguments, run.log) as run.daemon:
        with mock(run.port, tmp_path / "mock1.log"):
            run.wait_for(run.logged("start mission: accepted"))
        run.wait_for(run.logged("link lost"))
        with closing(Forger(run.port)) as forger:
            forger.send(position(DAYS_30_MS))  # an address without a heartbeat is not accepted

            def restored() -> bool:
                forger.send(heartbeat(armed=True))
                return run.logged("link restored")()

            run.wait_for(restored)  # when the vehicle has been silent for long enough
            run.wait_for(run.logged(f"messages now arrive from {forger.address}"))
            assert "source/hawk" in run.alarms()
            forger.send(position(DAYS_30_MS))
            run.wait_for(run.logged("jumped"))
        run.stop()
    run.check_places_and_times()
