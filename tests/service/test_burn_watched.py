"""Drops require an approver's presence: a real daemon, its HTTP interface, a mock copter."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission_service.commands import Drop
from mission_service.events import Event, OperatorEvent
from mission_service.interfaces.api.access.token_file import added
from mission_service.journal.journal_file import SegmentReader
from tests.web.service import BURN, Service, running

SILENT_S = 30.0
SPEEDUP = 5
SCENARIO = BURN.replace(
    "[burn]\n", f"[burn]\napprover_timeout_s = {SILENT_S:g}\nspeed_m_s = 3\n", 1
)
POLL_S = 0.1  # time between requests to the service; has no effect on the result


@pytest.fixture
def burning(tmp_path: Path) -> Iterator[Service]:
    with running(tmp_path, SCENARIO, SPEEDUP) as service:
        yield service


def until_first_drop(boss: Service) -> None:
    """Answer GO, approve the proposed plan and be present until a sphere has fallen."""
    for item in boss.get("burn")["go_items"]:
        boss.post("burn/go", item=item)
    deadline = time.monotonic() + 300.0
    while not (now := boss.get("burn"))["drops"]:
        assert time.monotonic() < deadline, now["guidance"]
        boss.post("burn/present")
        if now["plan_hash"] and now["guidance"]["approved_by"] is None:
            boss.post("burn/approve", hash=now["plan_hash"])
        time.sleep(POLL_S)


@pytest.mark.long
def test_the_wind_feed_of_another_user_keeps_no_drop_going(burning: Service) -> None:
    tokens = burning.log.parent / "tokens.toml"
    feed = burning._replace(boss=added(tokens, "weather station", ("correct",), ""))
    until_first_drop(burning)
    deadline = time.monotonic() + 300.0
    while (now := feed.get("burn"))["guidance"]["phase"] == "flying":
        assert time.monotonic() < deadline, now["guidance"]
        feed.post("wind", speed_m_s=2.0, from_deg=0.0)
        time.sleep(POLL_S)
    texts = [line["text"] for line in feed.get("announcements")]
    assert any(text.startswith("plan withdrawn: no input from boss") for text in texts), texts
    at_us, approver_us, drops = 0, 0, 0
    for entry in SegmentReader(burning.log.parent / "out" / "journal.jsonl"):
        thing = entry.content
        if isinstance(thing, Event | OperatorEvent):
            at_us = max(at_us, thing.at_us)
            if isinstance(thing, OperatorEvent) and thing.by == "boss":
                approver_us = at_us
        elif isinstance(thing, Drop):
            drops += 1
            assert at_us - approver_us <= SILENT_S * 1e6
    assert drops > 0
