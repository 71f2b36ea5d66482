"""What each source of observations has contributed, and when it is late, silent or not used."""

from typing import Any

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.events import FireObserved, Observed, RasterObserved, Telemetry
from mission_service.fire.scenario_fire import landscape_of
from mission_service.interfaces.maps.footprints import footprints_geojson
from mission_service.journal.snapshot import Known, copied
from mission_service.runtime.observation_sources import (
    LATE_S,
    MAX_FOOTPRINT_CELLS,
    MAX_FOOTPRINTS,
    MAX_REPORTERS,
    SILENT_S,
    ObservationSources,
)
from mission_service.runtime.published_states import SourceState
from mission_service.runtime.state_view import SOURCES_EVERY_US, StateView

SCENARIO = load_scenario("demo")
CELLS = ("uub", ".bb")


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(SCENARIO)


@pytest.fixture
def sources(land: Landscape) -> ObservationSources:
    return ObservationSources(land, ("thermal_frames",), 0)


def image(at_s: float, **changes: Any) -> Observed:
    fields = {"at_us": round(at_s * 1e6), "vehicle": "hawk", "row": 10, "col": 20, "cells": CELLS}
    return Observed(**{**fields, **changes})


def report(at_s: float, points: list[tuple[float, float]], **changes: Any) -> FireObserved:
    at_us = round(at_s * 1e6)
    fields: dict[str, Any] = {
        "by": "anna",
        "station": "north",
        "source": "tower",
        "state": "burning",
        "shape": "points",
        **changes,
    }
    return FireObserved(
        at_us=at_us,
        points=tuple(points),
        seen_at_us=at_us,
        position_sd_m=20.0,
        false_alarms=0.0,
        **fields,
    )


def places(land: Landscape, *cells: tuple[float, float]) -> list[tuple[float, float]]:
    found = [land.lat_lon_of(*land.xy_of(row, col)) for row, col in cells]
    return [(float(lat), float(lon)) for lat, lon in found]


def state_of(
    sources: ObservationSources, name: str, now_s: float, **known: dict[str, str]
) -> SourceState:
    texts: dict[str, Any] = {"problems": {}, "contradictions": {}, "failed": (), **known}
    found = sources.states(round(now_s * 1e6), **texts)
    return next(each for each in found if each.source == name)


def test_images_are_counted_with_their_cells_errors_and_usual_interval(
    sources: ObservationSources,
) -> None:
    for at_s in (0, 2, 4, 30, 32):
        sources.apply(image(at_s, position_sd_m=7.0))
    sources.apply(image(34, source="thermal_frames", position_sd_m=3.0))
    sources.apply(image(35, estimated=True))
    sources.apply(image(35, corrects=True))
    hawk = state_of(sources, "hawk", 40.0)
    assert (hawk.kind, hawk.observations, hawk.not_used) == ("camera", 5, 0)
    assert (hawk.burned_cells, hawk.unburned_cells) == (15, 10)
    assert (hawk.last_at_us, hawk.age_s) == (32_000_000, 8.0)
    assert (hawk.usual_interval_s, hawk.position_sd_m) == (2.0, 7.0)
    frames = state_of(sources, "thermal_frames", 40.0)
    assert (frames.kind, frames.observations, frames.usual_interval_s) == ("sensor", 1, None)
    assert len(sources.contributions) == 2


def test_an_older_image_counts_but_is_not_the_latest(sources: ObservationSources) -> None:
    for at_s in (10, 20, 15, 20, 30):
        sources.apply(image(at_s))
    hawk = state_of(sources, "hawk", 30.0)
    assert (hawk.observations, hawk.last_at_us) == (5, 30_000_000)
    assert hawk.usual_interval_s == 10.0


@pytest.mark.parametrize(("every_s", "late_s", "silent_s"), [(2, LATE_S, SILENT_S), (60, 180, 600)])
def test_a_source_is_late_after_three_usual_intervals_and_silent_after_ten(
    sources: ObservationSources, every_s: int, late_s: float, silent_s: float
) -> None:
    for step in range(5):
        sources.apply(image(step * every_s))
    last_s = 4.0 * every_s

    def seen(age_s: float) -> tuple[str, str]:
        found = state_of(sources, "hawk", last_s + age_s)
        return found.state, found.problem

    assert seen(late_s) == ("live", "")
    state, problem = seen(late_s + 1)
    assert (state, f"more than {late_s:.0f} s; usually one every {every_s} s" in problem) == (
        "late", True,
    )  # fmt: skip
    assert seen(silent_s)[0] == "late"
    assert seen(silent_s + 1)[0] == "silent"
    sources.apply(image(last_s + silent_s + 2))
    assert state_of(sources, "hawk", last_s + silent_s + 2).state == "live"


