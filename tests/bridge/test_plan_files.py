"""Plan files: this reader and other programs read what was written."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import NO_POSITION, Items, MissionItem, Plan, jumps_moved, params_of
from autopilot_bridge.missions.plan_file import read_any, write_any, write_plan
from autopilot_bridge.missions.wpl_file import write_wpl
from autopilot_bridge.stacks.stacks import stack_named
from tests.bridge.helpers import HOME, flight_of

# From the page "Plan File Format" of QGroundControl's developer guide.
DOCUMENTED = """{
 "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
 "geoFence": {
  "circles": [{"circle": {"center": [47.39756763610029, 8.544649762407738], "radius": 319.85},
               "inclusion": true, "version": 1}],
  "polygons": [{"inclusion": true, "version": 1, "polygon": [
    [47.39807773798406, 8.543834631785785], [47.39983519888905, 8.550024648373267],
    [47.39641100087146, 8.54499282423751], [47.395590322265186, 8.539435808992085]]}],
  "version": 2},
 "rallyPoints": {"points": [[47.39760401, 8.5509154, 50], [47.39902017, 8.54263274, 50]],
                 "version": 2},
 "mission": {"cruiseSpeed": 15, "firmwareType": 12, "globalPlanAltitudeMode": 1, "hoverSpeed": 5,
  "items": [{"AMSLAltAboveTerrain": null, "Altitude": 50, "AltitudeMode": 0, "autoContinue": true,
    "command": 22, "doJumpId": 1, "frame": 3, "type": "SimpleItem",
    "params": [15, 0, 0, null, 47.3985099, 8.5451002, 50]}],
  "plannedHomePosition": [47.3977419, 8.545594, 487.989], "vehicleType": 2, "version": 2}}
