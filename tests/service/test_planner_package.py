"""The planner of docs/write-a-planner.md, in a package: installed, checked and flown."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mission_service.journal.journal_file import SegmentReader
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_live import free_port, mock

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "write-a-planner.md").read_text(encoding="utf-8")
INHERITED = os.environ.get("PYTHONPATH", "")
CLI = [sys.executable, "-m", "mission_service.cli"]
FLOWN = ("start_s=3600", "deploy_at_s=3600", "duration_s=4050", "fire.scheme=devs8")
RULE = ("planner.rule=pendulum", "pendulum.turn_every_s=40", "pendulum.radius_m=1200")


def block(language: str, contains: str) -> str:
    """Return a block of code of the guide."""
    found = re.findall(rf"^```{language}\b[^\n]*\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)
    (one,) = (text for text in found if contains in text)
    return str(one)


def install(site: Path, module: str, entry_point: str) -> None:
    """Create the files that ``pip install`` creates for a package with one module."""
    site.mkdir(exist_ok=True)
    (site / "pendulum.py").write_text(module, encoding="utf-8")
    info = site / "pendulum-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: pendulum\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[mission_service.planners]\n{entry_point}\n")


def python_path(*folders: Path) -> str:
    """Return a value of PYTHONPATH: these folders, this repository and what it was."""
    return os.pathsep.join((*map(str, folders), str(ROOT), INHERITED))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the guide's planner for all processes of a test."""
    folder = tmp_path_factory.mktemp("installed") / "site"
    (line,) = re.findall(r"^pendulum = .*$", block("toml", "entry-points"), re.MULTILINE)
    install(folder, block("python", "PENDULUM ="), line.replace('"', ""))
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("PYTHONPATH", python_path(folder))
        yield