def test_a_source_without_a_usual_interval_and_a_person_are_never_late(
    sources: ObservationSources, land: Landscape
) -> None:
    for at_s in (0, 60):
        sources.apply(report(at_s, places(land, (30, 30))))
    for at_s in range(0, 600, 60):
        sources.apply(report(at_s, places(land, (30, 30)), source=""))
    assert state_of(sources, "tower of anna", 1e5).state == "live"
    person = state_of(sources, "anna at north", 1e5)
    assert (person.kind, person.state) == ("person", "live")
    sources.apply(report(0, places(land, (30, 30)), by="tower", source="", role="observe"))
    detector = state_of(sources, "tower at north", 0.0)
    assert detector.kind == "detector", "its token permits nothing else"


def test_a_sensor_without_observations_waits_and_is_silent_after_some_minutes(
    sources: ObservationSources,
) -> None:
    begun = state_of(sources, "thermal_frames", SILENT_S)
    assert (begun.state, begun.last_at_us, begun.age_s) == ("waiting", None, None)
    assert state_of(sources, "thermal_frames", SILENT_S + 1).state == "silent"


def test_contradictions_problems_and_failures_are_stated_with_their_reason(
    sources: ObservationSources,
) -> None:
    sources.apply(image(0.0))
    assert state_of(sources, "hawk", 0.0).state == "live"
    found = state_of(sources, "hawk", 0.0, contradictions={"hawk": "against kite"})
    assert (found.state, found.problem) == ("contradicts", "against kite")
    sources.apply(image(1.0, distrusted=True))
    found = state_of(sources, "hawk", 1.0)
    assert (found.state, found.not_used) == ("contradicts", 1)
    assert "not used" in found.problem

    name, text = "thermal_frames", {"thermal_frames": "a.tif: damaged"}
    found = state_of(sources, name, 0.0, problems=text)
    assert (found.state, found.problem) == ("waiting", "a.tif: damaged")
    found = state_of(sources, name, 0.0, problems=text, failed=text)
    assert (found.state, found.problem) == ("failed", "a.tif: damaged")
    assert state_of(sources, name, 0.0, failed=text).state == "waiting", "after a restart"


def test_cells_of_reports_follow_from_their_length_and_area(
    sources: ObservationSources, land: Landscape
) -> None:
    square = places(land, (30, 30), (30, 40), (40, 40), (40, 30))
    sources.apply(report(0, square[:3]))
    assert state_of(sources, "tower of anna", 0).burned_cells == 3
    sources.apply(report(1, square[:2], shape="line"))
    assert state_of(sources, "tower of anna", 1).burned_cells == 3 + 10
    sources.apply(report(2, square, shape="polygon", state="unburned"))
    assert state_of(sources, "tower of anna", 2).unburned_cells == 100
    sources.apply(report(3, square, shape="polygon", state="smoke"))
    found = state_of(sources, "tower of anna", 3)
    assert (found.burned_cells, found.unburned_cells, found.observations) == (13, 100, 4)


def test_a_raster_counts_with_the_cells_that_it_shows(
    sources: ObservationSources, land: Landscape
) -> None:
    (north, west), (south, east) = places(land, (29.5, 29.5), (31.5, 31.5))
    edges: dict[str, Any] = {
        "south_deg": south,
        "west_deg": west,
        "north_deg": north,
        "east_deg": east,
    }
    raster = RasterObserved(
        *(1_000_000, "anna", "north"),
        **edges,
        rows=("bu", ".u"),
        seen_at_us=1_000_000,
        position_sd_m=5.0,
        false_alarms=0.0,
        source="tower",
    )
    sources.apply(raster)
    found = state_of(sources, "tower of anna", 1.0)
    assert (found.kind, found.observations, found.burned_cells, found.unburned_cells) == (
        *("detector", 1),
        *(1, 2),
    )


def test_reports_of_a_sensor_count_for_the_sensor(
    sources: ObservationSources, land: Landscape
) -> None:
    one = report(1, places(land, (30, 30)), by="thermal_frames", station="sensor", source="VIIRS")
    sources.apply(one)
    found = state_of(sources, "thermal_frames", 1.0)
    assert (found.kind, found.observations) == ("sensor", 1)
    alarms = {"VIIRS of thermal_frames": "burned where others are not"}
    found = state_of(sources, "thermal_frames", 1.0, contradictions=alarms)
    assert (found.state, found.problem) == ("contradicts", "burned where others are not")