"""

values = st.floats(-1e300, 1e300) | st.just(math.nan)
whole_int32 = st.integers(-(2**31), 2**31 - 1)
places = (st.integers(-900_000_000, 900_000_000), st.integers(-1_800_000_000, 1_800_000_000))
finite = st.floats(-1e300, 1e300)
homes = st.none() | st.tuples(*(part.map(lambda n: (n or 1) / 1e7) for part in places), finite)
items = st.builds(
    MissionItem,
    command=st.sampled_from([16, 17, 18, 19, 20, 21, 22, 178, 183, 187, 195, 211, 400, 31999]),
    frame=st.sampled_from([0, 1, 2, 3, 5, 6, 10, 11]),
    x=whole_int32,
    y=whole_int32,
    z=values,
    param1=values,
    param2=values,
    param3=values,
    param4=values,
    autocontinue=st.integers(0, 1),
)


@st.composite
def missions(draw: st.DrawFn) -> Items:
    mission: list[MissionItem] = draw(st.lists(items, max_size=6))
    if draw(st.booleans()) and mission:
        target = draw(st.integers(0, len(mission) - 1))
        mission.append(MissionItem(177, 2, 0, 0, 0.0, float(target), 3.0))
    return tuple(mission)


@st.composite
def fences(draw: st.DrawFn) -> Items:
    fence: list[MissionItem] = []
    for command in draw(st.lists(st.sampled_from([5001, 5002]), max_size=3)):
        vertices = draw(st.lists(st.tuples(*places), min_size=1, max_size=5))
        count = float(len(vertices))
        fence += [MissionItem(command, 0, x, y, 0.0, count, autocontinue=0) for x, y in vertices]
    for command in draw(st.lists(st.sampled_from([5003, 5004]), max_size=3)):
        x, y = draw(st.tuples(*places))
        fence.append(MissionItem(command, 0, x, y, 0.0, draw(finite), autocontinue=0))
    if draw(st.booleans()):
        fence.append(MissionItem(5000, 3, 363000000, -842000000, draw(finite), autocontinue=0))
    return tuple(fence)


rallies = st.lists(
    st.builds(MissionItem, st.just(5100), st.just(3), *places, finite, autocontinue=st.just(0)),
    max_size=3,
).map(tuple)


@given(missions(), fences(), rallies, homes)
def test_a_plan_file_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, mission: Items, fence: Items, rally: Items, home: Any
) -> None:
    path = tmp_path_factory.mktemp("plan") / "a.plan"
    plan = Plan(mission, fence, rally, home)
    write_plan(path, plan, stack_named("px4", "plane"))
    assert repr(read_any(path)) == repr(plan)  # repr, because NaN is not equal to NaN


@given(missions(), homes)
def test_a_wpl_file_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, mission: Items, home: Any
) -> None:
    path = tmp_path_factory.mktemp("wpl") / "a.waypoints"
    write_any(path, Plan(mission, home=home), None)
    assert repr(read_any(path)) == repr(Plan(mission, home=home))


def test_the_documented_plan_is_read_as_qgroundcontrol_sends_it(tmp_path: Path) -> None:
    path = tmp_path / "doc.plan"
    path.write_text(DOCUMENTED, encoding="utf-8")
    plan = read_any(path)
    (takeoff,) = plan.mission
    assert (takeoff.command, takeoff.frame, takeoff.x, takeoff.y, takeoff.z) == (
        *(22, 3, 473985099, 85451002, 50.0),
    )
    assert takeoff.param1 == 15.0
    assert math.isnan(takeoff.param4)
    assert [(item.command, item.frame, item.param1) for item in plan.fence] == [
        *[(5001, 0, 4.0)] * 4,
        (5003, 0, 319.85),
    ]
    assert (plan.fence[1].x, plan.fence[1].y) == (473998352, 85500246)
    assert [(item.command, item.frame, item.z) for item in plan.rally] == [(5100, 3, 50.0)] * 2
    assert plan.home == (47.3977419, 8.545594, 487.989)


def test_the_written_plan_has_what_qgroundcontrol_requires(tmp_path: Path) -> None:
    path = tmp_path / "a.plan"
    jump = MissionItem(177, 2, 0, 0, 0.0, 1.0, 2.0)
    above_home = MissionItem(16, 3, 363000000, -842000000, 60.0)
    point = MissionItem(16, 10, 363000000, -842000000, 60.0, param4=math.nan)
    plan = Plan((*flight_of(), above_home, point, jump), home=HOME)
    write_plan(path, plan, stack_named("px4", "plane"))
    content = json.loads(path.read_text(encoding="utf-8"))
    first, *_, relative, terrain, last = content["mission"]["items"]
    assert content["mission"]["plannedHomePosition"] == [36.3, -84.2, 300.0]
    assert content["mission"]["firmwareType"] == 12
    assert (first["doJumpId"], first["AltitudeMode"], first["Altitude"]) == (1, 2, 360.0)
    assert first["params"][4:] == [36.3, -84.2, 360.0]
    assert relative["AltitudeMode"] == 1
    assert (terrain["AltitudeMode"], terrain["params"][3]) == (4, None)
    assert last["params"][0] == 2.0  # the doJumpId of the item at index 1
    assert "Altitude" not in last
    assert content["geoFence"] == {"circles": [], "polygons": [], "version": 2}


def test_a_jump_is_found_by_its_id_not_its_place(tmp_path: Path) -> None:
    path = tmp_path / "a.plan"
    jump = MissionItem(177, 2, 0, 0, 0.0, 2.0, 3.0)
    write_plan(path, Plan((*flight_of(), jump)), None)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["mission"]["items"][2]["doJumpId"] = 77
    content["mission"]["items"][-1]["params"][0] = 77
    path.write_text(json.dumps(content), encoding="utf-8")
    assert read_any(path).mission[-1] == jump
    content["mission"]["items"][-1]["params"][0] = 99
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(BridgeError, match="item 5 jumps to doJumpId 99"):
        read_any(path)


def test_an_open_position_is_null_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.plan"
    write_plan(path, Plan((MissionItem(21, 3, NO_POSITION, NO_POSITION, 0.0),)), None)
    params = json.loads(path.read_text(encoding="utf-8"))["mission"]["items"][0]["params"]
    assert params[4:6] == [None, None]
    assert read_any(path).mission[0].x == NO_POSITION


def changed(tmp_path: Path, change: dict[str, Any]) -> Path:
    """Return the documented plan with other values at dotted keys."""
    content = json.loads(DOCUMENTED)
    for key, value in change.items():
        *way, last = (int(part) if part.isdigit() else part for part in key.split("."))
        inner = content
        for part in way:
            inner = inner[part]
        inner[last] = value
    path = tmp_path / "bad.plan"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("mission.items.0", {"type": "ComplexItem", "complexItemType": "survey"}, "survey"),
        ("mission.items.0.type", "ComplexItem", "item 0 is a ComplexItem"),
        ("mission.items.0", 5, "item 0 is not a JSON object"),
        ("mission.items.0.params", [1, 2], "item 0 is invalid: params is not a list of 7"),
        ("mission.items.0.params.0", "12", "params is '12'"),
        ("mission.items.0.params.0", True, "params is True"),
        ("mission.items.0.params.0", 10**400, "params is 1000"),
        ("mission.items.0.params.4", 300.0, "param 5"),
        ("mission.items.0.command", 22.5, "command is 22.5"),
        ("mission.items.0.frame", 256, "frame is 256"),
        ("mission.items.0.autoContinue", 1, "autoContinue"),
        ("mission.items", None, "items is not a list"),
        ("mission.version", 1, "mission version 1"),
        ("mission.plannedHomePosition", [1, 2], "plannedHomePosition"),
        ("version", 2, "plan version 2"),
        ("fileType", "Fence", "not a QGroundControl"),
        ("geoFence", {"version": 1, "polygon": [[1, 2]]}, "geoFence has version 1"),
        ("geoFence.polygons.0.inclusion", None, "geofence polygon 0: inclusion"),
        ("geoFence.polygons.0.polygon", [], "geofence polygon 0 has no vertices"),
        ("geoFence.polygons.0.polygon.1", [91.0, 0.0], "polygon 0: 91, 0"),
        ("geoFence.circles.0.circle", {"radius": 5}, "geofence circle 0 has no center"),
        ("rallyPoints.points.1", [1, 2], "rally point 1 is not a list of 3"),
    ],
)
def test_a_bad_plan_is_refused_in_one_line(
    tmp_path: Path, key: str, value: Any, words: str
) -> None:
    with pytest.raises(BridgeError) as caught:
        read_any(changed(tmp_path, {key: value}))
    assert words in str(caught.value)
    assert "bad.plan" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"mission": {"items": NaN}}', "[" * 100_000])
def test_what_is_no_plan_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.plan"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BridgeError, match=r"bad\.plan: not a QGroundControl \.plan"):
        read_any(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BridgeError, match=r"bad\.plan: cannot be read"):
        read_any(path)


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (Plan((MissionItem(16, 0, 0, 0, math.inf),)), "inf"),
        (Plan((), (MissionItem(5001, 0, 0, 0, 0.0, 3.0),)), "fence item 0 is one of 3 vertices"),
        (
            Plan((), (MissionItem(5001, 0, 0, 0, 0.0, math.nan),)),
            "fence item 0 is one of nan vertices",
        ),
        (Plan((), (MissionItem(5003, 0, 0, 0, 0.0, 9.0, 1.0),)), "params 2 to 4"),
        (Plan((), (MissionItem(16, 0, 0, 0, 0.0),)), "fence item 0: unexpected NAV_WAYPOINT"),
        (Plan((), (), (MissionItem(5100, 0, 0, 0, 0.0),)), "rally point 0 has frame 0"),
        (Plan((), (), (MissionItem(16, 3, 0, 0, 0.0),)), "rally item 0 is a NAV_WAYPOINT"),
    ],
)
def test_what_a_plan_file_cannot_hold_is_not_written(
    tmp_path: Path, plan: Plan, words: str
) -> None:
    with pytest.raises(BridgeError, match=words):
        write_plan(tmp_path / "a.plan", plan, None)
    assert not (tmp_path / "a.plan").exists()


def test_pymavlink_reads_a_wpl_file_the_same_and_is_read(tmp_path: Path) -> None:
    mavwp = pytest.importorskip("pymavlink.mavwp")
    path, again = tmp_path / "a.waypoints", tmp_path / "b.waypoints"
    drop = MissionItem(183, 2, 0, 0, 0.0, 9.0, 1900.0)
    jump = MissionItem(177, 2, 0, 0, 0.0, 1.0, -1.0)
    plan = Plan((*flight_of(), drop, jump), home=HOME)
    write_wpl(path, plan)
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(plan.mission) + 1
    home, *rest = (loader.wp(index) for index in range(loader.count()))
    assert (home.x, home.y, home.z, home.current) == (*HOME, 1)
    for theirs, ours in zip(rest, jumps_moved(plan.mission, 1), strict=True):
        params = [theirs.param1, theirs.param2, theirs.param3, theirs.param4]
        assert (theirs.command, theirs.frame) == (ours.command, ours.frame)
        assert [*params, theirs.x, theirs.y, theirs.z] == list(params_of(ours))
    loader.save(str(again))
    assert read_any(again) == plan


WPL = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36.3\t-84.2\t300\t1\n"


def test_wpl_files_of_other_stations_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(WPL.replace("\n", "\r\n") + "# a comment\r\n\r\n", encoding="utf-8")
    assert read_any(path) == Plan((), home=HOME)
    path.write_text(WPL.replace("\t16\t", "\t0\t"), encoding="utf-8")  # Mission Planner's home
    assert read_any(path) == Plan((), home=HOME)
    path.write_text(WPL.replace("110", "120"), encoding="utf-8")
    assert read_any(path).mission[0].z == 300.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (WPL.replace("110", "100"), "line 1 is 'QGC WPL 100'"),
        (WPL.replace("\t16\t", "\t22\t"), "item 0 is a NAV_TAKEOFF"),
        (WPL.replace("\t0\t16", "\t3\t16"), "in frame 3"),
        (WPL.replace("\t300", ""), "line 2: 11 values"),
        (WPL.replace("36.3", "36,3"), "line 2: "),
        (WPL.replace("36.3", "inf"), "line 2: an infinite"),
        (WPL.replace("36.3", "363000000"), "line 2: param 5"),
        (WPL + WPL.splitlines()[1], "line 3: the item has number 0 instead of 1"),
    ],
)
def test_a_bad_wpl_file_is_refused_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.waypoints"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BridgeError, match=words) as caught:
        read_any(path)
    assert "bad.waypoints" in str(caught.value)


def test_a_wpl_file_holds_no_fence(tmp_path: Path) -> None:
    fence = (MissionItem(5003, 0, 0, 0, 0.0, 9.0),)
    with pytest.raises(BridgeError, match="cannot store a fence"):
        write_any(tmp_path / "a.waypoints", Plan(flight_of(), fence), None)
    with pytest.raises(BridgeError, match="infinite"):
        write_wpl(tmp_path / "a.waypoints", Plan((MissionItem(16, 0, 0, 0, math.inf),)))


def test_positions_are_kept_in_the_units_of_their_frame() -> None:
    assert params_of(MissionItem(16, 0, 10_000_000, 0, 0.0))[4] == 1.0
    # Param 5 of an item without a position.
    assert params_of(MissionItem(187, 2, 1, 0, 0.0))[4] == 1.0
    assert params_of(MissionItem(203, mavlink.MAV_FRAME_GLOBAL, 1, 0, 0.0))[4] == 1.0
    assert params_of(MissionItem(16, mavlink.MAV_FRAME_LOCAL_NED, 10_000, 0, 0.0))[4] == 1.0


def test_the_suffix_selects_the_format_and_another_is_refused(tmp_path: Path) -> None:
    plan = Plan(flight_of())
    for name in ("a.plan", "a.WAYPOINTS", "a.txt"):
        write_any(str(tmp_path / name), plan, None)
        assert len(read_any(str(tmp_path / name)).mission) == len(plan.mission)
    for name in ("first.xyz", "first"):
        with pytest.raises(BridgeError, match=r"first.*; use \.plan, \.waypoints or \.txt"):
            write_any(tmp_path / name, plan, None)
        assert not (tmp_path / name).exists()
