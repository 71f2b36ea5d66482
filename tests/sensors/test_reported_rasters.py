"""Rasters of detectors: their place on the landscape, their errors, and unusable ones."""

import asyncio
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx
import msgspec
import numpy as np
import pytest
import rasterio
from affine import Affine

from firemodel.assimilation.observation import BURNED, UNBURNED
from firemodel.errors import FireModelError
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.core.request_events import event_of
from mission_service.errors import RequestError
from mission_service.events import FireObserved, RasterObserved
from mission_service.fire.observed_window import LETTERS, in_letters
from mission_service.fire.raster_cells import raster_cells
from mission_service.fire.run_estimate import MAX_REPORTS, RunEstimate, UnusedReportError
from mission_service.fire.scenario_fire import landscape_of
from mission_service.interfaces.maps.raster_import import read_raster
from mission_service.requests import Raster
from tests.api.worlds import SMALL, World, client, scenario_of, served, world_in

SCENARIO = load_scenario("default", ("planner.rule=circling",))
EMPTY = SCENARIO.model_copy(update={"simulation": type(SCENARIO.simulation)(), "ignition": ()})
EDGES = ("south_deg", "west_deg", "north_deg", "east_deg")
PATH = "/api/v1/fire/observations"


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(SCENARIO)


def edges(land: Landscape, top: int, left: int, rows: int, cols: int) -> dict[str, float]:
    """Return the edges of the largest raster in a window of cells; it is smaller by one cell."""
    corners = [
        land.lat_lon_of(*land.xy_of(row, col))
        for row in (top - 0.5, top + rows - 0.5)
        for col in (left - 0.5, left + cols - 0.5)
    ]
    lats, lons = (sorted(float(each[axis]) for each in corners) for axis in (0, 1))
    return {
        "south_deg": lats[1],
        "west_deg": lons[1],
        "north_deg": lats[2],
        "east_deg": lons[2],
    }


def raster(
    land: Landscape,
    rows: Sequence[str],
    at_s: float = 600.0,
    seen_s: float | None = None,
    place: tuple[int, int, int, int] = (40, 60, 40, 40),
    **keys: Any,
) -> RasterObserved:
    """Return a report of a raster in a window (top, left, rows, cols) of the landscape's grid."""
    request = {"do": "raster", "by": "gus", "station": "", **edges(land, *place), "rows": rows}
    request |= {"station": "tower", "age_s": at_s - (at_s if seen_s is None else seen_s), **keys}
    event = event_of(request, round(at_s * 1e6))
    assert isinstance(event, RasterObserved)
    return event


def block(burned: slice, side: int = 40) -> list[str]:
    """Return unburned rows with a burned square."""
    states = np.full((side, side), UNBURNED, dtype=np.uint8)
    states[burned, burned] = BURNED
    return list(in_letters(LETTERS[states]))


def burned_after(estimate: RunEstimate, at_s: float) -> np.ndarray:
    estimate.advance(round(at_s * 1e6))
    return estimate.fire.burned().copy()


def test_each_cell_of_the_grid_has_the_state_of_the_raster_at_its_centre(land: Landscape) -> None:
    rng = np.random.default_rng(5)
    states = rng.integers(0, 3, (37, 53)).astype(np.uint8)
    event = raster(land, in_letters(LETTERS[states]), place=(11, 23, 150, 120))
    top, left, found = raster_cells(event, land)
    row, col = np.indices(found.shape)
    lat, lon = land.lat_lon_of(*land.xy_of(row + top, col + left))
    down = (event.north_deg - lat) / (event.north_deg - event.south_deg) * 37
    right = (lon - event.west_deg) / (event.east_deg - event.west_deg) * 53
    inside = (down >= 0) & (down < 37) & (right >= 0) & (right < 53)
    expected = np.zeros(found.shape, dtype=np.uint8)
    expected[inside] = states[down[inside].astype(int), right[inside].astype(int)]
    assert np.count_nonzero(inside) > 15_000
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("lon_deg", [178.5, 180.0])
def test_rasters_on_both_sides_of_the_antimeridian(lon_deg: float) -> None:
    land = flat_landscape(60, 60, 30.0, -16.8, lon_deg)
    places = land.lat_lon_of(*land.xy_of(np.array([40.0, 20.0]), np.array([5.0, 55.0])))
    (south, north), (west, east) = (np.asarray(each).tolist() for each in places)
    sides = [(west, east)] if west < east else [(west, 180.0), (-180.0, east)]
    for left_deg, right_deg in sides:
        edges_deg = dict(zip(EDGES, (south, left_deg, north, right_deg), strict=True))
        request = {"do": "raster", "by": "gus", "station": "tower", **edges_deg, "rows": ["b"]}
        event = event_of({**request, "age_s": 0.0}, 600_000_000)
        assert isinstance(event, RasterObserved)
        _, left, states = raster_cells(event, land)
        _, cols = np.nonzero(states == BURNED)
        col_of = [
            land.row_col_of(*land.xy_of_lat_lon(south, lon))[1] for lon in (left_deg, right_deg)
        ]
        assert cols.min() + left == pytest.approx(float(col_of[0]), abs=1.5)
        assert cols.max() + left == pytest.approx(float(col_of[1]), abs=1.5)