def test_memory_is_bounded(sources: ObservationSources, land: Landscape) -> None:
    one = places(land, (30, 30))
    for step in range(MAX_REPORTERS + 5):
        sources.apply(report(step, one, source=f"detector {step}"))
    reporters = [each for each in sources.contributions.values() if each.kind == "detector"]
    assert len(reporters) == MAX_REPORTERS
    assert "detector 4 of anna" not in sources.contributions
    assert {"thermal_frames", "detector 5 of anna"} <= sources.contributions.keys()
    for step in range(100):
        sources.apply(image(1000 + step))
    kept = [each.at_us / 1e6 for each in sources.footprints if each.source == "hawk"]
    assert kept == list(range(1000, 1100, 10)), "one each ten seconds"
    for step in range(2 * MAX_FOOTPRINTS):
        sources.apply(image(2000 + 10 * step))
    assert len(sources.footprints) == MAX_FOOTPRINTS
    half = ("u" * (MAX_FOOTPRINT_CELLS // 1000),) * 500
    sources.apply(image(9000, cells=half))
    sources.apply(image(9010, cells=half))
    assert [each.at_us / 1e6 for each in sources.footprints] == [9000, 9010]
    sources.apply(image(9020, cells=(*half, *half, half[0])))
    assert not sources.footprints, "a window above the limit is counted, but not stored"
    assert state_of(sources, "hawk", 9020).last_at_us == 9_020_000_000


def test_a_fold_from_a_snapshot_continues_as_if_nothing_had_happened(
    sources: ObservationSources, land: Landscape
) -> None:
    events: list[Observed | FireObserved] = [
        *(image(at_s, position_sd_m=7.0 + at_s) for at_s in range(0, 40, 3)),
        *(report(50 + at_s, places(land, (30, 30))) for at_s in range(9)),
        *(image(at_s, source="thermal_frames", distrusted=at_s > 70) for at_s in range(60, 80, 2)),
    ]
    snapshots: list[ObservationSources] = []
    for event in events:
        snapshots.append(copied({"sources": sources}, Known(SCENARIO, land))["sources"])
        sources.apply(event)
    for number, restored in enumerate(snapshots):
        for event in events[number:]:
            restored.apply(event)
        assert restored.states(90_000_000, {}, {}, ()) == sources.states(90_000_000, {}, {}, ())
        assert restored.footprints == sources.footprints
    assert {each.source for each in sources.footprints} == {
        *("hawk", "tower of anna", "thermal_frames")
    }


def test_footprints_are_outlines_of_the_cells_in_their_places(
    sources: ObservationSources, land: Landscape
) -> None:
    sources.apply(image(0.0))
    sources.apply(report(1.0, places(land, (30, 30), (31, 31))))
    found = footprints_geojson(sources.footprints, land)["features"]
    seen, burned, reported = found
    named = [(each["properties"]["number"], each["properties"]["part"]) for each in found]
    assert named == [(1, "seen"), (1, "burned"), (2, "reported")]
    ((ring,),) = seen["geometry"]["coordinates"]
    corners = {
        (round(row * 2), round(col * 2)) for row, col in (cell_of(land, each) for each in ring)
    }
    # Corners in half cells: the window of rows 10 and 11, columns 20 to 22, without cell (11, 20).
    assert corners == {(19, 39), (19, 45), (23, 45), (23, 41), (21, 41), (21, 39)}
    ((ring,),) = burned["geometry"]["coordinates"]
    assert {cell_of(land, each) for each in ring} >= {(9.5, 22.5), (11.5, 20.5)}
    lon, lat = reported["geometry"]["coordinates"][0]
    assert cell_of(land, (lon, lat)) == (30.0, 30.0)


def cell_of(land: Landscape, place: Any) -> tuple[float, float]:
    row, col = land.row_col_of(*land.xy_of_lat_lon(place[1], place[0]))
    return round(float(row), 2), round(float(col), 2)


def test_the_state_view_notes_changes_every_few_seconds_and_no_others(land: Landscape) -> None:
    view = StateView(SCENARIO, land, 0)

    def fly(at_s: float) -> None:
        view.apply(
            Telemetry(round(at_s * 1e6), "hawk", 36.37, -84.13, 500.0, 150.0, 3.0, 4.0, 10.0), []
        )

    def touched(at_s: float) -> bool:
        before = view.changed["sources"]
        fly(at_s)
        return view.changed["sources"] > before

    every_s = SOURCES_EVERY_US / 1e6
    fly(0.0)
    for step in range(4):
        view.apply(image(step), [])
    assert not touched(every_s - 0.1), "not due"
    assert touched(every_s)
    assert [each.observations for each in view.sources()] == [4]
    assert not any(touched(every_s + step) for step in range(1, int(LATE_S) - 5))
    assert touched(3 + LATE_S + every_s), "it is late"
    assert view.sources()[0].state == "late"
    view.show_sensors({"hawk": "it fell off"}, ["hawk"])
    assert touched(3 + LATE_S + 2 * every_s)
    assert [each.problem for each in view.sources()] == ["it fell off"]
