"""The daemon flies a team over UDP: mocks of both stacks in separate processes."""

import json
import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from mission_service.config.scenario import SHIPPED
from mission_service.replay.verification import verify
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_live import free_port, process

SPEEDUP = "20"


def scenario_of(folder: Path) -> tuple[Path, Path]:
    """Write the shipped team on free ports: complete, and without swift."""
    text = (SHIPPED / "team.toml").read_text(encoding="utf-8")
    text = re.sub(r"127\.0\.0\.1:\d+", lambda _: f"127.0.0.1:{free_port()}", text)
    text = text.replace("start_s = 3500", "start_s = 3600").replace("team.balanced", "team.bumper")
    text = text.replace("duration_s = 14400", "duration_s = 100000")
    whole, rest = folder / "whole.toml", folder / "rest.toml"
    whole.write_text(text, encoding="utf-8")
    head, *vehicles = text.split("[[vehicles]]")
    others = [each for each in vehicles if '"swift"' not in each]
    rest.write_text("[[vehicles]]".join([head, *others]), encoding="utf-8")
    return whole, rest


@pytest.mark.long
def test_the_daemon_flies_a_team_and_one_is_killed(tmp_path: Path) -> None:
    whole, rest = scenario_of(tmp_path)
    log = tmp_path / "daemon.log"

    def logged(words: str) -> Callable[[], bool]:
        return lambda: re.search(words, log.read_text(encoding="utf-8")) is not None

    def uploads_of(name: str) -> int:
        found = re.findall(rf"{name}: .* (\d+) uploads accepted", log.read_text(encoding="utf-8"))
        return int(found[-1]) if found else 0

    flags = ["--speedup", SPEEDUP]
    with (
        process(["run", str(whole), "--out", str(tmp_path)], log) as daemon,
        process(["mock", str(rest), *flags], tmp_path / "mocks.log"),
    ):
        with process(["mock", str(whole), "--vehicle", "swift", *flags], tmp_path / "swift.log"):
            for name in ("hawk", "kite", "swift", "wren"):
                wait_until(logged(rf"{name}: connected"))
            for name in ("hawk", "kite", "swift", "wren"):
                wait_until(logged(rf"{name}: start mission: accepted"))
            wait_until(logged("swift: phase: (initial circle|monitor)"))
        wait_until(logged("swift: no heartbeat"))
        for name in ("hawk", "kite", "wren"):
            wait_until(logged(f"{name}: phase: monitor"))
        uploads = uploads_of("hawk")
        wait_until(lambda: uploads_of("hawk") > uploads)
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(timeout=PATIENCE_S) == 0
    assert "Traceback" not in log.read_text(encoding="utf-8")
    assert len((tmp_path / "mocks.log").read_text(encoding="utf-8").splitlines()) == 3
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary["closest_pair_m"] >= summary["separation_m"]
    result = verify(tmp_path / "journal.jsonl")
    assert (result.difference, result.cut_at_line) == (None, None)
