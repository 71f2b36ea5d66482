"""The sources of observations over HTTP and in the live stream."""

import asyncio
import io
from typing import Any

import httpx
import msgspec
import numpy as np
import pytest
from PIL import Image

from mission_service.events import FireObserved
from mission_service.fire.sensors import SensorImage, Sensors
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


def test_images_of_sensors_are_listed_and_drawn(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = flying

    def red(places: Any) -> Any:
        return np.tile(np.array([255, 0, 0, 255], dtype=np.uint8), (len(places), 1))

    class Camera:
        images = tuple(
            SensorImage(
                *(number, 3_700_000_000, "hawk", f"{number}.tif", (60.0, 60.0, 62.0, 64.0), red),
                *(((0.0, "#000000"), (600.0, "#ff0000")), "°C", (61.0, 62.0), 3.0, 2.0, 45.0),
            )
            for number in (7, 8)
        )

    (none,) = get(world, "/fire/images")
    assert none == []
    sensors = Sensors({"thermal": Camera()}, world.context.landscape.shape)  # type: ignore[dict-item]
    monkeypatch.setattr(world.context.service, "sensors", sensors)
    (found,) = get(world, "/fire/images")
    assert [(each["source"], each["number"]) for each in found] == [("thermal", 7), ("thermal", 8)]
    last = found[-1]
    assert (last["vehicle"], last["name"], last["at_us"]) == ("hawk", "8.tif", 3_700_000_000)
    (west, north), _, (east, south), _ = last["corners"]
    land = world.context.landscape
    lat, lon = land.lat_lon_of(*land.xy_of(np.array([60.0, 62.0]), np.array([60.0, 64.0])))
    margin = 2 * 2 / 111_000  # two metres, for the turn of the grid
    assert west - margin < lon.min() < lon.max() < east + margin
    assert south - margin < lat.min() < lat.max() < north + margin

    async def draw() -> list[httpx.Response]:
        service = served(world)
        async with client(service.app, headers=service.headers("look")) as http:
            paths = ("thermal/8.png", "thermal/9.png", "other/8.png")
            return [await http.get(f"{V1}/fire/images/{path}") for path in paths]

    drawn, *missing = asyncio.run(draw())
    assert drawn.headers["content-type"] == "image/png"
    with Image.open(io.BytesIO(drawn.content)) as picture:
        assert picture.size == (last["width_px"], last["height_px"])
        assert picture.getpixel((5, 5)) == (255, 0, 0, 255)
    assert [each.status_code for each in missing] == [404, 404]
    assert missing[0].json() == {"error": "no image 9 of 'thermal'"}
