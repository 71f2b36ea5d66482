"""A replay with its interfaces: messages, refusals and end."""

import asyncio
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from mission_service.replay.verification import verify
from tests.bridge.log_writers import bin_flight
from tests.flights.replays import V1, Replay, replayed
from tests.flights.worlds import journal_in
from tests.patience import wait_until
from tests.service.test_cli import call

NOTHING = "this is a replay; orders are refused"


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Replay]:
    """Return a replay of a journal with two vehicles, paused at its start."""
    log = journal_in(tmp_path_factory.mktemp("flown"))
    with replayed(tmp_path_factory.mktemp("out"), f"{log}", "--speed", "0.1") as replay:
        replay.post(paused=True)
        yield replay


def test_it_is_shown_and_moved(replay: Replay) -> None:
    assert replay.http.get("/readyz").status_code == 200
    state = replay.get("/state")
    assert state["replay"]["logs"][0].endswith("/journal.jsonl")
    assert state["replay"]["paused"]
    assert [each["vehicle"] for each in state["vehicles"]] == ["hawk", "kite"]
    replay.post(seek_s=100.0, speed=2)
    there = replay.until(seeking=False)
    assert there["speed"] == 2.0
    assert there["log_at_us"] - there["log_begin_us"] == 100_000_000
    at_100 = replay.get("/state")
    assert at_100["status"]["at_us"] == there["at_us"] == there["begin_us"] + 100_000_000
    assert at_100["version"] > state["version"]
    assert len(at_100["fire"]["corrections"]) == 1
    track = replay.get("/vehicles/hawk/track")["properties"]["at_us"]
    assert len(track) > 90
    replay.post(seek_s=30.0)
    assert replay.until(seeking=False)["jumps"] == there["jumps"] + 1
    at_30 = replay.get("/state")
    assert at_30["version"] > at_100["version"]
    assert at_30["fire"]["corrections"] == []
    assert all(each["at_us"] <= at_30["status"]["at_us"] for each in at_30["telemetry"])
    assert len(replay.get("/vehicles/hawk/track")["properties"]["at_us"]) < 40
    assert all(line["at_us"] <= at_30["status"]["at_us"] for line in at_30["announcements"])
    replay.post(paused=False)
    began_us = there["log_begin_us"] + 30_000_000
    wait_until(lambda: replay.get("/replay")["log_at_us"] > began_us + 200_000)
    assert replay.post(paused=True)["log_at_us"] > began_us + 200_000


def test_the_live_stream_reports_jumps_first(replay: Replay) -> None:
    replay.post(seek_s=60.0)
    jumps = replay.until(seeking=False)["jumps"]
    version = replay.get("/state")["version"]
    with replay.http.stream("GET", f"{V1}/live?since={version}") as stream:
        lines = stream.iter_lines()
        replay_post = httpx.post(
            f"{replay.http.base_url}{V1}/replay",
            json={"seek_s": 10.0},
            headers={"authorization": replay.http.headers["authorization"]},
        )
        assert replay_post.status_code == 200
        received: list[tuple[str, Any]] = []
        kind = ""
        for line in lines:
            if line.startswith("event: "):
                kind = line.removeprefix("event: ")
            elif line.startswith("data: "):
                received.append((kind, json.loads(line.removeprefix("data: "))))
            if {"replay", "telemetry", "fire", "vehicle"} <= {each for each, _ in received}:
                break
    place = next(
        i
        for i, (kind, data) in enumerate(received)
        if data and kind == "replay" and data["jumps"] == jumps + 1
    )
    assert "telemetry" not in [kind for kind, _ in received[:place]]
    assert not received[place][1]["seeking"]


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", "/abort", {}),
        ("POST", "/vehicles/hawk/hold", {}),
        ("POST", "/vehicles/all/start", {}),
        ("POST", "/vehicles/hawk/mission/renew", {}),
        ("POST", "/fire/undo", {}),
        ("POST", "/fire/preview", {"do": "undo"}),
        ("POST", "/wind", {"speed_m_s": 3.0, "from_deg": 10.0}),
        ("PATCH", "/planner", {"alpha": 2.0}),
        ("POST", "/burn/approve", {"hash": "0" * 64}),
    ],
)
def test_nothing_can_be_ordered(replay: Replay, method: str, path: str, body: Any) -> None:
    answer = replay.http.request(method, V1 + path, json=body)
    assert (answer.status_code, answer.json()) == (409, {"error": NOTHING})


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ({}, "specify paused, speed or seek_s"),
        ({"speed": 0}, "speed"),
        ({"speed": "fast"}, "speed"),
        ({"seek_s": "x"}, "seek_s"),
        ({"paused": True, "more": 1}, "more"),
    ],
)
def test_what_is_not_understood_moves_nothing(replay: Replay, body: Any, why: str) -> None:
    before = replay.get("/replay")
    answer = replay.http.post(f"{V1}/replay", json=body)
    assert answer.status_code == 422
    assert why in answer.json()["error"]
    assert replay.get("/replay") == before


