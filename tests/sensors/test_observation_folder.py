"""Files in a watched folder reach the estimate of a run, or an alarm has the reason."""

import json
import signal
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import shapely

from benchmarks.observation_samples import (
    VIIRS,
    ring_of,
    viirs_line,
    write_geojson,
    write_layer,
    write_mask,
)
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.events import AnyEvent, FireObserved, Observed, Telemetry
from mission_service.fire.scenario_check import check
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.sensors import Sensors
from mission_service.journal.journal_file import SegmentReader
from mission_service.replay.verification import verify
from mission_service.sensors.files import observation_folder
from mission_service.sensors.files.observation_file import check_file, contents_of
from mission_service.sensors.files.observation_folder import ObservationFolder
from mission_service.sensors.sensor_files import SensorFiles, file_part, whole_files
from tests.api.worlds import World, world_in
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_journal_processes import running
from tests.service.test_live import free_port

START_S = 3600.0
BOX = (10, 10, 40, 40)  # cells, far from the reported ignition
INSIDE = np.s_[12:38, 12:38]
FIX = Telemetry(7_200_000_000, "hawk", 36.36, -84.15, 600.0, 120.0, 20.0, 0.0, 0.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "observations"
    found.mkdir()
    return found


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test lists the folder itself, and its process reads the files."""

    def read(path: Path, landscape: Landscape, settings: object) -> object:
        check_file(path)
        return contents_of(path, landscape, settings)  # type: ignore[arg-type]

    monkeypatch.setattr(observation_folder, "read_observation_file", read)
    monkeypatch.setattr(ObservationFolder, "_run", lambda self: None)


def scenario_for(folder: Path, *changes: str) -> Scenario:
    """Return a run without a simulated fire, which begins with a reported ignition."""
    found = load_scenario(
        "default",
        (
            *(f"start_s={START_S:g}", f"deploy_at_s={START_S:g}", "planner.rule=circling"),
            'estimate.sensors=["observation_files"]',
            f'estimate.observation_files.folder="{folder}"',
            *changes,
        ),
    )
    return found.model_copy(update={"simulation": type(found.simulation)()})


def sensor_of(world: World) -> ObservationFolder:
    sensor = world.simulation.service.sensors._sensors["observation_files"]
    assert isinstance(sensor, ObservationFolder)
    return sensor


def looked(sensor: ObservationFolder) -> None:
    for _ in range(2):  # the second look reads files that have not grown
        sensor.scan(datetime.now(UTC))


def ago(minutes: float) -> datetime:
    return datetime.now(UTC) - timedelta(minutes=minutes)


def drop_perimeter(folder: Path, land: Landscape, at: datetime, name: str = "a.geojson") -> None:
    fields = {"PolygonDateTime": at.isoformat(), "Source": "WFIGS"}
    write_geojson(folder / name, [(shapely.Polygon(ring_of(land, *BOX)), fields)])


def burned(world: World) -> np.ndarray:
    world.simulation.estimate.advance(world.simulation.clock.now_us)
    return world.simulation.estimate.fire.burned().copy()


def journalled(out: Path) -> list[AnyEvent]:
    entries = SegmentReader(out / "journal.jsonl")
    return [each.content for each in entries]  # type: ignore[misc]


@pytest.mark.usefixtures("in_process")
def test_observations_that_are_not_used_are_named_until_the_file_is_replaced(folder: Path) -> None:
    scenario = scenario_for(folder)
    land = landscape_of(scenario)
    sensor = ObservationFolder(scenario, land)

    def write(*times: datetime | None) -> None:
        """Write a perimeter for each time."""
        top, left, bottom, right = BOX
        boxes = [(top, left + 40 * n, bottom, right + 40 * n) for n in range(len(times))]
        fields = [{"PolygonDateTime": at and at.isoformat()} for at in times]
        shapes = [shapely.Polygon(ring_of(land, *box)) for box in boxes]
        write_geojson(folder / "heat.geojson", list(zip(shapes, fields, strict=True)))
        looked(sensor)

    write(ago(1.0), None, ago(7 * 60.0))
    report = sensor.report(FIX.at_us)
    assert report is not None
    assert report.seen_at_us == pytest.approx(FIX.at_us - 60_000_000, abs=10_000_000)
    assert sensor.report(FIX.at_us) is None
    assert sensor.problem.startswith("2 of 3 observations in a file are not used: ")
    assert "heat.geojson: feature 2 has no time" in sensor.problem
    write(ago(1.0), ago(7 * 60.0))
    assert sensor.problem.startswith("1 of 2 observations in a file are not used: ")
    assert "ago; estimate.observation_files.max_age_s = 21600" in sensor.problem
    write(ago(1.0))
    assert sensor.problem == ""


@pytest.mark.usefixtures("in_process")
def test_a_dropped_perimeter_reaches_the_estimate_with_its_time_and_source(
    folder: Path, tmp_path: Path
) -> None:
    world = world_in(tmp_path, scenario_for(folder))
    world.fly(START_S + 60.0)
    before = burned(world)
    assert not before[:60, :60].any()
    land, at = world.context.landscape, ago(20.0)
    drop_perimeter(folder, land, at)
    looked(sensor_of(world))
    world.fly(START_S + 120.0)
    assert sensor_of(world).problem == ""
    found = burned(world)
    assert found[INSIDE].all()
    grown = np.count_nonzero(found) - np.count_nonzero(before)
    assert grown > 1.1 * 30 * 30, "the fire has spread since the perimeter"
    world.simulation.service.recording.journal.close()
    (report,) = (each for each in journalled(tmp_path) if isinstance(each, FireObserved))
    assert (report.source, report.by, report.station) == ("WFIGS", "observation_files", "sensor")
    assert report.at_us - report.seen_at_us == pytest.approx(1200e6, abs=20e6)
    assert report.file.startswith("a.geojson ")
    assert report.file.endswith(" 1/1")
    assert verify(tmp_path / "journal.jsonl").difference is None


@pytest.mark.usefixtures("in_process")
def test_a_raster_reaches_the_estimate(folder: Path, tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_for(folder))
    world.fly(START_S + 60.0)
    before, mask = burned(world), np.full(world.context.landscape.shape, 255)
    mask[20:30, 20:30] = 1
    write_mask(folder / "mask.tif", world.context.landscape, mask, ago(1.0), 30.0)
    looked(sensor_of(world))
    world.fly(START_S + 120.0)
    assert burned(world)[20:30, 20:30].all()
    assert not before[20:30, 20:30].any()
    world.simulation.service.recording.journal.close()
    rasters = [e for e in journalled(tmp_path) if isinstance(e, Observed) and e.source]
    assert [each.source for each in rasters] == ["observation_files"]
    assert verify(tmp_path / "journal.jsonl").difference is None


@pytest.mark.usefixtures("in_process")
def test_satellite_pixels_move_a_front_by_no_more_than_their_error_allows(
    folder: Path, tmp_path: Path
) -> None:
    world = world_in(tmp_path, scenario_for(folder))
    world.fly(START_S + 60.0)
    land, before = world.context.landscape, burned(world)
    rows, cols = np.nonzero(before)

    def drop(name: str, row: float) -> np.ndarray:
        lat, lon = land.lat_lon_of(*land.xy_of(row, float(cols[rows.argmin()])))
        line = viirs_line(float(lat), float(lon), datetime.now(UTC))
        (folder / name).write_text(VIIRS + line, encoding="utf-8")
        looked(sensor_of(world))
        world.fly(world.now_s + 10.0)
        assert sensor_of(world).problem == ""
        return burned(world)

    (tmp_path / "alone").mkdir()
    alone = world_in(tmp_path / "alone", scenario_for(folder))
    near = drop("near.csv", rows.min() - 5.0)  # 150 m from the front; its error is 108 m
    alone.fly(world.now_s)
    assert np.array_equal(near, burned(alone))
    far = drop("far.csv", rows.min() - 40.0)
    alone.fly(world.now_s)
    assert np.nonzero(far & ~burned(alone))[0].max() < rows.min() - 30


@pytest.mark.usefixtures("in_process")
def test_files_that_are_not_used_change_nothing_and_raise_an_alarm(
    folder: Path, tmp_path: Path
) -> None:
    world = world_in(tmp_path, scenario_for(folder))
    land, sensor = world.context.landscape, sensor_of(world)
    cases = {
        "future.geojson": (ago(-10.0), "600 s in the future; check the clocks, and the time zone"),
        "old.geojson": (ago(7 * 60.0), "25200 s ago; estimate.observation_files.max_age_s = 21600"),
    }
    for name, (at, words) in cases.items():
        drop_perimeter(folder, land, at, name)
        looked(sensor)
        assert words in sensor.problem
        (folder / name).unlink()
        looked(sensor)
        assert sensor.problem == ""
    with (folder / "large.gpkg").open("wb") as file:
        file.truncate(4 * 1024**3)
    looked(sensor)
    world.fly(START_S + 120.0)
    alarm = world.context.state_view.alarms["sensor/observation_files"]
    assert "a file is not used: " in alarm.text
    assert "large.gpkg: 4295 MB; the maximum is 64 MB" in alarm.text
    assert not burned(world)[INSIDE].any()


@pytest.mark.usefixtures("in_process")
def test_a_perimeter_of_before_the_run_is_used_and_a_refused_report_is_named(
    folder: Path, tmp_path: Path
) -> None:
    scenario = scenario_for(folder)
    land = landscape_of(scenario)
    sensor = ObservationFolder(scenario, land)
    drop_perimeter(folder, land, ago(20.0))
    write_mask(folder / "m.tif", land, np.full(land.shape, 1), ago(20.0), 30.0)
    looked(sensor)
    report = sensor.report(60_000_000)
    assert report is not None
    assert report.seen_at_us == pytest.approx(-1140e6, abs=20e6)
    assert sensor.observe(msgspec.structs.replace(FIX, at_us=60_000_000)) is None
    assert "m.tif: was observed 11" in sensor.problem
    world = world_in(tmp_path, scenario)
    world.fly(START_S + 60.0)
    world.simulation.service.sensors._sensors["observation_files"] = sensor
    seen = {"PolygonDateTime": ago(30.0).isoformat()}
    area = shapely.Polygon(ring_of(land, *BOX))
    write_geojson(folder / "b.geojson", [(area, seen)])
    looked(sensor)
    world.fly(START_S + 90.0)
    unburned = {"PolygonDateTime": ago(1.0).isoformat(), "state": "unburned", "Source": "liar"}
    write_geojson(folder / "c.geojson", [(area, unburned)])
    looked(sensor)
    world.fly(START_S + 120.0)
    texts = [each.text for each in world.context.state_view.announcements_after(0)]
    assert any("sensor observation_files: liar is not used: images" in t for t in texts)


@pytest.mark.usefixtures("in_process")
def test_files_of_before_a_restart_are_not_used_again(folder: Path) -> None:
    scenario = scenario_for(folder)
    land = landscape_of(scenario)
    when = {"PolygonDateTime": ago(20.0).isoformat()}
    areas = [shapely.Polygon(ring_of(land, row, 80, row + 10, 90)) for row in (80, 100, 120)]
    write_geojson(folder / "a.geojson", [(area, when) for area in areas])
    drop_perimeter(folder, land, ago(10.0), "b.geojson")
    sensor, files = ObservationFolder(scenario, land), SensorFiles()
    looked(sensor)
    seen = [sensor.report(FIX.at_us) for _ in range(5)]
    assert sum(each is not None for each in seen) == 4
    for each in seen[:2]:
        assert each is not None
        files.on_event(each)
    again = ObservationFolder(scenario, land)
    again.skip(files.names())
    looked(again)
    rest = [again.report(FIX.at_us) for _ in range(3)]
    assert [None if each is None else each.file for each in rest] == [
        each and each.file for each in (seen[2], seen[3], None)
    ]
    for each in seen[2:4]:
        assert each is not None
        files.on_event(each)
    assert {name.split()[0] for name in whole_files(files.names())} == {"a.geojson", "b.geojson"}
    third = ObservationFolder(scenario, land)
    third.skip(files.names())
    looked(third)
    assert third.report(FIX.at_us) is None
    drop_perimeter(folder, land, ago(9.0), "b.geojson")  # replaced: another file
    looked(third)
    assert third.report(FIX.at_us) is not None
    assert file_part("a b", 2, 3) == "a b 2/3"


@pytest.mark.usefixtures("in_process")
def test_a_shapefile_is_used_when_its_parts_have_arrived(folder: Path, tmp_path: Path) -> None:
    scenario = scenario_for(folder)
    land = landscape_of(scenario)
    write_layer(tmp_path / "a.shp", ring_of(land, 80, 80, 90, 90), ago(5.0), "ESRI Shapefile")
    sensor = ObservationFolder(scenario, land)
    for suffix in (".shp", ".dbf", ".shx", ".prj"):
        part = (tmp_path / "a.shp").with_suffix(suffix)
        part.rename(folder / part.name)
        looked(sensor)
        assert bool(sensor.problem) == (suffix != ".prj"), sensor.problem
    assert sensor.report(FIX.at_us) is not None


class Reporter:
    """A sensor that returns any object as its report."""

    def __init__(self, made: object) -> None:
        self.made = made

    def observe(self, fix: Telemetry) -> Observed | None:
        return None

    def on_event(self, event: AnyEvent) -> None:
        pass

    def report(self, at_us: int) -> Any:
        return self.made


def test_an_unusable_report_ends_its_sensor_alone() -> None:
    good = FireObserved(5, "ann", "x", "burning", "points", ((36.3, -84.1),), 4, 9.0, 0.0, "")
    for made, words in (
        ("text", "it returned str instead of FireObserved"),
        (msgspec.structs.replace(good, at_us=4), "has another at_us than the position"),
        (msgspec.structs.replace(good, seen_at_us=6), "or a later observation time"),
        (msgspec.structs.replace(good, position_sd_m=-1.0), "position_sd_m"),
    ):
        sensors = Sensors({"good": Reporter(good), "bad": Reporter(made)}, (9, 9))
        (found,) = sensors.reports(5)
        assert (found.by, found.station, found.source) == ("good", "sensor", "good")
        assert words in sensors.problems()["bad"]
        assert len(sensors.reports(5)) == 1


def test_a_folder_that_does_not_exist_is_refused(folder: Path) -> None:
    with pytest.raises(ScenarioError, match="is not a folder; create it"):
        check(scenario_for(folder / "missing"))
    with pytest.raises(ScenarioError, match=r"estimate\.observation_files\.folder is missing"):
        check(load_scenario("default", ('estimate.sensors=["observation_files"]',)))


@pytest.mark.long
def test_a_live_run_without_a_vehicle_ends_with_the_perimeter_of_a_dropped_file(
    folder: Path, tmp_path: Path
) -> None:
    """A kill does not make the run use the file again."""
    out, text = tmp_path / "out", tmp_path / "real.toml"
    default = Path("mission_service/scenarios/default.toml").read_text(encoding="utf-8")
    real = default.replace("[simulation.fire]", "[simulation.camera]")
    text.write_text(real, encoding="utf-8")
    land = landscape_of(load_scenario("default"))
    settings = (
        *("start_s=3600", f'vehicles.0.link="udpin:127.0.0.1:{free_port()}"'),
        'estimate.sensors=["observation_files"]',
        f'estimate.observation_files.folder="{folder}"',
    )
    sets = [word for each in settings for word in ("--set", each)]
    command = ["run", str(text), "--out", str(out), *sets]

    def reports() -> list[str]:
        lines = (out / "journal.jsonl").read_text(encoding="utf-8").splitlines()
        return [line for line in lines if '"FireObserved"' in line]

    drop_perimeter(folder, land, ago(20.0))
    with running(command, out) as (_, child):
        wait_until(reports)
        child.kill()
        child.wait(timeout=PATIENCE_S)
    with running(command, out) as (_, child):
        time.sleep(3.0)
        child.send_signal(signal.SIGTERM)
        child.wait(timeout=PATIENCE_S)
    assert len(reports()) == 1
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["requests"] == {"FireObserved": 1}
    fronts = json.loads((out / "perimeters.geojson").read_text(encoding="utf-8"))["features"]
    last = shapely.geometry.shape(fronts[-1]["geometry"])
    assert last.contains(shapely.Polygon(ring_of(land, 12, 12, 38, 38)))