def test_a_raster_that_covers_the_landscape_and_more_shows_all_of_it(land: Landscape) -> None:
    rows, cols = land.shape
    event = raster(land, ["b"], place=(-100, -100, rows + 200, cols + 200))
    top, left, found = raster_cells(event, land)
    assert (top, left, found.shape) == (0, 0, land.shape)
    assert (found == BURNED).all()


def test_the_first_raster_begins_the_fire_and_a_late_one_takes_its_place_in_time(
    land: Landscape,
) -> None:
    in_time, late = (RunEstimate(EMPTY, land) for _ in range(2))
    rows = block(slice(15, 25))
    in_time.apply_report(raster(land, rows))
    late.apply_report(raster(land, rows, at_s=1500.0, seen_s=600.0))
    for estimate in (in_time, late):
        assert np.count_nonzero(burned_after(estimate, 1500.0)) > 100
    differ = in_time.fire.burned() ^ late.fire.burned()
    assert np.count_nonzero(differ) < 0.05 * np.count_nonzero(in_time.fire.burned())


def test_a_false_cell_needs_a_second_raster_and_an_unburned_one_between_cancels_it(
    land: Landscape,
) -> None:
    keys: dict[str, Any] = {"false_alarms_pct": 10.0, "position_sd_m": 5.0}
    nothing, false = block(slice(0, 0)), block(slice(20, 24))
    estimate = RunEstimate(EMPTY, land)
    for number, rows in enumerate((false, nothing, false, nothing, false)):
        estimate.apply_report(raster(land, rows, at_s=600.0 + 20.0 * number, **keys))
        assert not burned_after(estimate, 605.0 + 20.0 * number).any()
    estimate.apply_report(raster(land, false, at_s=720.0, **keys))
    assert burned_after(estimate, 725.0).any()


def test_a_front_within_the_error_of_the_raster_stays_and_a_false_fire_goes(
    land: Landscape,
) -> None:
    estimate = RunEstimate(EMPTY, land)
    estimate.apply_report(raster(land, block(slice(10, 26)), position_sd_m=1.0))
    spot = raster(land, ["b"], at_s=601.0, place=(74, 94, 2, 2), position_sd_m=1.0)
    estimate.apply_report(spot)
    before = burned_after(estimate, 602.0)
    assert before[70:80, 90:100].any()
    # 60 m further in the south-east, with an error of 45 m; the raster does not show the spot.
    estimate.apply_report(raster(land, block(slice(12, 28)), at_s=602.0, position_sd_m=45.0))
    after = burned_after(estimate, 602.0)
    assert not after[70:80, 90:100].any()
    assert np.array_equal(after[40:69, 60:89], before[40:69, 60:89])


def test_of_three_detectors_the_one_that_contradicts_both_others_is_not_used(
    land: Landscape,
) -> None:
    estimate = RunEstimate(EMPTY, land)
    true, false = block(slice(10, 26)), block(slice(0, 0))
    unused = []
    for number in range(12):
        for each, rows in (("a", true), ("b", true), ("liar", false)):
            at_s = 600.0 + 30.0 * number + 10.0 * "ab".find(each[0])
            try:
                estimate.apply_report(raster(land, rows, at_s=at_s, source=each))
            except UnusedReportError as error:
                unused.append((each, str(error)))
    assert estimate.agreement.distrusted == {"liar of gus"}
    assert any(each == "liar" and "of liar of gus are not used" in text for each, text in unused)
    assert not [each for each, text in unused if each != "liar" and "are not used" in text]
    assert burned_after(estimate, 1000.0)[52:64, 72:84].all()


