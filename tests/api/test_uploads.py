"""Uploaded perimeters are read in a separate process, which may crash."""

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
import shapely

from firemodel.spread.front import multipolygon
from mission_service.events import Corrected
from mission_service.interfaces.api import perimeter_routes
from mission_service.interfaces.maps import perimeter_import, thinning
from mission_service.interfaces.maps.thinning import min_areas_removed, thinned
from mission_service.interfaces.maps.upload_worker import MAX_POINTS, MAX_RINGS, corrections_of
from tests.api.worlds import World, client, scenario_of, served, world_in

PATH = "/api/v1/fire/perimeter"
DIES = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
HANGS = "import signal; signal.pause()"


def comb(world: World, teeth: int) -> dict[str, Any]:
    """Return a valid polygon with many teeth on the landscape."""
    land = world.context.landscape
    rows, cols = land.shape
    south, west = land.lat_lon_of(*land.xy_of(rows * 0.6, cols * 0.4))
    north, east = land.lat_lon_of(*land.xy_of(rows * 0.4, cols * 0.6))
    middle = (south + north) / 2
    ring = [
        [round(west + (east - west) * k / teeth, 8), north if k % 2 else middle]
        for k in range(teeth)
    ]
    ring += [[east, south], [west, south]]
    return {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}


def sent(world: World, *bodies: bytes) -> list[httpx.Response]:
    async def go() -> list[httpx.Response]:
        service = served(world)
        async with client(service.app, timeout=120.0) as http:
            answers = [
                await http.post(PATH, content=each, headers=service.headers()) for each in bodies
            ]
            assert (await http.get("/healthz")).status_code == 200
        service.app.api.context.close()
        return answers

    return asyncio.run(go())


