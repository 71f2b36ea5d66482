"""The random worlds of ``benchmarks.airspace_worlds``, and the checker of their flights."""

import math
from typing import Any

import pytest

from benchmarks.airspace_worlds import fly
from benchmarks.worlds.checker import Checker
from benchmarks.worlds.ground import Terrain, lat_lon_of
from benchmarks.worlds.outlines import Closed
from benchmarks.worlds.planted_faults import FAULTS
from benchmarks.worlds.random_world import START_S, landscape_of, world_of
from benchmarks.worlds.rules import Kind, Rules

SQUARE = [(500.0, -200.0), (900.0, -200.0), (900.0, 200.0), (500.0, 200.0)]
LEVEL = Terrain(300.0)
HILL = Terrain(300.0, hills=((300.0, 600.0, 80.0, 100.0),))


def rules(terrain: Terrain = LEVEL, **volume: Any) -> Rules:
    kind = Kind(True, 15.0, 60.0, 90.0, 100.0, (0.0, 0.0, 300.0))
    closed = Closed("square", SQUARE, **volume)
    return Rules([closed], 60.0, 15.0, None, 40.0, {"v0": kind}, (0.0, 0.0), terrain)


def at(seconds: float, east_m: float, north_m: float, altitude_m: float = 420.0) -> dict[str, Any]:
    lat_deg, lon_deg = lat_lon_of(east_m, north_m)
    return {
        "event": {
            "type": "Telemetry",
            "vehicle": "v0",
            "at_us": round(seconds * 1e6),
            "lat_deg": lat_deg,
            "lon_deg": lon_deg,
            "altitude_amsl_m": altitude_m,
            "altitude_relative_m": altitude_m - 300.0,
            "velocity_north_m_s": 0.0,
            "velocity_east_m_s": 15.0,
        }
    }


def upload(*places: tuple[float, float, float], why: str = "the front") -> dict[str, Any]:
    items = []
    for east_m, north_m, altitude_m in places:
        lat_deg, lon_deg = lat_lon_of(east_m, north_m)
        x, y = round(lat_deg * 1e7), round(lon_deg * 1e7)
        items.append({"command": 16, "frame": 0, "x": x, "y": y, "z": altitude_m})
    items[-1] |= {"command": 17, "param3": 90.0}
    return {
        "command": {
            "type": "UploadMission",
            "vehicle": "v0",
            "mission_id": 1,
            "why": why,
            "items": items,
            "lands": False,
        }
    }


def found(lines: list[dict[str, Any]], allowed: Rules) -> list[str]:
    checker = Checker(allowed)
    return [words for line in lines for words in checker.receive(line)]


@pytest.mark.parametrize(
    ("places", "words"),
    [
        ([(100.0, 300.0, 420.0), (1500.0, 300.0, 420.0)], ""),
        ([(100.0, 240.0, 420.0), (1500.0, 300.0, 420.0)], "leads into square"),  # in the margin
        ([(100.0, 0.0, 420.0), (1500.0, 0.0, 420.0)], "leads into square"),
        ([(100.0, 0.0, 420.0), (400.0, 0.0, 420.0)], "leads to a place in square"),  # the loiter
        ([(700.0, 300.0, 420.0), (700.0, 500.0, 420.0)], "on the way to its first position"),
        ([(100.0, 500.0, 390.0), (1500.0, 500.0, 420.0)], "is 90 m above the ground"),
    ],
)
def test_the_checker_compares_missions_with_the_margin_and_the_floor(
    places: list[tuple[float, float, float]], words: str
) -> None:
    violations = found([at(10.0, -300.0, -600.0), upload(*places)], rules())
    assert [words in each for each in violations] == [True] * bool(words), violations


def test_the_checker_uses_times_and_altitudes_of_volumes() -> None:
    through = upload((100.0, 0.0, 420.0), (1500.0, 0.0, 420.0))
    lines = [at(100.0, -300.0, -600.0), through]
    assert not found(lines, rules(known_s=101.0))
    assert not found(lines, rules(until_s=99.0))
    assert not found(lines, rules(floor_m=440.0))
    assert not found(lines, rules(ceiling_m=400.0))
    assert found(lines, rules(ceiling_m=410.0))  # within the vertical margin
    assert found(lines, rules(floor_m=100.0, floor_agl=True))
    assert not found(lines, rules(floor_m=130.0, floor_agl=True))


@pytest.mark.parametrize(
    ("height_m", "mode", "towards_m", "is_free"),
    [
        (1.8, "hold", -300.0, True),  # it hovers, and may leave the margin
        (1.8, "hold", 490.0, False),
        (1.8, "return", -300.0, False),
        (0.5, "hold", -300.0, False),  # it stands on the ground
    ],
)
def test_the_checker_permits_a_hovering_vehicle_to_leave_a_margin(
    height_m: float, mode: str, towards_m: float, is_free: bool
) -> None:
    changed = {
        "type": "ModeChanged",
        "vehicle": "v0",
        "at_us": 11_000_000,
        "armed": True,
        "mode": mode,
    }
    lines = [at(10.0, 460.0, 0.0), at(11.0, 460.0, 0.0, 300.0 + height_m), {"event": changed}]
    leaves = upload((460.0, 0.0, 420.0), (towards_m, 0.0, 420.0))
    assert (found([*lines, leaves], rules()) == []) is is_free
    assert found([lines[-1], lines[-2], leaves], rules())  # before its takeoff