def test_the_control_socket_takes_nothing_else(replay: Replay) -> None:
    async def asked(line: bytes) -> Any:
        reader, writer = await asyncio.open_unix_connection(str(replay.out / "control.sock"))
        writer.write(line)
        answer = json.loads(await reader.readline())
        writer.close()
        return answer

    assert asyncio.run(asked(b'{"do": "abort"}\n')) == {"ok": False, "error": NOTHING}
    status = asyncio.run(asked(b'{"do": "status"}\n'))
    assert status["status"]["replay"]["schema"] == "replay/1"


def test_metrics_and_the_end_of_it(replay: Replay) -> None:
    """This test must be the last one with this replay."""
    assert b"mission_service_ready 1.0" in replay.http.get("/metrics").content
    replay.post(seek_s=1e6)
    assert replay.until(seeking=False, ended=True)["paused"]
    replay.post(seek_s=0)
    replay.until(seeking=False, ended=False)
    assert replay.end(signal.SIGTERM) == 0
    result = verify(replay.out / "journal.jsonl")
    assert result.difference is None
    assert (replay.out / "journal.jsonl").read_bytes().splitlines()[-1].startswith(b'{"end"')
    assert json.loads((replay.out / "summary.json").read_text())["vehicles"]


def test_to_its_end_as_fast_as_can_be(tmp_path: Path) -> None:
    log = tmp_path / "one.bin"
    log.write_bytes(bin_flight())
    result = call("replay", f"hawk={log}", "--speed", "max", "--until-end", "--json")
    assert result.exit_code == 0, result.output
    (vehicle,) = json.loads(result.stdout)["vehicles"]
    assert vehicle["name"] == "hawk"
    assert not list(Path(os.environ.get("TMPDIR", "/tmp")).glob("replay-*/control.sock"))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--speed", "0"), "must be 0.1 to 100, or max"),
        (("--from", "4", "--to", "2"), "no vehicle in this part of the logs"),
        (("--from", "1000"), "no vehicle in this part of the logs"),
        (("--speed", "1", "--listen", "nowhere"), "write it as HOST:PORT"),
        (("--speed", "1", "--listen", "0.0.0.0:1"), "is not a loopback address"),
        (("--scenario", "default"), "no position is on the landscape of default"),
        (("--speed", "1", "--set", "planner.rule=none"), "no such rule"),
    ],
)
def test_what_cannot_be_played_is_reported_in_one_line(
    tmp_path: Path, words: tuple[str, ...], why: str
) -> None:
    log = tmp_path / "one.bin"
    log.write_bytes(bin_flight())
    result = call("replay", str(log), "--out", str(tmp_path / "out"), *words)
    assert result.exit_code != 0
    assert why in result.output
    assert "Traceback" not in result.output
