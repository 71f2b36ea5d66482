"""The sources of observations over HTTP and in the live stream."""

import asyncio
from typing import Any

import msgspec

from mission_service.events import FireObserved
from tests.api.worlds import World, client, served

V1 = "/api/v1"


def get(world: World, *paths: str) -> list[Any]:
    """Return the JSON at paths of the API."""

    async def ask() -> list[Any]:
        service = served(world)
        async with client(service.app, headers=service.headers("look")) as http:
            answers = [await http.get(V1 + path) for path in paths]
        assert [each.status_code for each in answers] == [200] * len(paths)
        return [each.json() for each in answers]

    return asyncio.run(ask())


def test_cameras_and_a_detector_are_listed_with_their_footprints(flying: World) -> None:
    world = flying
    now_us = world.simulation.clock.now_us
    here = (36.3708, -84.1323)
    seen = FireObserved(
        now_us, "anna", "tower", "hot", "points", (here,), now_us, 20.0, 0.0, "detector 7"
    )
    world.context.state_view.apply(seen, [])

    sources, state, footprints = get(world, "/fire/sources", "/state", "/fire/observations")
    assert state["sources"] == sources
    assert sources == msgspec.to_builtins(world.context.state_view.sources())
    of = {each["source"]: each for each in sources}
    assert (of["hawk"]["kind"], of["hawk"]["state"]) == ("camera", "live")
    assert of["hawk"]["observations"] > 10
    assert of["hawk"]["unburned_cells"] > 100
    assert (of["detector 7 of anna"]["kind"], of["detector 7 of anna"]["burned_cells"]) == (
        "detector",
        1,
    )

    found = [each["properties"] for each in footprints["features"]]
    assert {each["source"] for each in found} >= {"hawk", "detector 7 of anna"}
    assert {each["part"] for each in found if each["source"] == "hawk"} >= {"seen"}
    reported = footprints["features"][-1]
    assert reported["properties"]["part"] == "reported"
    assert reported["geometry"]["coordinates"] == [[here[1], here[0]]]

    before = found[-1]["number"] - 1
    (newer,) = get(world, f"/fire/observations?after={before}")
    assert [each["properties"]["source"] for each in newer["features"]] == ["detector 7 of anna"]
    (none,) = get(world, f"/fire/observations?after={found[-1]['number']}")
    assert none["features"] == []
