"""Perimeters that others send are read in a process that may die."""

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
import shapely

from mission_service.interfaces.api import perimeter_routes
from mission_service.interfaces.maps import perimeter_import, thinning
from mission_service.interfaces.maps.perimeter_worker import MAX_POINTS
from mission_service.interfaces.maps.thinning import min_areas_removed, thinned
from tests.api.worlds import World, client, scenario_of, served, world_in

PATH = "/api/v1/fire/perimeter"
DIES = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
HANGS = "import signal; signal.pause()"


def comb(world: World, teeth: int) -> dict[str, Any]:
    """A valid polygon with many teeth, on the landscape."""
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
        service.app.api.close()
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
    (answer,) = sent(standing, drawn)  # and the next is taken
    assert answer.status_code == 200


def test_thinning_keeps_what_spans_most() -> None:
    square = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 1.0), (0.5, 1.01), (0.0, 1.0)]
    assert min_areas_removed(square, 4) == [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert thinned(square, 6) == square
    assert len(thinned(square, 3)) == 3


def test_thinned_rings_do_not_cross_themselves() -> None:
    slit = [(5.1, 5.0), (5.0, -0.2), (4.9, 5.0)]  # it ends in the bulge of the other side
    ring = [(0.0, 0.0), (4.0, 0.0), (5.0, -0.5), (6.0, 0.0), (10.0, 0.0), (10.0, 5.0)]
    ring += [*slit, (0.0, 5.0)]
    assert shapely.Polygon(ring).is_valid
    assert not shapely.Polygon(min_areas_removed(ring, 9)).is_valid
    for most in (9, 8, 6, 4):
        found = thinned(ring, most)
        assert 3 <= len(found) <= most
        assert shapely.Polygon(found).is_valid
