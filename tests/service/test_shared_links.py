"""Several vehicles on one link: the daemon with mocks behind one port, and refused scenarios."""

import subprocess
from pathlib import Path

import pytest

from mission_service.config.scenario import load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_check import check
from mission_service.replay.verification import verify
from tests.service.test_forged_frames import Run
from tests.service.test_live import CLI, free_port, process

HOME = "36.370784,-84.132309,347.8"


def changes(link: str) -> tuple[str, ...]:
    return (f'vehicles.1.link="{link}"', 'vehicles.1.stack="px4"')


def test_two_vehicles_behind_one_port_are_flown(tmp_path: Path) -> None:
    run = Run(tmp_path, "demo")
    for change in changes(f"udpin:127.0.0.1:{run.port}"):
        run.arguments += ["--set", change]
    mocks = ["mock", "--stack", "px4", "--count", "2", "--home", HOME, "--speedup", "20"]
    mocks += ["--link", f"udpout:127.0.0.1:{run.port}", "--param", "MIS_TKO_LAND_REQ=0"]
    with process(run.arguments, run.log) as run.daemon:
        with process(mocks, tmp_path / "mocks.log"):
            run.wait_for(run.logged("connected (px4 plane)", 2))
            run.wait_for(run.logged("start mission: accepted", 2))
            for name in ("hawk", "kite"):
                run.wait_for(lambda name=name: flown(run, name))  # type: ignore[misc]
        run.wait_for(run.logged("link lost", 2))
        run.stop()
    assert "source/" not in run.log.read_text(encoding="utf-8")
    assert not run.events("VehicleRebooted")
    assert verify(tmp_path / "journal.jsonl").difference is None


def flown(run: Run, name: str) -> bool:
    positions = [event for event in run.events("Telemetry") if event["vehicle"] == name]
    return bool(positions) and positions[-1]["altitude_relative_m"] > 30.0


@pytest.mark.parametrize(
    ("sets", "words"),
    [
        (("vehicles.1.system_id=1",), "hawk and kite have the system id 1 on one link"),
        (('vehicles.1.signing_key="env:KEY"',), "signing_key must be the same for both"),
        (("vehicles.1.signing_link_id=7",), "signing_link_id must be the same for both"),
        (('vehicles.1.link="udpin:0.0.0.0:14550"',), "open the same port"),
        (('vehicles.1.link="tcp:127.0.0.1:14550"',), ""),
        ((), ""),
    ],
)
def test_vehicles_that_cannot_share_a_link_are_reported_in_one_line(
    sets: tuple[str, ...], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KEY", "k" * 32)
    scenario = load_scenario("demo", (*changes("udpin:127.0.0.1:14550"), *sets))
    if not words:
        check(scenario)
        return
    with pytest.raises(ScenarioError, match=words) as raised:
        check(scenario)
    assert "\n" not in str(raised.value)


def test_a_shared_link_with_mavsdk_is_refused() -> None:
    sets = (*changes("udpin:127.0.0.1:14550"), 'vehicles.1.backend="mavsdk"')
    with pytest.raises(ScenarioError, match="each vehicle needs a separate port"):
        check(load_scenario("demo", sets))


@pytest.mark.parametrize("command", [["config", "check"], ["run"]])
def test_check_and_run_refuse_the_same_id_twice_alike(tmp_path: Path, command: list[str]) -> None:
    arguments = [*command, "demo"]
    if command == ["run"]:
        arguments += ["--out", str(tmp_path)]
    port = free_port()
    sets = [f'vehicles.{n}.link="udpin:127.0.0.1:{port}"' for n in (0, 1)]
    if command == ["run"]:
        sets.append('service.http.listen="127.0.0.1:0"')
    for change in (*sets, "vehicles.1.system_id=1"):
        arguments += ["--set", change]
    found = subprocess.run([*CLI, *arguments], capture_output=True, text=True, timeout=300)
    assert found.returncode == 1
    assert "hawk and kite have the system id 1 on one link" in found.stderr
    assert found.stderr.count("\n") == 1