def test_a_few_contradicted_cells_do_not_refuse_a_large_raster(land: Landscape) -> None:
    estimate = RunEstimate(EMPTY, land)
    spot: dict[str, Any] = {"place": (55, 75, 2, 2), "position_sd_m": 1.0}
    estimate.apply_report(raster(land, ["b"], **spot))
    unburned = raster(land, ["u"], at_s=610.0, **spot)
    with pytest.raises(UnusedReportError, match="contradict it in 4 of 4 cells"):
        estimate.apply_report(unburned)
    estimate.apply_report(raster(land, block(slice(30, 35)), at_s=620.0, position_sd_m=1.0))
    burned = burned_after(estimate, 620.0)
    assert burned[71:74, 91:94].all()
    assert not burned[50:60, 70:80].any()


@pytest.mark.parametrize("stations", [("tower", "north", "south"), ("cot:1", "cot:2", "cot:3")])
def test_one_sender_with_several_names_in_tak_is_no_majority(
    land: Landscape, stations: tuple[str, ...]
) -> None:
    estimate = RunEstimate(EMPTY, land)
    true, false = block(slice(10, 26)), block(slice(24, 40))
    for number in range(12):
        at_s = 600.0 + 30.0 * number
        events = [raster(land, true, at_s=at_s, source="camera")]
        for station in stations:
            sent = raster(land, false, at_s=at_s + 10.0, source="")
            events.append(msgspec.structs.replace(sent, station=station))
        for event in events:
            with contextlib.suppress(UnusedReportError):
                estimate.apply_report(event)
    is_tak = stations[0].startswith("cot:")
    assert estimate.agreement.distrusted == (set() if is_tak else {"camera of gus"})
    assert ("TAK" in str(estimate.agreement.contradictions())) == is_tak


def test_a_late_report_of_unburned_ground_contradicts_no_later_fire(land: Landscape) -> None:
    estimate = RunEstimate(EMPTY, land)
    for at_s in range(600, 900, 30):
        estimate.apply_report(raster(land, block(slice(10, 26)), at_s=at_s, source="a"))
        late = raster(land, block(slice(0, 0)), at_s=at_s + 1.0, seen_s=100.0, source="b")
        estimate.apply_report(late)
    assert not estimate.agreement.contradictions()


def test_sources_are_bounded(land: Landscape) -> None:
    estimate = RunEstimate(EMPTY, land)
    place = ((36.3642, -84.1409),)
    for number in range(60):
        seen = FireObserved(
            *(number * 1_000_000, "gus", "", "burning", "points", place),
            *(number * 1_000_000, 10.0, 0.0, f"sensor {number}"),
        )
        estimate.apply_report(seen)
    assert len(estimate.agreement._seen) <= 8
    assert "sensor 59 of gus" in estimate.agreement._seen


def test_observations_that_wait_for_the_estimate_are_bounded(land: Landscape) -> None:
    estimate = RunEstimate(EMPTY, land)
    estimate.in_background = True
    event = raster(land, ["bb", "uu"])
    for _ in range(MAX_REPORTS):
        estimate.check(event)
        estimate.apply_report(event)
    with pytest.raises(FireModelError, match="64 observations are waiting for the estimate"):
        estimate.check(event)


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"rows": ["ub", "u"]}, "row 2 has 1 letters and row 1 has 2"),
        (
            {"rows": ["uB"]},
            "must be a string of the letters b (burned), u (unburned) and . (not seen)",
        ),
        ({"rows": ["u\n"]}, "must be a string of the letters"),
        ({"rows": ["..", ".."]}, "no cell was seen"),
        ({"rows": []}, "rows"),
        ({"rows": ["u"] * 257}, "rows"),
        ({"rows": ["u" * 257]}, "rows"),
        ({"rows": "ub"}, "rows"),
        ({"north_deg": 36.0}, "north_deg must exceed south_deg"),
        ({"east_deg": float("nan")}, "east_deg"),
        ({"west_deg": "x"}, "west_deg"),
        ({"age_s": -3600.0}, "age_s"),
        ({"age_s": 7 * 3600.0}, "age_s: must be a number from 0 to 21600"),
        ({"missed_pct": 100}, "missed_pct"),
        ({"speed": 1}, "unknown key"),
    ],
)
def test_unusable_rasters_are_refused_in_one_line(keys: dict[str, Any], reason: str) -> None:
    request = {"do": "raster", "by": "gus", "station": "tower", **Raster.example, **keys}
    with pytest.raises(RequestError) as found:
        event_of(request, 0)
    assert reason in str(found.value)
    assert "\n" not in str(found.value)
    assert len(str(found.value)) < 250


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"west_deg": -54.15, "east_deg": -54.13}, "contains no cell of the landscape"),
        ({"rows": ["u" * 5], "missed_pct": 1.0}, "a cell needs five observed neighbours"),
    ],
)
def test_rasters_that_the_estimate_cannot_use_are_refused(
    land: Landscape, keys: dict[str, Any], reason: str
) -> None:
    request = {"do": "raster", "by": "gus", "station": "tower", **Raster.example, **keys}
    event = event_of(request, 30_000_000_000)
    with pytest.raises(FireModelError, match=reason):
        RunEstimate(SCENARIO, land).check(event)


