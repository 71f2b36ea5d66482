"""The files of docs/detectors.md, used with a real run as the page describes."""

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from benchmarks.mosquitto import MOSQUITTO, Mosquitto
from mission_service.events import FireObserved, RasterObserved
from mission_service.journal.journal_file import SegmentReader
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_live import free_port, process

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "detectors.md").read_text(encoding="utf-8")
HTTP_PORT, MQTT_PORT = "8765", "1883"  # on the page


@dataclass
class Run:
    """A run as on the page, on other ports."""

    folder: Path
    environment: dict[str, str]

    def does(self, *command: str) -> str:
        """Run a command of the page with the token of the detector, and return its output."""
        assert " ".join(command[-2:]) in PAGE
        done = subprocess.run(
            command,
            cwd=self.folder,
            env=os.environ | self.environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def reports(self) -> list[FireObserved | RasterObserved]:
        """Return the observations in the journal."""
        entries = SegmentReader(self.folder / "out" / "journal.jsonl")
        found = [each.content for each in entries]
        return [each for each in found if isinstance(each, FireObserved | RasterObserved)]


def of_page(language: str, words: str) -> str:
    """Return the block of the page that contains some words."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (found,) = (each for each in blocks if words in each)
    return str(found)


def token(folder: Path, line: str) -> str:
    """Run a line of the page that creates a token, and return the token."""
    words = line.partition("#")[0].split()
    assert words[:2] == ["mission-service", "token"]
    command = [sys.executable, "-m", "mission_service.cli", *words[1:]]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    folder = tmp_path_factory.mktemp("page") / "my-detector"
    shutil.copytree(DOCS / "detectors", folder)
    start = of_page("sh", "mission-service run").splitlines()
    tower = next(token(folder, each) for each in start if " token tower " in each)
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        port = str(sock.getsockname()[1])
    scenario = (folder / "fire.toml").read_text(encoding="utf-8").replace(HTTP_PORT, port)
    environment = {"TOKEN": tower, "MISSION_SERVICE": f"http://127.0.0.1:{port}"}
    with ExitStack() as stack:
        if MOSQUITTO is not None:
            broker = Mosquitto(folder)
            broker.start()
            stack.callback(broker.kill)
            environment["PORT"] = str(broker.port)
            mqtt = of_page("toml", "[service.mqtt]")
            scenario += "\n" + mqtt.replace(MQTT_PORT, str(broker.port))
        (folder / "fire.toml").write_text(scenario, encoding="utf-8")
        (line,) = (each for each in start if " run " in each)
        words = line.partition("#")[0].split()
        words = [str(folder / each) if each in ("fire.toml", "out") else each for each in words]
        link = f'vehicles.0.link="udpin:127.0.0.1:{free_port()}"'
        log = folder / "run.log"
        service = stack.enter_context(process([*words[1:], "--set", link], log))

        def ready() -> bool:
            assert service.poll() is None, log.read_text(encoding="utf-8")
            return answers(environment["MISSION_SERVICE"])

        wait_until(ready)
        yield Run(folder, environment)


def answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/healthz", timeout=5) as reply:
            return bool(reply.status == 200)
    except OSError:
        return False


def test_the_python_client_reports_a_place_and_a_raster(run: Run) -> None:
    before = len(run.reports())
    first, second = run.does("python3", "detector.py").splitlines()
    assert "'event': 'FireObserved'" in first
    assert "'event': 'RasterObserved'" in second
    place, raster = run.reports()[before:]
    for each in (place, raster):
        assert (each.by, each.role, each.source) == ("tower", "observe", "tower")
    assert place.at_us - place.seen_at_us == 2_500_000
    assert len((DOCS / "detectors" / "detector.py").read_text().splitlines()) < 35


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_the_shell_client_reports_a_place_and_a_geotiff(run: Run) -> None:
    pixels = np.zeros((20, 20), dtype=np.uint8)
    pixels[5:15, 5:15] = 1
    with rasterio.open(
        *(run.folder / "mask.tif", "w", "GTiff", 20, 20, 1),
        crs="EPSG:4326",
        transform=Affine(0.0003, 0.0, -84.160, 0.0, -0.0003, 36.375),
        dtype="uint8",
    ) as file:
        file.write(pixels, 1)
    replies = [json.loads(line) for line in run.does("sh", "detector.sh", "mask.tif").splitlines()]
    assert [each["event"] for each in replies] == ["FireObserved", "RasterObserved"]
    assert replies[1]["burned_ha_after"] - replies[1]["burned_ha_before"] > 5.0
    raster = run.reports()[-1]
    assert isinstance(raster, RasterObserved)
    assert "".join(raster.rows).count("b") == 100


@pytest.mark.skipif(
    MOSQUITTO is None or shutil.which("mosquitto_pub") is None,
    reason="mosquitto or mosquitto_pub is not installed",
)
def test_the_mqtt_client_reports_a_place(run: Run) -> None:
    before = len(run.reports())

    def arrived() -> bool:
        run.does("sh", "detector_mqtt.sh")  # a message before the subscription is lost
        return len(run.reports()) > before

    wait_until(arrived)
    report = run.reports()[-1]
    assert (report.by, report.role, report.source) == ("mqtt:tower", "", "tower")


def of_tower(run: Run) -> int:
    """Return the number of reports over HTTP."""
    return sum(each.by == "tower" for each in run.reports())


def test_a_wrong_token_and_a_wrong_place_give_one_line(run: Run) -> None:
    before = of_tower(run)
    wrong = Run(run.folder, run.environment | {"TOKEN": "x" * 43})
    assert wrong.does("python3", "detector.py").splitlines() == ["401 this token is not valid"] * 2
    client = run.folder / "detector.py"
    text = client.read_text(encoding="utf-8")
    client.write_text(text.replace("-84.1", "-54.1"), encoding="utf-8")
    place, raster = run.does("python3", "detector.py").splitlines()
    client.write_text(text, encoding="utf-8")
    assert place == "422 observe: 36.37, -54.15 is outside the landscape"
    assert raster.startswith("422 raster: contains no cell of the landscape")
    assert of_tower(run) == before
