"""The last check: commands that the service sends in a burn, with a faulty guidance."""

import json
from pathlib import Path

import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from benchmarks.burn_frames import CORNERS, place
from firemodel.landscape.default import jacksboro
from mission_service.commands import AnyCommand, Drop, UploadMission
from mission_service.core.core import Core
from mission_service.events import BatteryUpdated, DropFinished, UploadFinished
from mission_service.guidance.burn.interlock import interlock_of
from mission_service.journal.journal_file import SegmentReader
from tests.service.test_burn_flight import Burn, scenario

SERVO = MissionItem(mavlink.MAV_CMD_DO_SET_SERVO, mavlink.MAV_FRAME_MISSION, 0, 0, 0.0, 9.0, 1900.0)


def entries_of(path: Path, kind: type) -> list[object]:
    return [entry.content for entry in SegmentReader(path) if isinstance(entry.content, kind)]


def mad(burn: Burn, monkeypatch: pytest.MonkeyPatch, command: AnyCommand) -> None:
    """Replace the core: it returns this command at the next event, and then none."""
    once = iter([[command]])
    monkeypatch.setattr(Core, "handle", lambda self, event: next(once, []))
    battery = BatteryUpdated(burn.at_us, "kestrel", 90.0)
    burn.simulation.service.handle_events([battery], burn.simulation.link_us)
    burn.run(5.0)
    burn.close()


def test_a_drop_without_approval_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    burn = Burn(tmp_path / "journal.jsonl", scenario())
    burn.operators_present = False
    burn.run(15.0)
    name = burn.guidance.approvals.plan_hash
    mad(burn, monkeypatch, Drop("kestrel", name, 0, 36.3501, -84.1599))
    (refused,) = entries_of(burn.path, DropFinished)
    assert isinstance(refused, DropFinished)
    assert refused.refused
    assert "it has no approval" in refused.reason
    assert burn.dropped == 0


def test_a_mission_with_a_drop_in_it_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    burn = Burn(tmp_path / "journal.jsonl", scenario())
    burn.run(5.0)
    mad(burn, monkeypatch, UploadMission("kestrel", 99, "gone mad", (SERVO,)))
    (refused,) = entries_of(burn.path, UploadFinished)
    assert isinstance(refused, UploadFinished)
    assert (refused.outcome, refused.mission_id) == ("refused", 99)
    assert burn.rig.mock.flight.items == ()


def test_the_last_lock_accepts_a_unit_from_a_file(tmp_path: Path) -> None:
    lon_lat = [[lon, lat] for lat, lon in (*CORNERS, CORNERS[0])]
    feature = {"type": "Polygon", "coordinates": [lon_lat]}
    (tmp_path / "unit.geojson").write_text(json.dumps(feature), encoding="utf-8")
    loaded = scenario(unit=None, unit_file=tmp_path / "unit.geojson")
    assert loaded.burn is not None
    lock = interlock_of(loaded.burn, jacksboro(100, 100, 5.0))
    inside, outside = place(60.0, 60.0), place(-5.0, 60.0)
    area = lock._areas["burn unit"]
    assert shapely.contains_xy(area, inside[1], inside[0])
    assert not shapely.contains_xy(area, outside[1], outside[0])
