"""The log: one line for each record, machine-readable if configured, without secrets."""

import asyncio
import contextlib
import io
import json
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission_service.runtime import redaction as hidden
from mission_service.runtime import service_log
from mission_service.runtime.run_context import RunContext
from tests.ops.contexts import context_after_a_flight
from tests.patience import until

KEY = bytes(range(32))
TOKEN = "mst_1234567890abcdefgh"


@pytest.fixture(autouse=True)
def own_logging() -> Iterator[None]:
    """Restore the process's logging after the test."""
    root = logging.getLogger()
    handlers, level, secrets = root.handlers[:], root.level, set(hidden._secrets)
    yield
    root.handlers[:], hidden._secrets = handlers, secrets
    root.setLevel(level)


def set_up(form: service_log.Form, level: str = "info") -> io.StringIO:
    stream = io.StringIO()
    service_log.set_up(form, level, stream)
    return stream


def test_a_line_of_json_has_time_level_and_what_was_given() -> None:
    stream = set_up("json")
    logging.getLogger("a.b").warning("lost %s", "hawk", extra={"vehicle": "hawk", "at_us": 5})
    line = json.loads(stream.getvalue())
    assert line.pop("at").endswith("+00:00")
    assert line == {
        "level": "warning",
        "logger": "a.b",
        "message": "lost hawk",
        "vehicle": "hawk",
        "at_us": 5,
    }


def test_text_is_for_people_and_the_level_is_obeyed() -> None:
    stream = set_up("text", "warning")
    logging.getLogger("a").info("not now")
    logging.getLogger("a").error("now")
    assert stream.getvalue().endswith("ERROR   a: now\n")
    assert "not now" not in stream.getvalue()


@pytest.mark.parametrize("form", ["text", "json"])
def test_no_secret_stands_in_a_line_wherever_it_comes_from(form: service_log.Form) -> None:
    stream = set_up(form)
    hidden.hide(TOKEN)
    hidden.hide(KEY)
    log = logging.getLogger("a")
    log.info("GET /api with %s", TOKEN)
    log.info("key", extra={"key": KEY.hex(), "path": Path(TOKEN)})
    try:
        raise ValueError(f"bad key {KEY.hex()}")
    except ValueError:
        log.exception("no")
    # Secrets that are not configured as secrets:
    for text in (
        "Authorization: Bearer abc.def-123456",
        "http://127.0.0.1:8765/#token=zzzzzzzzzzzz",
        "password = 'hunter22222'",
        '{"passwd": "hunter33333"}',
    ):
        log.info(text)
    logged = stream.getvalue()
    for secret in (TOKEN, KEY.hex(), "abc.def-123456", "zzzzzzzz", "hunter2", "hunter3"):
        assert secret not in logged
    assert logged.count(hidden.HIDDEN) >= 6
    assert "Traceback" in logged


def test_the_path_of_a_secret_may_be_logged() -> None:
    assert hidden.clean("password = file:/run/secrets/mqtt") == "password = file:/run/secrets/mqtt"
    assert hidden.clean("a token of hawk's is missing") == "a token of hawk's is missing"


def test_announcements_and_alarms_of_a_run_are_logged_once(tmp_path: Path) -> None:
    stream = set_up("json")

    async def follow(context: RunContext) -> None:
        task = asyncio.create_task(service_log.log_announcements(context))
        await asyncio.sleep(0)
        context.state_view.alarm("link/hawk", "hawk: link lost", "severe", "hawk")
        context.ring()
        await until(lambda: "link lost" in stream.getvalue())
        context.state_view.clear_alarm("link/hawk")
        context.state_view.announce("hawk", "the last word")
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    with context_after_a_flight(tmp_path) as context:
        asyncio.run(follow(context))
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    texts = [line["message"] for line in lines]
    assert "hawk: connected (px4 plane)" in texts
    assert len(texts) == len(set(texts)), "logged twice"
    assert [line["level"] for line in lines if line.get("alarm")] == ["error", "info"]
    assert texts[-2:] == ["hawk: the last word", "alarm link/hawk: cleared"]


def test_announcements_from_before_a_restart_are_not_logged_again(tmp_path: Path) -> None:
    stream = set_up("json")
    with context_after_a_flight(tmp_path) as context:
        context.state_view.last_id_before_restart = context.state_view.announcement_id
        context.state_view.announce("hawk", "read back")
        service_log.LogFollower().catch_up(context)
    lines = [json.loads(line)["message"] for line in stream.getvalue().splitlines()]
    assert [line for line in lines if not line.startswith("alarm")] == ["hawk: read back"]


def test_an_alarm_that_becomes_severe_is_logged_as_an_error(tmp_path: Path) -> None:
    stream, follower = set_up("json"), service_log.LogFollower()
    with context_after_a_flight(tmp_path) as context:
        for severity in ("warning", "severe", "severe", "warning"):
            context.state_view.alarm("energy/hawk", "hawk: energy", severity, "hawk")
            follower.catch_up(context)
        context.state_view.clear_alarm("energy/hawk")
        follower.catch_up(context)
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    found = [line["level"] for line in lines if line.get("alarm") == "energy/hawk"]
    assert found == ["warning", "error", "warning", "info"]