def service(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [*CLI, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def changed(*keys: str) -> list[str]:
    return [part for key in keys for part in ("--set", key)]


@pytest.fixture(scope="module")
def flight(site: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return the journal and the summary of a simulated flight of the guide's planner."""
    out = tmp_path_factory.mktemp("flight") / "out"
    done = service("sim", "default", "--out", str(out), "--json", *changed(*FLOWN, *RULE))
    assert done.returncode == 0, done.stderr
    return out / "journal.jsonl", json.loads(done.stdout)


@pytest.mark.long
def test_it_flies_in_a_simulation_and_decides_the_same_again(
    flight: tuple[Path, dict[str, Any]],
) -> None:
    journal, summary = flight
    (vehicle,) = summary["vehicles"]
    assert vehicle["reversals"] >= 3
    assert vehicle["upload_reasons"]["turn back"] >= 3
    header = SegmentReader(journal).header
    assert header["scenario"]["pendulum"] == {"turn_every_s": 40.0, "radius_m": 1200.0}
    again = service("decide", str(journal))
    assert again.returncode == 0, again.stderr
    assert "all decisions equal the recorded" in again.stdout
    assert service("replay", str(journal), "--verify").returncode == 0
    other = service("decide", str(journal), "--planner", "circling", "--json")
    assert json.loads(other.stdout)["journal_rule"] == "pendulum"


@pytest.mark.long
def test_a_journal_is_readable_without_the_package_of_its_rule(
    flight: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = str(flight[0])
    with_package = service("replay", journal, "--planner", "circling")
    assert with_package.returncode == 0, with_package.stderr
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for command in (
        ["decide"],
        ["replay", "--verify"],
        ["report", "--out", str(tmp_path / "page")],
    ):
        done = service(*command, journal)
        assert done.returncode == 1
        assert re.fullmatch(
            r"Error: .*: the rule pendulum of this journal is from a package .*--planner RULE\)\n",
            done.stderr,
        )
    described = service("log", "info", journal)
    assert described.returncode == 0, described.stderr
    assert "positions" in described.stdout
    other = service("replay", journal, "--planner", "circling")
    assert other.returncode == 0, other.stderr
    other = service("decide", journal, "--planner", "circling", "--json")
    assert other.returncode == 0, other.stderr
    assert json.loads(other.stdout)["journal_rule"] == "pendulum"


@pytest.mark.long
@pytest.mark.usefixtures("site")
def test_it_decides_on_the_journal_of_another_rule(tmp_path: Path) -> None:
    assert service("sim", "default", "--out", str(tmp_path), *changed(*FLOWN)).returncode == 0
    done = service("decide", str(tmp_path / "journal.jsonl"), "--planner", "pendulum", "--json")
    assert done.returncode == 0, done.stderr
    (vehicle,) = json.loads(done.stdout)["vehicles"]
    assert vehicle["reversals"] >= 1, "with the defaults of its table"


def has_turned(log: str) -> bool:
    return re.search(r" [1-9]\d* reversals", log) is not None


@pytest.mark.usefixtures("site")
def test_it_flies_live(tmp_path: Path) -> None:
    port, log = free_port(), tmp_path / "daemon.log"
    link = f'vehicles.0.link="udpin:127.0.0.1:{port}"'
    run = ["run", "default", "--out", str(tmp_path), *changed(link, "start_s=3600", *RULE)]
    with log.open("wb") as output:
        daemon = subprocess.Popen([*CLI, *run], stdout=output, stderr=subprocess.STDOUT)
        try:
            with mock(port, tmp_path / "mock.log"):
                wait_until(lambda: has_turned(log.read_text(encoding="utf-8")))
                daemon.send_signal(signal.SIGTERM)
                assert daemon.wait(timeout=PATIENCE_S) == 0
        finally:
            daemon.kill()
            daemon.wait()
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary["planner"]["rule"] == "pendulum"
    assert summary["vehicles"][0]["decisions"] >= 1


def error_of(*keys: str) -> str:
    done = service("config", "check", "default", *changed(*keys))
    assert done.returncode != 0
    return done.stderr


@pytest.mark.usefixtures("site")
def test_its_table_is_checked_by_its_own_model() -> None:
    checked = service("config", "check", "default", *changed(*RULE))
    assert checked.returncode == 0, checked.stderr
    rule = "planner.rule=pendulum"
    assert "pendulum.turn_every_s: must be a number, above 0" in error_of(
        rule, "pendulum.turn_every_s=0"
    )
    assert "pendulum.turns: unknown key" in error_of(rule, "pendulum.turns=1")
    assert "pendulum: unknown key" in error_of("pendulum.turn_every_s=60")
    assert "burn, pendulum (got 'nonsense')" in error_of("planner.rule=nonsense")


MAKE = """
from mission_service.guidance.front.way import front_way

def planner(scenario, vehicle, ground):
    return None

WAY = front_way("pendulum", planner, {})
"""
FAULTS = {
    "return Pendulum(own": ("raise OSError('x'); ", "OSError: x"),
    "math.dist((row, col)": ("{}['x'] or ", "KeyError: 'x'"),
    "return Decision(": ("return 'x'; ", "'str' object has no attribute"),
    "return np.column_stack(": ("return [[math.nan, 0], [0, 0]]; ", "not finite"),
    "own = math.atan2(": ("return 'x'; ", "could not convert string to float: 'x'"),
}


@pytest.mark.parametrize("line", FAULTS)
def test_a_planner_that_fails_in_flight_is_named_with_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    fault, words = FAULTS[line]
    good = block("python", "PENDULUM =")
    assert good.count(line) == 1
    install(tmp_path / "site", good.replace(line, f"{fault}{line}"), "pendulum = pendulum:PENDULUM")
    monkeypatch.setenv("PYTHONPATH", python_path(tmp_path / "site"))
    done = service("sim", "default", "--out", str(tmp_path / "out"), *changed(*FLOWN, *RULE))
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    error = done.stderr.strip().splitlines()[-1]
    assert words in error
    assert (
        "rule pendulum (entry point pendulum = pendulum:PENDULUM of package pendulum 1.0" in error
    )
    assert "report it" not in error


@pytest.mark.parametrize(
    ("module", "entry_point", "words"),
    [
        ("import nothing_such", "pendulum = pendulum:WAY", "No module named 'nothing_such'"),
        ("WAY = 1", "pendulum = pendulum:WAY", "it must be a WayOfFlying"),
        ("raise SystemExit(7)", "pendulum = pendulum:WAY", "SystemExit: 7"),
        (
            MAKE.format("section={'a': 1}"),
            "pendulum = pendulum:WAY",
            "a pydantic model (got {'a': 1})",
        ),
        (
            MAKE.format(""),
            "pendulum = pendulum:WAY",
            "TypeError: the planner of hawk (NoneType) lacks",
        ),
        ("WAY = 1", "circling = pendulum:WAY", "has the name of a rule of this service"),
        ("WAY = 1", "Pen-dulum = pendulum:WAY", "lower-case letters, digits and _"),
    ],
)
def test_a_package_that_cannot_be_used_is_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    entry_point: str,
    words: str,
) -> None:
    install(tmp_path / "site", module, entry_point)
    monkeypatch.setenv("PYTHONPATH", python_path(tmp_path / "site"))
    rule = entry_point.partition(" ")[0]
    error = error_of(f"planner.rule={rule}")
    assert words in error
    assert f"entry point {entry_point}" in error
    assert "Traceback" not in error


def test_without_a_package_that_cannot_be_used_other_rules_fly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path / "site", "import nothing_such", "pendulum = pendulum:WAY")
    monkeypatch.setenv("PYTHONPATH", python_path(tmp_path / "site"))
    assert service("config", "check", "default").returncode == 0