def test_a_comb_of_sixty_thousand_teeth_is_taken_thinned(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(10.0)
    (answer,) = sent(world, json.dumps(comb(world, 60_000)).encode())
    assert answer.status_code == 200, answer.text
    assert answer.json()["perimeter"]["properties"]["vertices"] == 60_003
    (event,) = world.submitted
    assert 500 < len(event.points) <= MAX_POINTS  # type: ignore[union-attr]


def test_none_of_it_is_read_in_the_process_that_flies(
    standing: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any) -> None:
        raise AssertionError("read here")

    for name in ("read_perimeter", "read_perimeter_in", "features_in"):
        monkeypatch.setattr(perimeter_import, name, never)
    monkeypatch.setattr(thinning, "thinned", never)
    deep = b'{"type": "Feature", "geometry": ' + b"[" * 100_000
    taken, refused = sent(standing, json.dumps(comb(standing, 3000)).encode(), deep)
    assert taken.status_code == 200, taken.text
    assert refused.status_code == 422
    assert "is not JSON" in refused.json()["error"]


@pytest.mark.parametrize(("does", "words"), [(DIES, "ended with SIGSEGV"), (HANGS, "more than")])
def test_a_reader_that_dies_or_hangs_is_one_line(
    standing: World, monkeypatch: pytest.MonkeyPatch, does: str, words: str
) -> None:
    before = len(standing.submitted)
    whole = perimeter_routes.WORKER
    monkeypatch.setattr(perimeter_routes, "WORKER", (sys.executable, "-c", does))
    if does is HANGS:
        monkeypatch.setattr(perimeter_routes, "WITHIN_S", 0.5)
    drawn = json.dumps(comb(standing, 10)).encode()
    (answer,) = sent(standing, drawn)
    assert answer.status_code == 422
    assert words in answer.json()["error"]
    assert "\n" not in answer.json()["error"]
    assert len(standing.submitted) == before
    monkeypatch.setattr(perimeter_routes, "WORKER", whole)
    monkeypatch.setattr(perimeter_routes, "WITHIN_S", 120.0)
    (answer,) = sent(standing, drawn)  # the next upload is accepted
    assert answer.status_code == 200


def test_thinning_keeps_what_spans_most() -> None:
    square = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 1.0), (0.5, 1.01), (0.0, 1.0)]
    assert min_areas_removed(square, 4) == [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert thinned(square, 6) == square
    assert len(thinned(square, 3)) == 3


def test_thinned_rings_do_not_cross_themselves() -> None:
    slit = [(5.1, 5.0), (5.0, -0.2), (4.9, 5.0)]  # the line ends in a bulge of the other side
    ring = [(0.0, 0.0), (4.0, 0.0), (5.0, -0.5), (6.0, 0.0), (10.0, 0.0), (10.0, 5.0)]
    ring += [*slit, (0.0, 5.0)]
    assert shapely.Polygon(ring).is_valid
    assert not shapely.Polygon(min_areas_removed(ring, 9)).is_valid
    for most in (9, 8, 6, 4):
        found = thinned(ring, most)
        assert 3 <= len(found) <= most
        assert shapely.Polygon(found).is_valid


def around(world: World, row: float, col: float, half_m: float) -> list[list[float]]:
    """Return a closed square ring around a place, with longitude and latitude."""
    land = world.context.landscape
    x_m, y_m = (float(each) for each in land.xy_of(row, col))
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    places = [land.lat_lon_of(x_m + dx * half_m, y_m + dy * half_m) for dx, dy in corners]
    return [[float(lon), float(lat)] for lat, lon in places]


def posted(world: World, *polygons: list[list[list[float]]]) -> dict[str, Any]:
    drawn = {"type": "MultiPolygon", "coordinates": polygons}
    (answer,) = sent(world, json.dumps(drawn).encode())
    assert answer.status_code == 200, answer.text
    result: dict[str, Any] = answer.json()
    return result


def test_the_inside_of_a_perimeter_has_burned_and_its_edge_burns(standing: World) -> None:
    standing.simulation.service.cameras = None  # otherwise images remove ground that does not burn
    standing.fly(3600.0)
    (accepted,) = posted(standing, [around(standing, 30, 118, 700.0)])["accepted"]
    assert accepted["burned_ha_before"] < 40.0
    assert accepted["burned_ha_after"] == pytest.approx(196.0, rel=0.03)
    fire = standing.simulation.estimate.fire
    front = fire.front(fire.time_s)
    assert front.area / 1e4 == pytest.approx(196.0, rel=0.03)
    assert front.length == pytest.approx(5600.0, rel=0.1)
    standing.fly(4200.0)
    assert standing.simulation.estimate.fire.burned_ha > accepted["burned_ha_after"] + 5.0


def test_islands_of_a_perimeter_are_unburned_and_fire_in_an_island_burns(standing: World) -> None:
    large, island, small = (around(standing, 75, 75, half_m) for half_m in (900.0, 450.0, 150.0))
    posted(standing, [small], [large, island], [around(standing, 20, 20, 150.0)])
    states = [each.state for each in standing.submitted if isinstance(each, Corrected)]
    assert states == ["burning", "unburned", "burning", "burning"]
    burned = standing.simulation.estimate.fire.burned()
    assert [burned[75, col] for col in (75, 65, 55)] == [True, False, True]
    assert burned[20, 20]


def test_of_many_islands_the_largest_stay_unburned_and_a_note_counts_the_rest() -> None:
    square = shapely.box(0.0, 0.0, 1.0, 1.0)
    islands = [shapely.box(0.01 * k, 0.5, 0.01 * k + 0.0001 * k, 0.6) for k in range(1, 61)]
    area = multipolygon(square.difference(shapely.union_all(islands)))
    perimeter = perimeter_import.Perimeter(area, 1.0, 244, [], [])
    requests = corrections_of(perimeter, shapely.box(-1.0, -1.0, 2.0, 2.0))
    assert [each["state"] for each in requests] == ["burning"] + ["unburned"] * (MAX_RINGS - 1)
    assert min(shapely.Polygon(each["points"]).area for each in requests) > 0.0001 * 11 * 0.1
    assert perimeter.notes == ["the 11 smallest of 60 unburned islands count as burned"]


def test_a_perimeter_partly_off_the_landscape_burns_the_part_on_it(standing: World) -> None:
    found = posted(standing, [around(standing, 0, 75, 600.0)], [around(standing, -300, 75, 150.0)])
    assert "of the area lies outside the landscape" in found["perimeter"]["properties"]["notes"][0]
    assert len(found["accepted"]) == 1
    assert standing.simulation.estimate.fire.burned()[0:20, 56:95].all()
