"""The live service of a burn without a vehicle: its socket, its journal, and the next run."""

import asyncio
import contextlib
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ControlError, JournalError, RequestError
from mission_service.events import Aborted, ChecklistAnswered, HostTime, OperatorHeartbeat, Resumed
from mission_service.interfaces.control.control_client import NAME, ControlClient
from mission_service.journal.journal_file import SegmentReader
from mission_service.live.daemon import Run, serve
from mission_service.replay.verification import verify
from tests.announced import Announced
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_live import free_port

OPERATOR_FIELDS = {"by": "ann", "station": "firing-boss"}
Session = Callable[[ControlClient], None]


def scenario(duration_s: float, *changes: str) -> Scenario:
    return load_scenario(
        "burn",
        (
            f'vehicles.0.link="udpin:127.0.0.1:{free_port()}"',
            'clock="wall"',
            "deploy_at_s=0",
            f"duration_s={duration_s}",
            "landscape.rows=60",
            "landscape.cols=60",
            "landscape.cell_size_m=10",
            *changes,
        ),
    )


class KilledError(Exception):
    """Simulates a kill: no cleanup is executed that a kill would prevent."""


def run(burned: Scenario, out: Path, session: Session | None, killed: bool) -> list[str]:
    """Serve until a client's session ends, or until a kill; return the announcements."""
    done = False
    announced = Announced()

    def watch() -> None:
        if killed and done:
            raise KilledError

    def connect() -> None:
        deadline = time.monotonic() + 100  # kernels may be compiled first
        while True:
            try:
                with ControlClient(out) as client:
                    if session is not None:
                        session(client)
                return
            except ControlError:
                assert time.monotonic() < deadline
                time.sleep(0.02)

    async def both() -> None:
        nonlocal done
        serving = asyncio.create_task(
            serve(Run(burned, out / "journal.jsonl", ""), announced, watch)
        )
        if session is not None:
            await asyncio.to_thread(connect)
        done = True
        await serving

    try:
        with contextlib.suppress(KilledError):
            asyncio.run(both())
    except BaseExceptionGroup as group:
        _, others = group.split(KilledError)
        if others is not None:
            raise
    return announced.texts


def events(path: Path) -> list[Any]:
    """Return the events in a journal, without the host's clock, which advances."""
    every = [entry.content for entry in SegmentReader(path) if entry.is_event]
    return [event for event in every if not isinstance(event, HostTime)]


def test_a_burn_that_was_killed_goes_on_and_one_that_has_ended_is_kept(tmp_path: Path) -> None:
    path, burned = tmp_path / "journal.jsonl", scenario(3600.0)

    def first(client: ControlClient) -> None:
        item = client.ask(do="status")["status"]["items"][0]
        assert client.ask(do="go", item=item, **OPERATOR_FIELDS)["messages"] == [
            'GO/NO-GO checklist: GO for "firing plan approved by the burn boss" by ann at '
            "firing-boss; 7 of 8 open"
        ]
        with pytest.raises(RequestError, match="unknown station"):
            client.ask(do="present", by="ann", station="moon")
        with pytest.raises(RequestError, match="0, 0 is outside the landscape"):
            client.ask(do="lit", points=[[0, 0]], **OPERATOR_FIELDS)
        status = client.ask(do="status")["status"]
        assert len(status["open_items"]) == 7
        assert status["stations"] == ["firing-boss"]
        assert (tmp_path / NAME).exists()

    run(burned, tmp_path, first, killed=True)
    assert not (tmp_path / NAME).exists()
    assert [type(event) for event in events(path)] == [ChecklistAnswered]
    path.write_bytes(path.read_bytes() + b'{"event":{"ty')  # it was about to write
    os.utime(path, (time.time() - 100.0, time.time() - 100.0))

    def second(client: ControlClient) -> None:
        status = client.ask(do="status")["status"]
        assert 100.0 < status["at_s"] < 100.0 + PATIENCE_S
        assert len(status["open_items"]) == 8
        client.ask(do="present", **OPERATOR_FIELDS)
        client.ask(do="abort")

    announcements = run(burned, tmp_path, second, killed=True)
    assert any("resumes the run" in text for text in announcements)
    received = events(path)
    assert [type(event) for event in received] == [
        ChecklistAnswered,
        Resumed,
        OperatorHeartbeat,
        Aborted,
    ]
    assert 100.0 <= received[1].down_s < 100.0 + PATIENCE_S
    result = verify(path)
    assert (result.difference, result.cut_at_line) == (None, None)

    # The same again with a mission that has ended: the service ends normally.
    os.utime(path, (time.time() - 3550.0, time.time() - 3550.0))
    run(burned, tmp_path, None, killed=False)
    reader = SegmentReader(path)
    assert isinstance(events(path)[-1], Resumed)
    assert list(reader)
    assert reader.ended
    whole = path.read_bytes()

    def third(client: ControlClient) -> None:
        assert client.ask(do="status")["status"]["at_s"] < 60.0

    announcements = run(burned, tmp_path, third, killed=True)
    assert "begins a new run; the previous journal was renamed to journal-1.jsonl" in announcements
    assert (tmp_path / "journal-1.jsonl").read_bytes() == whole
    assert events(path) == []

    # The computer's clock was wrong until the restart.
    os.utime(path, (time.time() - 86_400.0, time.time() - 86_400.0))
    announcements = run(burned, tmp_path, third, killed=True)
    assert any("is not resumed: it was interrupted 24.0 h ago" in text for text in announcements)
    assert "begins a new run; the previous journal was renamed to journal-2.jsonl" in announcements


def test_a_damaged_journal_and_a_second_run_are_refused(tmp_path: Path) -> None:
    path, burned = tmp_path / "journal.jsonl", scenario(3600.0)

    def first(client: ControlClient) -> None:
        client.ask(do="present", **OPERATOR_FIELDS)
        with pytest.raises(ControlError, match="another run uses this socket"):
            run(scenario(3600.0), tmp_path, None, killed=False)

    run(burned, tmp_path, first, killed=True)
    damaged = path.read_bytes().replace(b'"by":"ann"', b'"by":"bob"')
    path.write_bytes(damaged)
    with pytest.raises(
        JournalError, match=r"line \d+ was altered.*to begin a new run, start with --fresh"
    ):
        run(burned, tmp_path, None, killed=False)
    assert path.read_bytes() == damaged
    assert not (tmp_path / NAME).exists()


def test_the_end_of_a_run_ends_the_threads_of_its_sensors(tmp_path: Path) -> None:
    """The fixture ``no_sensor_thread_left`` fails if a thread runs on."""
    folder = tmp_path / "files"
    folder.mkdir()
    named = (
        'estimate.sensors=["observation_files"]',
        f"estimate.observation_files.folder={folder}",
    )

    def wait_for_thread(client: ControlClient) -> None:
        wait_until(lambda: "ObservationFolder" in {each.name for each in threading.enumerate()})

    run(scenario(3600.0, *named), tmp_path, wait_for_thread, killed=True)
