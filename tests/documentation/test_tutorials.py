"""The commands of the tutorials, run in order as a reader runs them."""

from pathlib import Path

import pytest

from mission_service.config.scenario import SHIPPED
from tests.documentation.pages import ROOT, blocks_of, run_page
from tests.service.test_live import free_port

DOCS = ROOT / "docs"
TUTORIALS = ("my-fire", "simulators", "write-a-planner", "write-a-sensor")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "work"
    made.mkdir()
    return made


def own_ports(*ports: str) -> dict[str, str]:
    return {port: str(free_port()) for port in ports}


@pytest.mark.parametrize("name", TUTORIALS)
def test_each_command_of_a_tutorial_is_in_a_block_that_is_run(name: str) -> None:
    blocks = blocks_of(DOCS / f"{name}.md")
    commands = [each for each in blocks if "mission-service " in each.text]
    assert {each.language for each in commands} <= {"sh"}
    assert len(commands) >= 2


@pytest.mark.long
def test_my_fire_and_my_aircraft(folder: Path) -> None:
    outputs = run_page(DOCS / "my-fire.md", folder, own_ports("14550", "8765"))
    assert (folder / "out/compared/report.html").is_file()
    assert "0 differences" in outputs[-1] or "equal" in outputs[-1]
    assert "missions: " in outputs[-2]


@pytest.mark.long
def test_a_simulator_of_an_autopilot_is_replaced_by_mocks_on_its_ports(folder: Path) -> None:
    text = (SHIPPED / "sitl.toml").read_text(encoding="utf-8")
    for old, new in own_ports("14540", "5760", "8765").items():
        text = text.replace(old, new)
    (folder / "sitl").write_text(text, encoding="utf-8")  # is read instead of the shipped one
    both, one = run_page(DOCS / "simulators.md", folder, {})
    assert "hawk: " in both
    assert "kite: " in both
    assert "hawk: " in one


@pytest.mark.long
def test_a_planner_of_one_s_own(folder: Path) -> None:
    outputs = run_page(DOCS / "write-a-planner.md", folder, {})
    assert "all decisions equal the recorded" in outputs[-2]
    assert (folder / "compared/report.html").is_file()


@pytest.mark.long
def test_a_sensor_of_one_s_own(folder: Path) -> None:
    outputs = run_page(DOCS / "write-a-sensor.md", folder, {})
    assert outputs[-1].splitlines()[-1] == "1"
