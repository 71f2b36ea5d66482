"""Notifications to systemd, over a socket like systemd's."""

import asyncio
import contextlib
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission_service.runtime import systemd_notify
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.systemd_notify import notify_systemd, pulse, watchdog_s
from tests.ops.contexts import context_after_a_flight
from tests.patience import PATIENCE_S, until


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(path))
        sock.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        yield sock


def datagrams_of(sock: socket.socket) -> list[str]:
    found = []
    with contextlib.suppress(BlockingIOError):
        while True:
            found.append(sock.recv(4096).decode())
    return found


def test_systemd_receives_ready_the_watchdog_and_the_end(
    systemd: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "150000")
    sent: list[str] = []

    async def beats(count: int) -> None:
        def beaten() -> bool:
            sent.extend(datagrams_of(systemd))
            return len(sent) >= count

        await until(beaten)

    async def run(context: RunContext) -> None:
        task = asyncio.create_task(pulse(context))
        await beats(3)
        time.sleep(0.3)  # noqa: ASYNC251 - the loop hangs
        await beats(len(sent) + 2)
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    with context_after_a_flight(tmp_path) as context:
        asyncio.run(run(context))
    sent += datagrams_of(systemd)
    assert sent[0] == "READY=1"
    assert sent[1] == "WATCHDOG=1\nSTATUS=demo: 2 of 2 vehicles online, 0 alarms"
    assert sent[-1] == "STOPPING=1"
    assert 0.2 < context.gauges["event_loop_lag_seconds"]() < PATIENCE_S


def test_an_abstract_socket_is_one_too(monkeypatch: pytest.MonkeyPatch) -> None:
    name = f"mission-service-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(f"\0{name}")
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        assert notify_systemd("READY=1")
        assert sock.recv(100) == b"READY=1"


def test_without_systemd_nothing_is_sent_and_nothing_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify_systemd("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "missing"))
    assert not notify_systemd("READY=1")


def test_the_watchdog_is_for_the_process_it_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "30000000")
    assert watchdog_s() == 30.0
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    assert watchdog_s() == 30.0
    monkeypatch.setenv("WATCHDOG_PID", "1")
    assert watchdog_s() is None
    monkeypatch.setenv("WATCHDOG_USEC", "")
    assert watchdog_s() is None
    assert systemd_notify.BEAT_S < 5.0