NOTES: tuple[tuple[dict[str, Any], str], ...] = (
    ({"rows": ["b" * 20] * 20, "false_alarms_pct": 2.0}, "need a second report: 3"),
    (
        {"rows": ["u" * 9 + "b" + "u" * 10] + ["u" * 20] * 9, "missed_pct": 1.0},
        "majority filter",
    ),
    ({"rows": ["u" * 20] * 8 + ["u" * 6 + "b" * 8 + "u" * 6] * 8 + ["u" * 20] * 4}, ""),
    ({"rows": ["." * 20] * 9 + ["." * 7 + "b" * 6 + "." * 7] * 6 + ["." * 20] * 5}, "agrees with"),
)


def test_the_reply_states_why_a_report_changes_nothing(tmp_path: Path) -> None:
    world = world_in(tmp_path, SCENARIO)
    place = edges(world.context.landscape, 20, 30, 20, 20)

    async def replied() -> list[dict[str, Any]]:
        working = asyncio.create_task(world.worker.fold_inputs())
        await asyncio.sleep(0)
        ask = world.context.request_handler.ask_and_wait
        request = {"do": "raster", "by": "gus", "station": "tower", **place}
        found = [await ask({**request, **keys}) for keys, _ in NOTES]
        working.cancel()
        return found

    for reply, (_, note) in zip(asyncio.run(replied()), NOTES, strict=True):
        assert reply["ok"]
        assert len(reply["messages"]) == (1 if note else 0)
        assert note in " ".join(reply["messages"])


# GeoTIFFs -------------------------------------------------------------------------------------


def tiff(
    pixels: np.ndarray, crs: str | None, west: float, north: float, size: float, **keys: Any
) -> bytes:
    """Return a GeoTIFF with one band."""
    with rasterio.io.MemoryFile() as memory:
        with memory.open(
            driver="GTiff",
            height=pixels.shape[0],
            width=pixels.shape[1],
            count=1,
            dtype=pixels.dtype,
            crs=crs,
            transform=Affine(size, 0.0, west, 0.0, -size, north),
            **keys,
        ) as file:
            file.write(pixels, 1)
        return bytes(memory.read())


BOUNDS = (-84.21, 36.31, -84.07, 36.42)  # west, south, east, north


def wgs84(pixels: np.ndarray, **keys: Any) -> bytes:
    return tiff(pixels, "EPSG:4326", -84.15, 36.37, 0.0003, **keys)


def test_a_geotiff_in_latitude_and_longitude_keeps_its_pixels() -> None:
    pixels = np.random.default_rng(1).choice([0, 1, 255], size=(30, 50)).astype(np.uint8)
    found = read_raster(wgs84(pixels), "mask.tif", BOUNDS)
    letters = np.array([list(row) for row in found["rows"]])
    expected = np.where(pixels == 255, ".", np.where(pixels == 1, "b", "u"))
    assert np.array_equal(letters, expected)
    assert found["north_deg"] == pytest.approx(36.37)
    assert found["east_deg"] == pytest.approx(-84.15 + 50 * 0.0003)


def test_a_geotiff_without_fire_may_declare_255_as_unseen() -> None:
    pixels = np.array([[0, 0, 255]], dtype=np.uint8)
    assert read_raster(wgs84(pixels, nodata=255), "mask.tif", BOUNDS)["rows"] == ("uu.",)


def test_a_projected_geotiff_has_its_fire_at_the_right_place(land: Landscape) -> None:
    """A square burned from 600 to 900 m east and 300 to 450 m south of the corner."""
    west, north = (float(each) for each in land.xy_of(49.5, 59.5))
    pixels = np.zeros((300, 400), dtype=np.uint8)
    pixels[60:90, 120:180] = 1
    found = read_raster(tiff(pixels, land.crs, west, north, 5.0), "mask.tif", BOUNDS)
    event = event_of({**found, "by": "gus", "station": "tower"}, 0)
    assert isinstance(event, RasterObserved)
    top, left, states = raster_cells(event, land)
    rows, cols = np.nonzero(states == BURNED)
    assert (rows.min() + top, rows.max() + top) == (60, 64)
    assert (cols.min() + left, cols.max() + left) == (80, 89)
    assert rows.size == 5 * 10


