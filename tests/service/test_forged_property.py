"""A flight with forged frames equals the flight without; ``benchmarks.forged_frames`` sends 1 M."""

from pathlib import Path

import pytest

from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.links.field_limits import BOUNDS
from autopilot_bridge.vehicle.position_plausibility import BootClock
from benchmarks.forged_frames import READ, compared
from mission_service.config.scenario import load_scenario

CHANGES = ("start_s=3600", "deploy_at_s=3600")


@pytest.mark.parametrize(("scenario", "seed"), [("default", 3), ("demo", 4)])
def test_forged_frames_change_nothing_but_alarms_and_link_quality(
    scenario: str, seed: int, tmp_path: Path
) -> None:
    flight = load_scenario(scenario, CHANGES)
    forged, different = compared(flight, tmp_path, 4000, 2, 3600 + 400, seed)
    assert forged.frames >= 4000
    assert different == ""
    assert forged.to_others == 0
    assert set(forged.alarms) == {"source", "clock", "jump", "value"}
    journal = (tmp_path / "disturbed.jsonl").read_text(encoding="utf-8")
    assert journal.count('"type":"UploadFinished"') > 0
    assert journal.count('"type":"Observed"') > 20


@pytest.mark.long
def test_the_comparison_finds_what_gets_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If any of the guards is removed, the comparison finds a difference."""
    flight = load_scenario("default", CHANGES)
    for guard, name, broken in (
        (SharedLink, "_is_accepted", lambda *_: True),
        (BootClock, "judge", lambda *_: "kept"),
    ):
        with monkeypatch.context() as taken_away:
            taken_away.setattr(guard, name, broken)
            _, different = compared(flight, tmp_path, 1500, 2, 3600 + 120, 3)
        assert different


def test_all_that_is_bounded_is_forged() -> None:
    assert set(BOUNDS) - {"MISSION_ITEM"} <= set(READ)
