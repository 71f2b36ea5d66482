"""Responses of the routes of a run with vehicles in the air."""

import asyncio
import errno
import io
import re
import zipfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import httpx
import jsonschema
import numpy as np
import pytest
import shapely
from PIL import Image

from autopilot_bridge.missions.plan_file import read_any
from mission_service.events import Corrected, OrderGiven, SettingsChanged, WindSet
from mission_service.guidance.protocol import Planner
from mission_service.interfaces.api.access.guard import AccessGuard
from mission_service.interfaces.api.app import role_of, routes_of
from mission_service.interfaces.api.journal_lines import JournalLines
from mission_service.journal.journal_file import Journal, SegmentReader
from mission_service.missions.mission_hash import mission_hash
from tests.api.worlds import SMALL, Served, World, calls, client, scenario_of, served, world_in
from tests.patience import PATIENCE_S

V1 = "/api/v1"
CENTRE = (36.364232, -84.140907)
# The landscape is three kilometres wide.
SQUARE = [(36.340, -84.176), (36.340, -84.139), (36.368, -84.139), (36.368, -84.176)]


def asked(world: World, ask: Callable[[httpx.AsyncClient], Awaitable[None]]) -> Served:
    """Run a coroutine against a run's application, with a token for all roles."""
    service = served(world)

    async def go() -> None:
        async with client(service.app, headers=service.headers(), timeout=PATIENCE_S) as http:
            await ask(http)
        service.app.api.context.close()

    asyncio.run(go())
    return service


async def got(http: httpx.AsyncClient, path: str, **params: Any) -> Any:
    answer = await http.get(V1 + path, params=params)
    assert answer.status_code == 200, (path, answer.text)
    return answer.json()


async def posted(http: httpx.AsyncClient, path: str, **body: Any) -> Any:
    answer = await http.post(V1 + path, json=body)
    assert answer.status_code == 200, (path, answer.text)
    return answer.json()


async def refused(http: httpx.AsyncClient, status: int, method: str, path: str, **body: Any) -> str:
    answer = await http.request(method, V1 + path, json=body or None)
    assert answer.status_code == status, (path, answer.text)
    assert list(answer.json()) == ["error"]
    text = str(answer.json()["error"])
    assert "\n" not in text
    return text


def checker(description: dict[str, Any], schema: dict[str, Any]) -> Any:
    return jsonschema.Draft202012Validator({**schema, "components": description["components"]})