def test_a_fine_geotiff_has_the_most_frequent_states() -> None:
    pixels = np.zeros((1200, 1200), dtype=np.float32)
    pixels[::2] = np.nan
    pixels[:600] = 1.0
    data = tiff(pixels, "EPSG:4326", -84.15, 36.37, 0.00001, nodata=np.nan)
    found = read_raster(data, "mask.tif", BOUNDS)
    assert len(found["rows"]) == 256
    assert set("".join(found["rows"][:127])) == {"b"}
    assert set("".join(found["rows"][130:])) == {"u"}


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"not a tiff", "is not a GeoTIFF; send a GeoTIFF with one band as the body"),
        (b"", "is empty"),
        (wgs84(np.full((3, 3), 255, np.uint8)), "9 pixels of 255 (not seen) and none of 1"),
        (b"II*\x00" + b"\x00" * 100, "cannot be read as a GeoTIFF"),
        (wgs84(np.full((3, 3), 7, dtype=np.uint8)), "has the value 7"),
        (wgs84(np.full((3, 3), np.nan, dtype=np.float32)), "has the value nan"),
        (tiff(np.zeros((3, 3), np.uint8), "EPSG:4326", -54.15, 36.37, 0.0003), "outside the land"),
        (tiff(np.zeros((3, 3), np.uint8), "EPSG:32616", -84.15, 36.37, 0.0003), "check its CRS"),
        (tiff(np.zeros((3, 3), np.uint8), None, -84.15, 36.37, 0.0003), "has no CRS"),
        (wgs84(np.zeros((1, 16_000_001), np.uint8), compress="deflate"), "at most 16 million"),
        (wgs84(np.zeros((2000, 3), np.uint8))[:2000], "cannot be read"),
    ],
)
def test_unusable_geotiffs_are_refused_in_one_line(data: bytes, reason: str) -> None:
    with pytest.raises(FireModelError) as found:
        read_raster(data, "mask.tif", BOUNDS)
    assert reason in str(found.value)
    assert "\n" not in str(found.value)


# Over HTTP ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    found = world_in(tmp_path_factory.mktemp("run"), scenario_of("demo", SMALL))
    found.fly(3601.0)
    return found


def posted(world: World, *calls: tuple[str, dict[str, Any]]) -> list[httpx.Response]:
    async def go() -> list[httpx.Response]:
        service = served(world, named=True)
        async with client(service.app, timeout=120.0) as http:
            found = [
                await http.post(path, headers=service.headers("observe"), **keys)
                for path, keys in calls
            ]
        service.app.api.context.close()
        return found

    return asyncio.run(go())


def test_a_detector_posts_rasters_and_the_journal_has_its_name_and_role(world: World) -> None:
    pixels = np.ones((5, 5), dtype=np.uint8)
    json_answer, tiff_answer, far, old = posted(
        world,
        (f"{PATH}/raster", {"json": Raster.example}),
        (f"{PATH}/geotiff?source=mast&age_s=30&position_sd_m=40", {"content": wgs84(pixels)}),
        (f"{PATH}/geotiff", {"content": tiff(pixels, "EPSG:4326", -54.1, 36.37, 0.0003)}),
        (f"{PATH}/geotiff?age_s=-5", {"content": wgs84(pixels)}),
    )
    assert json_answer.status_code == 200, json_answer.text
    assert tiff_answer.status_code == 200, tiff_answer.text
    assert {"burned_ha_before", "burned_ha_after"} <= tiff_answer.json().keys()
    first, second = world.submitted[-2:]
    assert isinstance(first, RasterObserved)
    assert isinstance(second, RasterObserved)
    assert (first.by, first.role, first.source) == ("observe", "observe", "tower")
    assert (second.source, second.position_sd_m, set(second.rows)) == ("mast", 40.0, {"bbbbb"})
    assert second.at_us - second.seen_at_us == 30_000_000
    assert far.status_code == old.status_code == 422
    assert "lon -54.0992, outside the landscape" in far.json()["error"]
    assert "age_s" in old.json()["error"]
