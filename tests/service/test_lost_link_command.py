"""``mission-service lost-link`` with mock autopilots over UDP."""

import asyncio
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.serving import serve
from autopilot_bridge.stacks.stacks import Stack, stack_named
from mission_service.cli.main import main
from mission_service.runtime.clocks import clock_us
from tests.bridge.helpers import mock_of
from tests.bridge.mock_exchange import each_stack
from tests.bridge.mock_process import free_port
from tests.patience import PATIENCE_S

COPTER = stack_named("ardupilot", "copter")
PX4 = stack_named("px4", "plane")


@contextmanager
def served(stack: Stack) -> Iterator[tuple[MockAutopilot, tuple[str, ...]]]:
    """Yield a mock that another thread runs, and the link options that lead to it."""
    port, mock = free_port(), mock_of(stack)
    loop = asyncio.new_event_loop()
    work = loop.create_task(serve(mock, f"udpout:127.0.0.1:{port}", 1.0, clock_us))

    def run() -> None:
        with pytest.raises(asyncio.CancelledError):
            loop.run_until_complete(work)
        loop.close()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield mock, ("--link", f"udpin:127.0.0.1:{port}", "--timeout", "20")
    finally:
        loop.call_soon_threadsafe(work.cancel)
        thread.join(timeout=PATIENCE_S)


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["lost-link", *arguments])


def result_of(*arguments: str) -> dict[str, Any]:
    result = call(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    decoded: dict[str, Any] = json.loads(result.stdout)
    return decoded


@each_stack
def test_it_is_shown_set_read_back_and_put_back(tmp_path: Path, stack: Stack) -> None:
    old = tmp_path / "old.json"
    with served(stack) as (mock, link):
        before = {name: mock.parameters.value(name) for name in mock.parameters.names}
        shown = result_of("show", *link)
        assert (shown["reaction"], shown["stack"]) == ("continues", f"{stack.name} {stack.kind}")
        done = result_of("set", "return", "-o", str(old), *link)
        assert "returns after" in done["mission"] == done["guided"] == done["hold"]
        assert done["changed"]
        after = {name: mock.parameters.value(name) for name in mock.parameters.names}
        changed = {name: value for name, value in before.items() if after[name] != value}
        kept = json.loads(old.read_text())
        assert {name: kept["parameters"][name] for name in changed} == changed
        assert set(kept["parameters"]) == set(changed)
        assert result_of("set", "return", "-o", str(tmp_path / "no.json"), *link)["changed"] == []
        assert not (tmp_path / "no.json").exists()
        assert result_of("set", "--restore", str(old), *link)["reaction"] == "continues"
        restored = {name: mock.parameters.value(name) for name in mock.parameters.names}
        assert restored == before


def test_an_armed_vehicle_is_not_changed(tmp_path: Path) -> None:
    old = tmp_path / "old.json"
    with served(PX4) as (mock, link):
        mock.flight.armed = True
        result = call("set", "return", "-o", str(old), *link)
        assert result.exit_code == 1
        assert "the vehicle is armed" in result.stderr
        assert mock.parameters.value("NAV_DLL_ACT") == 0.0
        assert not old.exists()
        assert call("show", *link).exit_code == 0


def test_values_of_an_earlier_change_are_not_overwritten(tmp_path: Path) -> None:
    old = tmp_path / "old.json"
    old.write_text("{}")
    result = call("set", "return", "-o", str(old), "--timeout", "0.5")
    assert result.exit_code == 1
    assert "may contain the values before an earlier change" in result.stderr
    assert old.read_text() == "{}"


def test_values_of_another_vehicle_are_not_restored(tmp_path: Path) -> None:
    old = tmp_path / "old.json"
    old.write_text('{"system_id": 1, "stack": "px4 plane", "parameters": {"NAV_DLL_ACT": 1}}')
    with served(COPTER) as (_, link):
        result = call("set", "--restore", str(old), *link)
        assert result.exit_code == 1
        assert "contains values of a px4 plane with system id 1" in result.stderr


@pytest.mark.parametrize("content", ["", "[]", '{"system_id": 1}'])
def test_a_damaged_file_is_one_line_of_error(tmp_path: Path, content: str) -> None:
    old = tmp_path / "old.json"
    old.write_text(content)
    result = call("set", "--restore", str(old), "--timeout", "0.5")
    assert result.exit_code == 1
    assert result.stderr.startswith(f"Error: {old}: cannot be read")
    assert result.stderr.count("\n") == 1


def test_warnings_and_impossible_reactions_are_shown(tmp_path: Path) -> None:
    with served(stack_named("ardupilot", "plane")) as (mock, link):
        mock.parameters.change("FS_GCS_ENABL", 1.0)
        mock.parameters.change("FS_LONG_ACTN", 2.0)
        result = call("show", *link)
        assert "Warning: FS_LONG_ACTN = 2: it glides without throttle (FBWA)" in result.stderr
        assert "FS_LONG_TIMEOUT 5" in result.stdout
        result = call("set", "land", "-o", str(tmp_path / "old.json"), *link)
        assert result.exit_code == 1
        assert "supported: continue, return" in result.stderr


def test_without_an_autopilot_the_error_is_one_line() -> None:
    result = call("show", "--link", f"udpin:127.0.0.1:{free_port()}", "--timeout", "0.5")
    assert result.exit_code == 1
    assert "no autopilot was found within 0.5 s" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [(), ("return", "--restore", "x.json")])
def test_set_needs_either_a_reaction_or_a_file(arguments: tuple[str, ...]) -> None:
    result = call("set", *arguments)
    assert result.exit_code == 2
    assert "specify either continue, hold, return or land, or --restore FILE" in result.stderr
