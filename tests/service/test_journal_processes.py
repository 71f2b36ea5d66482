"""Journals of real ``run`` processes: refused requests, earlier runs, permissions, symlinks."""

import json
import os
import resource
import signal
import stat
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mission_service.errors import ControlError, RequestError
from mission_service.interfaces.control.control_client import ControlClient
from mission_service.replay.verification import verify
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_live import CLI, free_port, process


def arguments(out: Path, *sets: str) -> list[str]:
    """Return the arguments of a run of the default scenario whose vehicle does not exist."""
    changes = [f'vehicles.0.link="udpin:127.0.0.1:{free_port()}"', "start_s=3600", *sets]
    return ["run", "default", "--out", str(out), *(w for each in changes for w in ("--set", each))]


@contextmanager
def running(command: list[str], out: Path) -> Iterator[tuple[ControlClient, Any]]:
    """Start a run; return its control socket, when it replies, and its process."""
    log = out.parent / "run.log"
    with process(command, log) as child:

        def answers() -> bool:
            assert child.poll() is None, log.read_text(encoding="utf-8")
            try:
                with ControlClient(out) as there:
                    there.ask(do="status")
            except ControlError:
                return False
            return True

        wait_until(answers)
        with ControlClient(out) as there:
            yield there, child


def stopped(child: "subprocess.Popen[bytes]", by: signal.Signals) -> None:
    child.send_signal(by)
    child.wait(timeout=PATIENCE_S)


def refused(there: ControlClient, **request: Any) -> str:
    try:
        there.ask(**request, by="ann", station="desk")
    except RequestError as error:
        return str(error)
    return ""


@pytest.mark.long
def test_a_refusal_of_no_vehicle_is_refused_and_the_run_goes_on_after_a_kill(
    tmp_path: Path,
) -> None:
    out = tmp_path / "out"
    command = arguments(out)
    with running(command, out) as (there, child):
        for do in ("refuse", "accept"):
            assert "vehicle" in refused(there, do=do, vehicle="", hash="0" * 64)
        there.ask(do="hold", vehicle="hawk", by="ann", station="desk")
        child.kill()
        child.wait(timeout=PATIENCE_S)
    with running(command, out) as (there, child):
        assert refused(there, do="hold", vehicle="hawk") == ""
        stopped(child, signal.SIGTERM)
    lines = (out / "journal.jsonl").read_text(encoding="utf-8")
    assert "MissionRefused" not in lines
    assert lines.count('"type":"Resumed"') == 1
    assert verify(out / "journal.jsonl").difference is None


@pytest.mark.long
def test_a_journal_of_another_scenario_or_run_is_kept_by_name(tmp_path: Path) -> None:
    out = tmp_path / "out"
    log = tmp_path / "run.log"

    def a_run(*sets: str, fresh: bool = False, by: signal.Signals = signal.SIGTERM) -> str:
        extra = ["--fresh"] if fresh else []
        with running([*arguments(out, *sets), *extra], out) as (there, child):
            there.ask(do="present", by="ann", station="desk")
            stopped(child, by)
        return log.read_text(encoding="utf-8")

    def texts() -> set[bytes]:
        return {each.read_bytes() for each in out.glob("journal*.jsonl")}

    a_run("service.journal.rotate_mb=0.001")
    first = texts()
    printed = a_run("planner.alpha=1.5")
    assert "journal-1.jsonl" in printed
    assert first < texts()
    second = texts()
    printed = a_run("planner.alpha=1.5", fresh=True)
    assert "journal-2.jsonl" in printed
    assert second < texts()
    for kept in ("journal-1.jsonl", "journal-2.jsonl"):
        assert verify(out / kept).difference is None


def test_what_is_no_journal_is_kept_too(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "journal.jsonl").write_text("a user's notes\n", encoding="utf-8")
    with running(arguments(out), out) as (_, child):
        stopped(child, signal.SIGTERM)
    assert (out / "journal-1.jsonl").read_text(encoding="utf-8") == "a user's notes\n"


def test_what_a_run_leaves_is_for_its_user_alone(tmp_path: Path) -> None:
    out = tmp_path / "made" / "out"
    tlog = out / "link.tlog"
    (tmp_path / "made").mkdir()
    before = os.umask(0)
    try:
        command = [
            *arguments(out, "service.journal.state_every_s=1", 'service.http.listen="127.0.0.1:0"'),
            *("--tlog", str(tlog)),
        ]
        with running(command, out) as (there, child):
            there.ask(do="present", by="ann", station="desk")
            wait_until(lambda: (out / "journal.state").exists())
            stopped(child, signal.SIGINT)
    finally:
        os.umask(before)
    left = {each.name: stat.S_IMODE(each.stat().st_mode) for each in out.iterdir()}
    assert {"journal.jsonl", "journal.state", "summary.json", "token", "link.tlog"} <= set(left)
    assert stat.S_IMODE(out.stat().st_mode) == 0o700
    assert {name: oct(mode) for name, mode in left.items() if mode & 0o077} == {}


@pytest.mark.long
def test_a_symlink_in_the_place_of_the_journal_is_refused(tmp_path: Path) -> None:
    out, target = tmp_path / "out", tmp_path / "precious"
    out.mkdir()
    target.write_text("precious\n", encoding="utf-8")
    for name in ("journal.jsonl", "journal.jsonl.next", "journal-000001.jsonl", "journal.state"):
        (out / name).symlink_to(target)
        found = subprocess.run(
            [*CLI, *arguments(out)], capture_output=True, text=True, timeout=120, check=False
        )
        assert found.returncode == 1, name
        assert found.stderr.count("\n") == 1
        assert f"{out / name}: is a symbolic link" in found.stderr
        assert target.read_text(encoding="utf-8") == "precious\n"
        (out / name).unlink()
    assert list(out.iterdir()) == []


def test_readyz_and_the_live_status_show_that_the_disk_is_full(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with running(arguments(out, 'service.http.listen="127.0.0.1:0"'), out) as (there, child):
        log = (tmp_path / "run.log").read_text(encoding="utf-8")
        address = log.partition("map: ")[2].split("/?")[0].split()[0].rstrip("/")

        def lacks() -> str:
            with pytest.raises(urllib.error.HTTPError) as caught:
                urllib.request.urlopen(f"{address}/readyz", timeout=PATIENCE_S)
            assert caught.value.code == 503
            return caught.value.read().decode()

        def is_in_live_status(text: bytes) -> bool:
            """Return whether a status in the live stream after ``version`` contains a text."""
            live = urllib.request.Request(f"{address}/api/v1/live?since={version}", headers=token)
            with urllib.request.urlopen(live, timeout=PATIENCE_S) as stream:
                lines = iter(stream.readline, b": \n")  # until a comment: nothing has changed
                return any(b'"schema":"run/1"' in line and text in line for line in lines)

        token = {"Authorization": f"Bearer {(out / 'token').read_text(encoding='utf-8').strip()}"}
        with urllib.request.urlopen(
            urllib.request.Request(f"{address}/api/v1/state", headers=token), timeout=PATIENCE_S
        ) as state:
            version = json.load(state)["version"]
        assert "hawk: no heartbeat yet" in lacks()
        assert "journal" not in lacks()
        size = (out / "journal.jsonl").stat().st_size
        resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (size + 20, resource.RLIM_INFINITY))
        assert "not recorded: disk full" in refused(there, do="present")
        assert "journal: disk full" in lacks()
        assert is_in_live_status(b"journal: disk full")
        resource.prlimit(
            child.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        )
        wait_until(lambda: "journal" not in lacks())
        assert refused(there, do="present") == ""
        stopped(child, signal.SIGTERM)
