"""The mock flies recorded missions in about the recorded time."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.mock.kinematics import CALM, Wind
from autopilot_bridge.stacks.stacks import Stack
from tests.bridge.helpers import mock_of
from tests.bridge.mock_exchange import COPTER, PLANE, PX4
from tests.bridge.test_mock_physics import Flown

FOLDER = Path("/work/shared/data/flights")
recorded = pytest.mark.skipif(not FOLDER.exists(), reason="no recorded flights")
SITL_WIND = Wind(240.0, 5.0)


def messages(path: Path) -> list[tuple[float, Any]]:
    """Return (seconds, message) of a tlog."""
    data, decoder = path.read_bytes(), mavlink.MAVLink(None)
    found, at = [], 0
    while at < len(data):
        length = data[at + 9] + 12 + (13 if data[at + 10] & 1 else 0)
        message = decoder.parse_char(data[at + 8 : at + 8 + length])
        found.append((int.from_bytes(data[at : at + 8], "big") / 1e6, message))
        at += 8 + length
    return found


def item_of(fields: dict[str, Any]) -> MissionItem:
    names = MissionItem.__dataclass_fields__
    return MissionItem(**{name: fields[name] or 0 for name in names})


def legs(times: dict[int, float]) -> dict[tuple[int, int], float]:
    """Return the seconds from each item to the next reported one."""
    seqs = sorted(times)
    return {(a, b): times[b] - times[a] for a, b in pairwise(seqs)}


@recorded
@pytest.mark.parametrize(
    ("name", "stack", "mission", "after", "within_s", "wind", "acceleration"),
    [
        ("arduplane_perimeter", PLANE, 0, 2, 2.5, SITL_WIND, 3.0),
        ("arduplane_perimeter", PLANE, 1, 1, 3.0, SITL_WIND, 3.0),
        ("px4_fixedwing_perimeter", PX4, 0, 2, 2.5, CALM, 3.0),
        ("arducopter_drops", COPTER, 0, 2, 2.5, Wind(240.0, 3.0), 1.0),
    ],
)
def test_legs_take_as_long_as_recorded(
    name: str,
    stack: Stack,
    mission: int,
    after: int,
    within_s: float,
    wind: Wind,
    acceleration: float,
) -> None:
    recorded_missions = json.loads((FOLDER / f"{name}.mission.json").read_text())
    items = tuple(item_of(fields) for fields in recorded_missions["missions"][mission]["items"])
    received = messages(FOLDER / f"{name}.tlog")
    speeds = [m.airspeed for _, m in received if m.get_type() == "VFR_HUD" and m.airspeed > 3.0]
    reached: list[dict[int, float]] = [{}]  # items of each mission
    for at_s, message in received:
        if message.get_type() == "MISSION_ITEM_REACHED":
            if message.seq < max(reached[-1], default=0):
                reached.append({})
            reached[-1].setdefault(message.seq, at_s)
    airspeed = 10.0 if stack.vehicle == "copter" else sum(speeds) / len(speeds)
    flight = Flown(mock_of(stack, airspeed_m_s=airspeed, wind=wind))
    vehicle = flight.mock.flight
    vehicle.limits = replace(vehicle.limits, acceleration_m_s2=acceleration)
    vehicle.items, vehicle.armed = items, True
    vehicle.set_mode("mission", 0.0)
    flown: dict[int, float] = {}
    while flight.now_s < 400.0:
        flight.steps(0.125)
        for seq in vehicle.reached:
            flown[seq] = flight.now_s
        vehicle.reached.clear()
    expected = {leg: s for leg, s in legs(reached[mission]).items() if leg[0] >= after}
    given = legs(flown)
    short = [leg for leg in expected if items[leg[1]].command != 20]  # the way home is not compared
    assert len(short) >= 5
    assert {leg: given[leg] for leg in short} == pytest.approx(
        {leg: expected[leg] for leg in short}, abs=within_s
    )