def test_examples_and_answers_are_as_described(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        described = await got(http, "/openapi.json")
        compared = 0
        for path, operations in described["paths"].items():
            for method, operation in operations.items():
                right = operation["responses"]["200"]["content"]
                bodies = operation.get("requestBody", {}).get("content", {})
                for content in (*right.values(), *bodies.values()):
                    if "example" in content:
                        checker(described, content["schema"]).validate(content["example"])
                        compared += 1
                if method == "get" and "application/json" in right and "{z}" not in path:
                    there = path.replace("{name}", "hawk")
                    answer = await http.get(there)
                    if answer.status_code == 200:
                        schema = right["application/json"]["schema"]
                        checker(described, schema).validate(answer.json())
                        compared += 1
        assert compared > 60

    asked(flying, ask)


def test_the_state_is_all_that_a_page_needs(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        state = await got(http, "/state")
        assert state["version"] == flying.context.state_view.version
        assert state["roles"] == ["look", "observe", "correct", "fly", "approve"]
        assert [each["vehicle"] for each in state["vehicles"]] == ["hawk", "kite"]
        assert state["vehicles"] == await got(http, "/vehicles")
        assert state["burn"] is None
        west, south, east, north = state["landscape"]["bounds"]
        assert west < CENTRE[1] < east
        assert south < CENTRE[0] < north
        assert state["status"]["at_us"] == flying.simulation.clock.now_us
        assert state["planner"]["rule"] == state["rule"] == "islam_hu_damped"

    asked(flying, ask)


def test_a_track_is_the_flown_one(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        points = flying.context.state_view.statistics.vehicles["hawk"].track
        whole = await got(http, "/vehicles/hawk/track")
        assert len(whole["geometry"]["coordinates"]) == min(len(points), 3600) > 50
        assert whole["geometry"]["coordinates"][-1] == [points[-1][2], points[-1][1], points[-1][3]]
        after_us = points[-3][0]
        late = await got(http, "/vehicles/hawk/track", after_us=after_us)
        assert late["properties"]["at_us"] == [point[0] for point in points[-2:]]
        none = await got(http, "/vehicles/hawk/track", after_us=2**53)
        assert none["geometry"] is None
        assert "the vehicles are hawk, kite" in await refused(
            http, 404, "GET", "/vehicles/crow/track"
        )
        answer = await refused(http, 404, "GET", "/vehicles/hakw/track")
        assert "; did you mean hawk?" in answer

    asked(flying, ask)


def test_a_plan_file_holds_the_mission_on_board(flying: World, tmp_path: Path) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        mission = await got(http, "/vehicles/hawk/mission")
        answer = await http.get(f"{V1}/vehicles/hawk/mission.plan")
        path = tmp_path / "hawk.plan"
        path.write_bytes(answer.content)
        assert mission_hash(read_any(path).mission) == mission["on_board"]["mission_hash"]

    asked(flying, ask)


def test_a_preview_changes_nothing_and_a_renewal_is_sent(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(3660.0)
    before = world.context.state_view.missions["hawk"].on_board

    async def ask(http: httpx.AsyncClient) -> None:
        preview = await posted(http, "/vehicles/hawk/mission/preview")
        assert (
            world.context.state_view.missions["hawk"].on_board is before
        )  # a preview changes nothing
        assert preview["figures"]["min_height_agl_m"] > 100.0
        assert preview["figures"]["problems"] == []
        assert preview["figures"]["farthest_from_home_m"] > 500.0
        await posted(http, "/vehicles/hawk/mission/renew")
        sent = world.context.state_view.missions["hawk"].sending
        for _ in range(2000):
            if sent is not None:
                break
            world.simulation.step()
            sent = world.context.state_view.missions["hawk"].sending
        assert sent is not None
        assert (await got(http, "/vehicles/hawk/mission"))["sending"]["mission_id"] > 1

    asked(world, ask)


def test_the_figures_shown_are_those_of_the_mission_that_waits_for_a_word(tmp_path: Path) -> None:
    changes = (*SMALL, "mission.approval=each")
    world = world_in(tmp_path, scenario_of(changes=changes))
    world.fly(3602.0)
    waits = world.context.state_view.missions["hawk"].proposed
    assert waits is not None

    async def ask(http: httpx.AsyncClient) -> None:
        preview = await posted(http, "/vehicles/hawk/mission/preview")
        assert preview["mission_hash"] == waits.mission_hash
        assert preview["figures"]["items"] == len(waits.items) == len(preview["items"])
        assert preview["figures"]["problems"] == []
        assert preview["difference"]["added"] == len(waits.items)
        await posted(http, "/vehicles/hawk/mission/accept", hash=preview["mission_hash"])
        assert (await got(http, "/vehicles/hawk/mission"))["proposed"] is None

    asked(world, ask)


def test_importances_are_those_of_the_last_decision(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())

    async def early(http: httpx.AsyncClient) -> None:
        assert "no importance values yet" in await refused(
            http, 404, "GET", "/vehicles/hawk/importance"
        )

    asked(world, early)
    planner = cast(Planner, world.context.core.guidance.planners["hawk"])
    until_s = 3900.0
    while planner.phase != "monitor":
        until_s += 20.0
        world.fly(until_s)
    decided = world.context.state_view.vehicles["hawk"].decisions
    while world.context.state_view.vehicles["hawk"].decisions == decided:
        world.simulation.step()

    async def ask(http: httpx.AsyncClient) -> None:
        found = await got(http, "/vehicles/hawk/importance")
        vehicle = await got(http, "/vehicles/hawk")
        assert len(found["cells"]) == vehicle["front_cells"] > 20
        for side in ("importance_back", "importance_front"):
            assert found[side] == pytest.approx(vehicle[side], abs=0.01)
        half = len(found["cells"]) // 2
        assert sum(cell[2] for cell in found["cells"][:half]) == pytest.approx(
            found["importance_back"]
        )
        # The first cell is that of the vehicle or a neighbour.
        fix = world.context.state_view.telemetry["hawk"]
        away = np.hypot(found["cells"][0][0] - fix.lat_deg, found["cells"][0][1] - fix.lon_deg)
        assert away < 0.01

    asked(world, ask)


def test_importances_of_the_predictive_planner_are_expected_errors(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of("demo", (*SMALL, 'planner.rule="predictive"')))
    planner = cast(Planner, world.context.core.guidance.planners["hawk"])
    until_s = 3900.0
    while planner.phase != "monitor":
        until_s += 20.0
        world.fly(until_s)

    async def ask(http: httpx.AsyncClient) -> None:
        found = await got(http, "/vehicles/hawk/importance")
        values = [cell[2] for cell in found["cells"]]
        assert len(values) == 360
        assert found["importance_back"] == pytest.approx(sum(values[:180]))
        assert found["importance_front"] == pytest.approx(sum(values[180:]))
        # After the first lap the part behind the vehicle was observed most recently.
        assert sum(values[:120]) < sum(values[240:])
        fix = world.context.state_view.telemetry["hawk"]
        away = np.hypot(found["cells"][0][0] - fix.lat_deg, found["cells"][0][1] - fix.lon_deg)
        assert away < 0.01

    asked(world, ask)


def test_the_fire_can_be_seen_at_any_time(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        now = await got(http, "/fire/front")
        later = await got(http, "/fire/front", in_s=3600)
        past = await got(http, "/fire/front", at_s=flying.now_s - 1800)
        areas = [shapely.geometry.shape(each["geometry"]).area for each in (past, now, later)]
        assert areas == sorted(areas)
        assert areas[0] < areas[2]
        assert now["properties"]["at_s"] == pytest.approx(flying.now_s)
        contours = await got(http, "/fire/contours", in_min=[10, 20])
        assert len(contours["features"]) == 2
        assert (await got(http, "/fire/uncertainty", in_min=10))["features"]
        perimeter = await got(http, "/fire/perimeters.geojson")
        assert "IncidentName" in perimeter["features"][0]["properties"]
        both = await refused(http, 422, "GET", "/fire/front?at_s=1&in_s=1")
        assert both == "specify only one of at_s, in_s and in_min"
        for wrong in ("nan", "inf", "1e300", "soon", ""):
            await refused(http, 422, "GET", f"/fire/front?in_s={wrong}")
        assert "the limit is" in await refused(http, 422, "GET", "/fire/front?in_s=900000")

    asked(flying, ask)


@pytest.mark.parametrize("path", ["/fire/front", "/fire/uncertainty", "/fire/perimeters.geojson"])
def test_a_time_is_given_in_each_of_three_ways(flying: World, path: str) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        later = {"in_min": 10.0}, {"in_s": 600.0}, {"at_s": flying.now_s + 600.0}
        found = [await got(http, path, **each) for each in later]
        for each in found[1:]:
            each.pop("written_unix_ms", None)
        shapes = [each.get("features", [each])[0] for each in found]
        assert shapes[0]["geometry"] == shapes[1]["geometry"] == shapes[2]["geometry"]
        assert shapes[0]["properties"]["at_s"] == pytest.approx(flying.now_s + 600.0)
        assert "the limit is" in await refused(http, 422, "GET", f"{path}?in_min=500")

    asked(flying, ask)


def test_unknown_query_parameters_are_refused_on_every_route(flying: World) -> None:
    service = served(flying)

    async def ask() -> None:
        async with client(service.app, headers=service.headers()) as http:
            for call in calls(service.app):
                if call.path == f"{V1}/abort":  # an abort is never refused
                    continue
                answer = await http.request(
                    call.method, call.path, params={"colour": 1}, json=call.body
                )
                assert answer.status_code == 422, call
                assert "unknown query parameter 'colour'; " in answer.json()["error"]

    asyncio.run(ask())
    service.app.api.context.close()


def test_an_abort_is_accepted_with_any_query_parameter(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())

    async def ask(http: httpx.AsyncClient) -> None:
        answer = await http.post(f"{V1}/abort", params={"colour": 1})
        assert (answer.status_code, answer.json()["event"]) == (200, "Aborted")

    asked(world, ask)


def test_images_are_images(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        frame = await got(http, "/fire/arrival.json")
        assert len(frame["corners"]) == 4
        assert frame["scale"]
        answer = await http.get(f"{V1}/fire/arrival.png")
        with Image.open(io.BytesIO(answer.content)) as state_view:
            assert state_view.size == (frame["width_px"], frame["height_px"])
        terrain = await got(http, "/terrain.json")
        west, south, east, north = terrain["bounds"]
        zoom = terrain["maxzoom"]
        lat, lon = np.radians((south + north) / 2), (west + east) / 2
        x = int((lon + 180.0) / 360.0 * 2**zoom)
        y = int((1.0 - np.arcsinh(np.tan(lat)) / np.pi) / 2.0 * 2**zoom)
        tile = await http.get(f"{V1}/terrain/{zoom}/{x}/{y}.png")
        with Image.open(io.BytesIO(tile.content)) as state_view:
            assert state_view.size == (256, 256)
        for nowhere in ("0/5/5", "99/0/0", "-1/0/0", f"{zoom}/0/0"):
            await refused(http, 404, "GET", f"/terrain/{nowhere}.png")

    asked(flying, ask)


def test_operator_requests_become_events(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(3610.0)
    point = {"state": "burning", "shape": "point", "points": [list(CENTRE)]}

    async def ask(http: httpx.AsyncClient) -> None:
        await posted(http, "/vehicles/hawk/hold", by="Anna")
        assert world.submitted[-1] == OrderGiven(
            world.simulation.clock.now_us, "Anna", "http", "hawk", "hold"
        )
        await posted(http, "/vehicles/all/resume")
        assert isinstance(world.submitted[-1], OrderGiven)
        assert world.submitted[-1].vehicle == ""
        await posted(http, "/wind", speed_m_s=3.0, from_deg=90.0)
        assert isinstance(world.submitted[-1], WindSet)
        assert (await got(http, "/weather"))["wind_set"]["from_deg"] == 90.0
        corrected = await posted(http, "/fire/corrections", **point)
        assert corrected["event"] == "Corrected"
        assert isinstance(world.submitted[-1], Corrected)
        assert len(await got(http, "/fire/corrections")) == 1
        await posted(http, "/fire/undo")
        assert await got(http, "/fire/corrections") == []
        answer = await http.patch(f"{V1}/planner", json={"alpha": 1.5})
        assert answer.status_code == 200
        assert isinstance(world.submitted[-1], SettingsChanged)
        assert (await got(http, "/planner"))["alpha"] == 1.5
        count_before = len(world.submitted)
        for path, body, why in (
            ("/vehicles/hawk/hold", {"vehicle": "kite"}, "unknown key 'vehicle'"),
            ("/vehicles/hawk/hold", {"do": "abort"}, "unknown key 'do'"),
            ("/vehicles/hawk/hold", {"colour": 1}, "colour"),
            ("/wind", {"speed_m_s": -1, "from_deg": 0}, "wind"),
            ("/wind", {"speed_m_s": 1, "from_deg": 0, "by": "\x07"}, "by"),
            ("/fire/corrections", {**point, "points": [[0, 0]]}, "outside the landscape"),
        ):
            assert why in await refused(http, 422, "POST", path, **body)
        assert "only in a burn" in await refused(http, 409, "POST", "/burn/plan", by="Anna")
        assert len(world.submitted) == count_before

    asked(world, ask)


def test_a_correction_is_answered_with_the_area_before_and_after(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(3700.0)

    def area() -> float:
        return float(world.context.estimate.fire.burned_ha)

    async def ask(http: httpx.AsyncClient) -> None:
        before = area()
        drawn = {"state": "burned", "shape": "polygon", "points": SQUARE}
        areas: list[dict[str, float]] = []
        for path, body in (
            ("/fire/corrections", drawn),
            ("/fire/erase", {"lat_deg": SQUARE[0][0], "lon_deg": SQUARE[0][1], "radius_m": 9.0}),
            ("/fire/undo", {}),
            ("/fire/undo", {}),
            ("/fire/redo", {}),
        ):
            answer = await http.post(f"{V1}{path}", json=body)
            assert answer.status_code == 200, answer.text
            areas.append(answer.json())
            assert areas[-1]["burned_ha_before"] == pytest.approx(before)
            assert areas[-1]["burned_ha_after"] == pytest.approx(area())
            before = area()
        assert areas[0]["burned_ha_after"] > areas[0]["burned_ha_before"]
        assert areas[3]["burned_ha_after"] == areas[0]["burned_ha_before"]
        wind = await http.post(f"{V1}/wind", json={"speed_m_s": 3.0, "from_deg": 200.0})
        assert "burned_ha_before" not in wind.json()

    asked(world, ask)


def test_a_preview_gives_the_areas_of_the_correction_and_changes_nothing(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(3700.0)
    drawn: dict[str, Any] = {"state": "unburned", "shape": "point", "points": [CENTRE]}
    feature = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [[p[::-1] for p in [*SQUARE, SQUARE[0]]]]},
    }

    async def ask(http: httpx.AsyncClient) -> None:
        preview = await posted(http, "/fire/preview", do="correct", **drawn)
        file = (await http.post(f"{V1}/fire/perimeter?preview=true", json=feature)).json()
        assert not world.submitted
        assert world.context.estimate.corrections() == []
        applied = await posted(http, "/fire/corrections", **drawn)
        areas = {key: applied[key] for key in ("burned_ha_before", "burned_ha_after")}
        assert {key: preview[key] for key in areas} == areas
        assert areas["burned_ha_after"] < areas["burned_ha_before"] == file["burned_ha_before"]
        assert file["burned_ha_after"] > file["burned_ha_before"]
        front = shapely.geometry.shape((await got(http, "/fire/front"))["geometry"])
        shown = shapely.geometry.shape(preview["front"]["geometry"])
        assert shown.intersection(front).area > 0.8 * shown.union(front).area
        undo = await posted(http, "/fire/preview", do="undo")
        assert undo["burned_ha_after"] == areas["burned_ha_before"]
        for body, why in (
            ({"do": "redo"}, "nothing to redo"),
            ({"do": "wind", "speed_m_s": 1.0, "from_deg": 0.0}, '"do" must be one of'),
            ({}, '"do" must be one of correct, erase, undo, redo'),
            ({"do": "takeoff"}, '"do" must be one of correct, erase, undo, redo'),
            ({**drawn, "do": "correct", "points": []}, "points"),
        ):
            assert why in await refused(http, 422, "POST", "/fire/preview", **body)
        twice = await http.post(f"{V1}/fire/perimeter?preview=true&preview=false", json=feature)
        assert (twice.status_code, twice.json()["error"]) == (
            422,
            "query parameter 'preview' appears more than once; specify it once",
        )
        assert len(world.submitted) == 1

    asked(world, ask)


def test_a_perimeter_that_others_drew_corrects_the_fire(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    ring = [[lon, lat] for lat, lon in [*SQUARE, SQUARE[0]]]
    drawn = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {"poly_IncidentName": "Test"},
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            }
        ],
    }

    async def ask(http: httpx.AsyncClient) -> None:
        answer = await http.post(f"{V1}/fire/perimeter", json=drawn)
        assert answer.status_code == 200, answer.text
        assert len(answer.json()["accepted"]) == 1
        correction = world.submitted[-1]
        assert isinstance(correction, Corrected)
        assert (correction.state, correction.shape) == ("burning", "polygon")
        assert shapely.Polygon(correction.points).symmetric_difference(
            shapely.Polygon(SQUARE)
        ).area == pytest.approx(0.0, abs=1e-9)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("readme.txt", "no perimeter")
        for wrong in (b"", b"\x00" * 100, packed.getvalue(), b'{"type": "Point"}'):
            bad = await http.post(f"{V1}/fire/perimeter", content=wrong)
            assert bad.status_code == 422, wrong
        assert len(world.submitted) == 1

    asked(world, ask)


def test_the_journal_can_be_read_in_pieces(flying: World) -> None:
    path = flying.context.journal_path

    async def ask(http: httpx.AsyncClient) -> None:
        written = path.read_bytes().splitlines(keepends=True)
        found, after = [], 0
        for _ in range(1000):
            answer = await http.get(f"{V1}/journal", params={"after": after, "limit": 700})
            if not answer.content:
                break
            found += answer.content.splitlines(keepends=True)
            after = int(answer.headers["x-last-line"])
        assert found == written
        assert after == len(written)
        whole = await http.get(f"{V1}/journal/file")
        assert whole.content == b"".join(written)
        assert SegmentReader(path).header["scenario"]["name"] == "demo"

    asked(flying, ask)


def test_the_products_are_a_zip_of_the_files_of_the_command(flying: World) -> None:
    zero: dict[str, str | float] = {"time_zero": "2026-08-01T14:00-04:00", "forecast_h": 0.5}

    async def ask(http: httpx.AsyncClient) -> None:
        undated = await http.get(f"{V1}/products.zip")
        assert undated.status_code == 422
        assert "time_zero" in undated.json()["error"]
        for wrong in ("time_zero=2026-08-01T14:00", "time_zero=2026-08-01T18:00Z&forecast_h=7"):
            assert (await http.get(f"{V1}/products.zip?{wrong}")).status_code == 422
        made, refused = await asyncio.gather(
            http.get(f"{V1}/products.zip", params=zero),
            http.get(f"{V1}/products.zip", params=zero),
        )
        assert (made.status_code, refused.status_code) == (200, 503)
        with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
            assert archive.testzip() is None
            assert {"map-letter.pdf", "incident.kmz", "incident.gpkg"} <= set(archive.namelist())
            log = archive.read("interpreter-log.txt").decode()
        assert "2026-08-01 15:01" in log

    asked(flying, ask)


def test_products_of_a_damaged_journal_are_refused_with_the_line(
    standing: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = standing.context.journal_path.with_name("damaged.jsonl")
    whole = standing.context.journal_path.read_bytes()
    damaged.write_bytes(whole + b'{"event":{"type":"Unknown"},"crc":"00000000"}\n')
    monkeypatch.setattr(standing.context, "journal_path", damaged)

    async def ask(http: httpx.AsyncClient) -> None:
        found = await http.get(f"{V1}/products.zip?time_zero=2026-08-01T18:00Z&forecast_h=0")
        assert found.status_code == 422
        assert "damaged.jsonl" in found.json()["error"]

    asked(standing, ask)


def test_lines_are_found_in_a_journal_that_grows_and_is_replaced(tmp_path: Path) -> None:
    path, lines = tmp_path / "journal.jsonl", JournalLines()

    def after(
        line: int, limit: int = 9, max_bytes: int = 1000, segment: int = 1
    ) -> tuple[bytes, int]:
        with path.open("rb") as file:
            return lines.after(file, segment, line, limit, max_bytes)

    path.write_bytes(b"".join(b"%d\n" % number for number in range(1, 2501)))
    assert after(2000, 2) == (b"2001\n2002\n", 2002)
    assert after(0, 1) == (b"1\n", 1)
    with path.open("ab") as file:
        file.write(b"2501\n25")  # the last line is not complete yet
    assert after(2499) == (b"2500\n2501\n", 2501)
    assert after(2501) == (b"", 2501)
    assert after(99_999) == (b"", 99_999)
    assert after(0, 100, 10)[0] == b"1\n2\n3\n4\n5\n6\n"
    path.rename(tmp_path / "journal-000001.jsonl")
    path.write_bytes(b"one\ntwo\n")
    assert after(1) == (b"two\n", 2)
    path.write_bytes(b"a\n")  # the file is shorter than the requested position
    assert after(0) == (b"a\n", 1)
    assert after(1001) == (b"", 1001)
    path.write_bytes(b"1\n" * 2000)
    assert after(1998) == (b"1\n1\n", 2000)
    path.write_bytes(b"longer %04d\n" * 2000)  # another segment with the inode of a deleted one
    assert after(1998, segment=5) == (b"longer %04d\n" * 2, 2000)


def test_older_pieces_of_the_journal_can_be_read(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(3601.0)

    async def ask(http: httpx.AsyncClient) -> None:
        whole = (await http.get(f"{V1}/journal/file")).content
        world.context.service.recording.journal.begin_segment()
        new = await http.get(f"{V1}/journal")
        assert new.headers["x-segment"] == "2"
        assert new.headers["x-last-line"] == "1"
        old = await http.get(f"{V1}/journal", params={"segment": 1, "limit": 5000})
        assert old.headers["x-segment"] == "1"
        assert old.content == whole
        assert (await http.get(f"{V1}/journal/file?segment=1")).content == whole
        assert "segment 3" in await refused(http, 404, "GET", "/journal?segment=3")

    asked(world, ask)


def test_what_cannot_be_written_down_is_not_done_but_an_abort_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = world_in(tmp_path, scenario_of())

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Journal, "_put", full)

    async def ask(http: httpx.AsyncClient) -> None:
        hold = await refused(http, 507, "POST", "/vehicles/hawk/hold")
        assert "disk full" in hold
        assert world.context.state_view.vehicles["hawk"].order == ""
        await posted(http, "/abort")
        assert "abort" in world.context.state_view.alarms

    asked(world, ask)


def test_announcements_are_sent_once(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        flying.context.state_view.announce("hawk", "something")
        announcements = await got(http, "/announcements")
        assert announcements[-1]["text"] == "something"
        assert [line["id"] for line in announcements] == sorted(
            {line["id"] for line in announcements}
        )
        assert (
            await got(http, "/announcements", after=announcements[-2]["id"]) == announcements[-1:]
        )

    asked(flying, ask)


def test_it_is_ready_when_nothing_is_missing(flying: World) -> None:
    async def ask(http: httpx.AsyncClient) -> None:
        assert (await http.get("/readyz")).json()["ok"] is True
        flying.context.not_ready["hawk"] = "no heartbeat yet"
        lacks = await http.get("/readyz")
        assert (lacks.status_code, lacks.json()) == (503, {"error": "hawk: no heartbeat yet"})
        assert (await http.get("/healthz")).status_code == 200
        flying.context.not_ready.clear()
        flying.context.stopping = True
        assert (await http.get("/readyz")).status_code == 503
        flying.context.stopping = False
        figures = await http.get("/metrics")
        assert figures.status_code == 200
        assert b"# HELP" in figures.content

    asked(flying, ask)


def test_an_internal_error_is_reported_without_details(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flying.context, "fire", lambda: 1 / 0)

    async def ask(http: httpx.AsyncClient) -> None:
        text = await refused(http, 500, "GET", "/state")
        assert "zero" not in text

    asked(flying, ask)


def test_a_burn_is_planned_and_approved_by_authorised_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(AccessGuard, "_check_rate", lambda *_: None)
    world = world_in(tmp_path, scenario_of("burn", ()))
    stations = [station.name for station in world.context.scenario.burn.stations]  # type: ignore[union-attr]
    items = world.context.scenario.burn.go_items  # type: ignore[union-attr]

    async def ask(http: httpx.AsyncClient) -> None:
        burn = await got(http, "/burn")
        assert [station["name"] for station in burn["stations"]] == stations
        for item in items:
            await posted(http, "/burn/go", item=item, station=stations[0], by="Anna")
        assert (await got(http, "/burn"))["open_items"] == []
        assert "no item" in await refused(
            http, 422, "POST", "/burn/go", item="lunch", station=stations[0]
        )
        assert "unknown station" in await refused(
            http, 422, "POST", "/burn/go", item=items[0], station="pub"
        )
        await posted(http, "/burn/no-go", item=items[0], station=stations[0])
        assert (await got(http, "/burn"))["open_items"] == [items[0]]
        assert "not available in a burn" in await refused(
            http, 409, "PATCH", "/planner", alpha=1.0, station=stations[0]
        )
        await posted(http, "/abort")

    asked(world, ask)


def test_every_route_is_in_the_documentation_with_its_role(flying: World) -> None:
    text = (Path(__file__).parents[2] / "docs" / "api.md").read_text(encoding="utf-8")
    written = set(re.findall(r"^\| `([A-Z]+ /\S*)` \| (\w+) \|", text, re.MULTILINE))
    assert written == {
        (f"{method} {each.path.removeprefix(V1)}", role_of(each))
        for each in routes_of(served(flying).app.routes)
        for method in each.methods or ()
    }


def test_the_log_names_the_author_of_each_change(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(3700.0)
    point = {"state": "burned", "shape": "point", "points": [list(SQUARE[0])], "in_s": -600.0}

    async def ask(http: httpx.AsyncClient) -> None:
        before = (await got(http, "/state"))["version"]
        await posted(http, "/fire/corrections", **point, by="Ann")
        await posted(http, "/fire/undo", by="Bob")
        await posted(http, "/wind", speed_m_s=3.0, from_deg=90.0, by="Ann")
        await http.patch(f"{V1}/planner", json={"alpha": 1.5, "by": "Cem"})
        note = {"text": "gate locked", "lat_deg": SQUARE[0][0], "lon_deg": SQUARE[0][1]}
        await posted(http, "/notes", **note, by="Eve")
        lines = await got(http, f"/records?after={before}")
        found = [
            (each["kind"], each["text"])
            for each in lines
            if each["kind"] in ("fire", "settings", "note")
        ]
        assert (lines[-1]["note"], lines[-1]["lat_deg"], lines[-1]["lon_deg"]) == (
            *("gate locked", *SQUARE[0]),
        )
        off = await http.post(f"{V1}/notes", json={**note, "lat_deg": 10.0, "by": "Eve"})
        assert (off.status_code, "is outside the landscape" in off.text) == (422, True)
        assert found == [
            ("fire", "Ann draws a burned point, valid 10 min earlier"),
            ("fire", "Bob undoes the last correction"),
            ("fire", "Ann sets the wind: 3.0 m/s from 90°"),
            ("settings", "Cem changes settings: alpha = 1.5"),
            ("note", f"Eve notes at {SQUARE[0][0]:.5f}, {SQUARE[0][1]:.5f}: gate locked"),
        ]
        missions = [each for each in await got(http, "/records") if each["kind"] == "mission"]
        assert missions
        assert {each["vehicle"] for each in missions} == {"hawk", "kite"}
        assert " on board: " in missions[0]["text"]

    asked(world, ask)
