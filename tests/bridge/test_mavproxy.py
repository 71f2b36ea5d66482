"""MAVProxy, controlled by its prompt, with the mock."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from autopilot_bridge.items import Items, Plan
from autopilot_bridge.missions.wpl_file import write_wpl
from tests.bridge.mock_process import HOME, free_port, mock_process, short_mission
from tests.patience import PATIENCE_S

MODULES = "wp,mode,arm,misc,cmdlong,ftp"


class Prompt:
    """The output of MAVProxy, and a function to enter commands."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self._text = ""
        self._seen = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while letters := os.read(self._process.stdout.fileno(), 4096):
            self._text += letters.decode(errors="replace")

    def type(self, line: str) -> None:
        """Enter a line; ``wait`` then searches only later output."""
        assert self._process.stdin is not None
        self._seen = len(self._text)
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def wait(self, words: str, within_s: float = PATIENCE_S) -> None:
        """Wait until the words are printed."""
        end = time.monotonic() + within_s
        while words not in self._text[self._seen :]:
            if time.monotonic() > end:
                pytest.fail(f"MAVProxy did not print {words!r}:\n{self._text[-2000:]}")
            time.sleep(0.02)


@contextmanager
def mavproxy(port: int, folder: Path) -> Iterator[Prompt]:
    command = [sys.executable, "-m", "MAVProxy.mavproxy", "--master", f"udpin:127.0.0.1:{port}"]
    command += ["--state-basedir", str(folder), "--aircraft", "mock"]
    command += ["--default-modules", MODULES]
    process = subprocess.Popen(
        command,
        cwd=folder,
        env={**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield Prompt(process)
    finally:
        process.kill()
        process.wait(timeout=PATIENCE_S)
        process.stdin.close()
        process.stdout.close()


# For each autopilot: the way from the ground into its mission, and a mode in which uploads are
# allowed.
FLY = {
    ("ardupilot", "plane"): ("arm throttle", "mode AUTO"),
    ("px4", "plane"): ("arm throttle", "long DO_SET_MODE 1 4 4"),
}


def written(folder: Path, mission: Items, home: tuple[float, float, float] | None) -> Path:
    """Write a WPL file; PX4 has no home, so its first item is at the place of home."""
    path = folder / "sent.txt"
    write_wpl(path, Plan(mission, home=home))
    if home is None:
        lines = path.read_text(encoding="utf-8").splitlines()
        items = [line.split("\t", 1)[1] for line in lines[2:]]
        numbered = [f"{index}\t{item}" for index, item in enumerate(items)]
        path.write_text("\n".join((lines[0], *numbered, "")), encoding="utf-8")
    return path


def saved(path: Path) -> list[tuple[int, ...]]:
    """Return command, latitude, longitude (1e-6 deg) and altitude (m) of the items in a file."""
    rows = [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    return [
        (int(row[3]), round(float(row[8]) * 1e6), round(float(row[9]) * 1e6), round(float(row[10])))
        for row in rows
    ]


def as_saved(mission: Items) -> list[tuple[int, ...]]:
    return [(item.command, item.x // 10, item.y // 10, round(item.z)) for item in mission]


@pytest.mark.parametrize(("name", "kind"), FLY)
def test_mavproxy_uploads_lists_flies_and_clears_on_the_mock(
    tmp_path: Path, name: str, kind: str
) -> None:
    mission = short_mission(legs=2)
    hidden = 1 if name == "ardupilot" else 0
    port = free_port()
    with mock_process(port, name, kind, speedup=20.0), mavproxy(port, tmp_path) as prompt:
        prompt.wait("online system 1")
        sent = written(tmp_path, mission, HOME if hidden else None)
        prompt.type(f"wp load {sent}")
        prompt.wait("Got MISSION_ACK: TYPE_MISSION: ACCEPTED")
        prompt.type("wp list")
        prompt.wait("Saved waypoints")
        prompt.type(f"wp save {tmp_path / 'read.txt'}")
        prompt.wait(f"Saved {len(mission) + hidden} waypoints")
        assert saved(tmp_path / "read.txt")[hidden:] == as_saved(mission)
        for line in FLY[name, kind]:
            prompt.type(line)
            prompt.wait("ACCEPTED")
        prompt.wait(f"waypoint {len(mission) - 1 + hidden}")
        prompt.type("wp clear")
        if hidden:  # refused while the mission is flown
            prompt.wait("Got MISSION_ACK: TYPE_MISSION: ERROR")
            prompt.type("mode RTL")
            prompt.wait("Got COMMAND_ACK: DO_SET_MODE: ACCEPTED")
            prompt.type("wp clear")
        prompt.wait("Got MISSION_ACK: TYPE_MISSION: ACCEPTED")
        prompt.type("wp list")
        prompt.wait("Requesting 0 waypoints")


def test_mavproxy_moves_whole_files_on_the_ardupilot_mock(tmp_path: Path) -> None:
    port = free_port()
    with mock_process(port, "ardupilot"), mavproxy(port, tmp_path) as prompt:
        prompt.wait("online system 1")
        for mission, up, done, down in (
            (short_mission(legs=60), "wp load", "Flight plan received", "wp ftp"),
            (short_mission(legs=40), "wp ftpload", "Sent waypoint of length", "wp list"),
        ):
            prompt.type(f"{up} {written(tmp_path, mission, HOME)}")
            prompt.wait(done)
            prompt.type(down)
            prompt.wait("Saved waypoints")
            prompt.type(f"wp save {tmp_path / 'read.txt'}")
            prompt.wait(f"Saved {len(mission) + 1} waypoints")
            assert saved(tmp_path / "read.txt")[1:] == as_saved(mission)