def test_the_checker_finds_a_hill_between_two_positions() -> None:
    over = upload((100.0, 600.0, 420.0), (1500.0, 600.0, 420.0))
    assert not found([at(10.0, 0.0, 600.0), over], rules())
    (words,) = found([at(10.0, 0.0, 600.0), over], rules(HILL))
    assert "a leg is 40 m above the ground, less than 100 m" in words


def test_the_checker_finds_a_vehicle_that_enters_or_stays() -> None:
    enters = [at(seconds, -600.0 + 15.0 * seconds, 0.0) for seconds in range(90)]
    assert found(enters, rules()) == ["74 s: v0 enters square"]
    led = {"truth": {"type": "Led", "vehicle": "v0", "at_us": 1, "led": False}}
    assert not found([led, *enters], rules())
    stays = [at(seconds, 700.0, 0.0) for seconds in range(200)]
    unanswered, words = found(stays, rules(from_s=20.0, known_s=20.0))
    assert unanswered == "41 s: v0 gets no command in square for 20 s"
    assert "v0 stays in square for more than" in words
    way_out_s = 200.0 + 60.0 + 1.3 * 90.0 + 30.0
    seconds = float(words.split(" s:")[0]) - 20.0
    assert way_out_s / 15.0 < seconds < 2.5 * way_out_s / 15.0 + 20.0


def test_the_terrain_of_the_checker_is_that_of_the_service() -> None:
    terrain = next(world.terrain for world in map(world_of, range(20)) if world.terrain.hills)
    landscape = landscape_of(terrain)
    for number in range(50):
        bearing, away_m = 0.7 * number, 40.0 * number
        east_m, north_m = away_m * math.sin(bearing), away_m * math.cos(bearing)
        place_m = landscape.xy_of_lat_lon(*lat_lon_of(east_m, north_m))
        ground_m = float(landscape.elevation_at(*place_m))
        assert ground_m == pytest.approx(float(terrain.ground_m(east_m, north_m)), abs=2.0)


def test_a_world_is_the_same_each_time() -> None:
    assert world_of(3) == world_of(3)
    assert world_of(3).requests != world_of(4).requests
    assert all(request.at_us / 1e6 > START_S for request in world_of(3).requests)


@pytest.mark.long
@pytest.mark.parametrize(
    "seed",
    [
        *(*range(12), 341, 360, 20010, 20019, 21015, 21024, 30053, 30139, 31015),
        *(40115, 40149, 40403, 40583, 40772, 41067, 50255, 50786, 50989),
        *(60454, 60833, 61123, 73452),
        *(92273, 92621, 93158, 70326, 81126, 80201, 200162, 201590, 302075),
        *(7101969, 7102246, 7300849, 8001041, 8010339, 8030874, 8031521, 8080145, 8080454),
    ],
)
def test_a_random_world_has_no_violation(seed: int) -> None:
    """In 341 and 360, vehicles are sent home from inside a volume that is closed over home.

    In 20010 and 20019 a vehicle descends because of another aircraft beside closed airspace, in
    21015 a plane holds over rising ground, and in 21024 a plane holds for an upload,
    and in 31015 a volume closes over the end of a way out. In 30053 the circle above home is in a
    closed volume, in 30139 and 40115 a vehicle leaves at the limit of the vertical margin, in 40149
    and 40403 a plane turns at a corner beside a volume, in 40583 at a first position behind it, and
    in 40772 and 50255 a person orders a hold beside a volume. In 41067 a volume closes over the end
    of a way out before its start, in 50786 a climb out of a volume would lead into another one, and
    in 50989 a plane flies beside the line to its loiter. In 60454 a return beside a volume cannot
    be flown, in 60833 a level way out ends near the ground, in 61123 a mission begins in a margin,
    and in 73452 a volume is closed above a hold over rising ground. In 92273 a volume closes during
    the upload of a way home, in 92621 a multirotor is low below a volume, in 93158 and 200162 a
    hold is raised beside a volume, in 70326 and 81126 the ground rises faster than a plane climbs,
    in 80201 a multirotor lands beside a volume, in 201590 an autopilot is restarted below the
    altitude of its home, and in 302075 a hill is on the way home of an ordered return. In 7101969 a
    hold is raised below a volume because of ground beside its circle, in 7102246 a multirotor
    hovers in a margin after an interrupted landing, in 7300849 a hold is raised below a volume with
    a floor above ground, in 8001041 a volume closes around a multirotor that descends at its place
    before it flies home, in 8010339 the turn of a return is tighter than expected, in 8030874 a
    plane climbs above a volume too slowly, in 8031521 a turn to the nearest exit would lead into
    another volume, in 8080145 a multirotor that is far above its way home is ordered home from
    inside a volume, and in 8080454 a turn to the nearest exit might lead through another volume.
    """
    assert fly(seed)[1] == []


@pytest.mark.long
@pytest.mark.parametrize("fault", [fault.name for fault in FAULTS])
def test_the_checker_finds_each_planted_fault(fault: str) -> None:
    assert any(fly(seed, fault)[1] for seed in range(40))
