"""Thermal images in a watched folder reach the estimate; nothing else of the true fire does."""

import json
import os
from collections import defaultdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.cli.main import main
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import Observed, Telemetry
from mission_service.fire.observed_window import without_speckles
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_check import check
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.sensors import Sensors
from mission_service.journal.journal_file import Journal, SegmentReader
from mission_service.journal.recovery import resumed, unfinished
from mission_service.journal.snapshot import Known
from mission_service.live.daemon import replay
from mission_service.replay.verification import verify
from mission_service.runtime.engine import Engine
from mission_service.runtime.published_states import TelemetryState
from mission_service.runtime.state_view import StateView
from mission_service.sensors.sensor_files import SensorFiles
from mission_service.sensors.thermal import arrived_images, image_folder
from mission_service.sensors.thermal.camera_geometry import CameraPose
from mission_service.sensors.thermal.image_folder import ImageFolder
from mission_service.simulation.thermal_images import LENS, rendered, write_frame
from tests.api.worlds import World, world_in
from tests.patience import wait_until

START_S = 3600.0
FIX = Telemetry(7_200_000_000, "hawk", 36.36, -84.15, 600.0, 120.0, 20.0, 0.0, 0.0)
WIDE = LENS._replace(width=160, height=128, focal_px=70.0)


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    return folder


def scenario_for(frames: Path, *changes: str) -> Scenario:
    """Return a run without a simulated fire, whose only sensor reads the images of a folder."""
    found = load_scenario(
        "default",
        (
            *(f"start_s={START_S:g}", f"deploy_at_s={START_S:g}", "planner.rule=circling"),
            *('estimate.sensors=["thermal_frames"]', f'estimate.thermal_frames.folder="{frames}"'),
            f"estimate.thermal_frames.distortion={list(LENS.distortion)}",
            *changes,
        ),
    )
    return found.model_copy(update={"simulation": type(found.simulation)()})


def pose_at(land: Landscape, fix: TelemetryState) -> CameraPose:
    x_m, y_m = land.xy_of_lat_lon(fix.lat_deg, fix.lon_deg)
    yaw_deg = land.grid_deg(fix.heading_deg)
    return CameraPose(x_m, y_m, fix.altitude_amsl_m, yaw_deg, -90.0)


def camera_above_fire(scenario: Scenario) -> tuple[Fire, CameraPose]:
    """Return the scenario's fire after two hours, and a camera 200 m above its northern edge."""
    land = landscape_of(scenario)
    fire = fire_of(scenario, land)
    fire.advance(7200.0)
    row, col = np.argwhere(fire.burned())[0]
    x_m, y_m = land.xy_of(float(row), float(col))
    return fire, CameraPose(x_m, y_m, float(land.elevation_at(x_m, y_m)) + 200.0, 0.0, -90.0)


def photograph(frames: Path, fire: Fire, pose: CameraPose, taken: datetime, number: int) -> Path:
    """Write an image of a fire into the folder."""
    path = frames / f"{number:05d}.tif"
    rng = np.random.default_rng(number)
    celsius = rendered(fire.landscape, fire.arrival_time_s, fire.time_s, pose, rng, WIDE)
    write_frame(path, fire.landscape, pose, celsius, taken, WIDE)
    return path


@pytest.fixture
def without_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test lists the folder itself, so that each image is used at its own time."""
    monkeypatch.setattr(ImageFolder, "_run", lambda self: None)


def folder_sensor(world: World) -> ImageFolder:
    sensor = world.simulation.service.sensors._sensors["thermal_frames"]
    assert isinstance(sensor, ImageFolder)
    return sensor


def wrong_cells(world: World, true: Fire, alone: Fire, at_s: float) -> tuple[int, int]:
    """Fly until ``at_s``; return the cells in which estimate and model differ from the truth."""
    world.fly(at_s)
    true.advance(at_s)
    alone.advance(at_s)
    burned = true.burned()
    error = np.count_nonzero(world.simulation.estimate.fire.burned() ^ burned)
    return int(error), int(np.count_nonzero(alone.burned() ^ burned))


def sources_in(world: World, journal: Path) -> set[str]:
    """Close the journal of a run, and return the sources of its images."""
    world.simulation.service.recording.journal.close()
    contents = [entry.content for entry in SegmentReader(journal)]
    images = [each for each in contents if isinstance(each, Observed) and not each.corrects]
    return {each.source for each in images if not each.estimated}


@pytest.mark.long
@pytest.mark.usefixtures("without_thread")
def test_the_estimate_follows_a_fire_that_only_the_images_show(
    frames: Path, tmp_path: Path
) -> None:
    """The true fire burns in a wind that differs by 40 degrees from the reported wind."""
    scenario = scenario_for(frames)
    turned = (f"weather.0.wind_from_deg={(scenario.weather[0].wind_from_deg + 40.0) % 360:g}",)
    land = landscape_of(scenario)
    true = fire_of(load_scenario("default", turned), land)
    world = world_in(tmp_path, scenario)
    sensor, alone = folder_sensor(world), fire_of(scenario, land)
    number, at_s = 0, START_S
    while at_s < START_S + 1500.0:
        at_s += 15.0
        world.fly(at_s)
        fix = world.context.state_view.telemetry.get("hawk")
        if fix is None:
            continue
        true.advance(at_s)
        now = datetime.now(UTC)
        photograph(frames, true, pose_at(land, fix), now, number)
        number += 1
        sensor.scan(now)  # notes the file
        sensor.scan(now)  # reads it, because it has not grown
    assert number > 90
    assert sensor.problem == ""
    error, of_model = wrong_cells(world, true, alone, at_s + 30.0)
    assert error < 0.5 * of_model
    assert sources_in(world, tmp_path / "journal.jsonl") == {"thermal_frames"}
    assert verify(tmp_path / "journal.jsonl").difference is None


def test_a_thread_finds_files_and_names_those_it_cannot_use(frames: Path, tmp_path: Path) -> None:
    scenario = scenario_for(frames)
    fire, pose = camera_above_fire(scenario)
    sensor = ImageFolder(scenario, fire.landscape)
    assert sensor.observe(FIX) is None
    (frames / "half.tif").write_bytes(b"II*\0 not whole")
    wait_until(lambda: sensor.problem)
    assert "half.tif" in sensor.problem
    photograph(frames, fire, pose, datetime.now(UTC) - timedelta(seconds=20), 1)
    found: list[Observed | None] = []

    def has_arrived() -> bool:
        found.append(sensor.observe(FIX))
        return found[-1] is not None

    wait_until(has_arrived)
    image = found[-1]
    assert image is not None
    assert FIX.at_us - image.at_us >= 20_000_000
    assert "b" in "".join(image.cells)
    assert sensor.observe(FIX) is None, "each file is used once"
    (shown,) = sensor.images
    assert (shown.name.rpartition("/")[2], shown.at_us) == ("00001.tif", image.at_us)
    sensor.close()


@pytest.mark.usefixtures("without_thread")
@pytest.mark.parametrize(
    ("age_s", "words"), [(7200.0, "was taken 7200 s ago"), (-60.0, "60 s in the future")]
)
def test_an_image_of_another_time_is_not_used(age_s: float, words: str, frames: Path) -> None:
    scenario = scenario_for(frames)
    land = landscape_of(scenario)
    now = datetime(2026, 7, 4, tzinfo=UTC)
    pose = CameraPose(*land.xy_of(100.0, 100.0), 900.0, 0.0, -90.0)
    photograph(frames, fire_of(scenario, land), pose, now - timedelta(seconds=age_s), 1)
    sensor = ImageFolder(scenario, land)
    sensor.scan(now)
    assert sensor.problem == ""
    sensor.scan(now)
    assert words in sensor.problem
    assert sensor.observe(FIX) is None


@pytest.mark.usefixtures("without_thread")
def test_a_problem_is_an_alarm(frames: Path, tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_for(frames))
    (frames / "a.jpg").write_bytes(b"no image")
    for _ in range(2):
        folder_sensor(world).scan(datetime.now(UTC))
    world.fly(START_S + 120.0)
    alarm = world.context.state_view.alarms["sensor/thermal_frames"]
    assert "a.jpg: is not a TIFF, JPEG or PNG image" in alarm.text


def down_at(land: Landscape) -> CameraPose:
    x_m, y_m = land.xy_of(100.0, 100.0)
    return CameraPose(x_m, y_m, float(land.elevation_at(x_m, y_m)) + 200.0, 0.0, -90.0)


def looked(sensor: ImageFolder) -> None:
    for _ in range(2):  # the second look reads files that have not grown
        sensor.scan(datetime.now(UTC))


@pytest.mark.usefixtures("without_thread")
def test_an_image_without_an_observed_cell_does_not_end_the_sensor(frames: Path) -> None:
    scenario = scenario_for(frames, "estimate.thermal_frames.hot_level=200")
    land = landscape_of(scenario)
    sensor = ImageFolder(scenario, land)
    sensors = Sensors({"thermal_frames": sensor}, land.shape)
    grey = np.full((128, 160), 20, dtype=np.uint8)
    write_frame(frames / "cold.tif", land, down_at(land), grey, datetime.now(UTC), WIDE)
    looked(sensor)
    assert sensors.observe(FIX) == []
    assert sensors.problems() == {}


@pytest.mark.usefixtures("without_thread")
def test_odd_entries_and_an_absent_folder_do_not_end_the_watch(frames: Path) -> None:
    scenario = scenario_for(frames)
    land = landscape_of(scenario)
    sensor = ImageFolder(scenario, land)
    (frames / "folder.tif").mkdir()
    (frames / "loop.tif").symlink_to("loop.tif")
    (frames / "gone.tif").symlink_to("nowhere.tif")
    looked(sensor)
    assert sensor.problem == ""
    away = frames.rename(frames.with_name("away"))
    looked(sensor)
    assert "frames: cannot be read: No such file" in sensor.problem
    away.rename(frames)
    celsius = np.full((128, 160), 25.0)
    write_frame(frames / "a.tif", land, down_at(land), celsius, datetime.now(UTC), WIDE)
    looked(sensor)
    assert sensor.problem == ""
    assert sensor.observe(FIX) is not None


@pytest.mark.usefixtures("without_thread")
def test_a_problem_ends_when_its_file_is_completed_or_removed(frames: Path) -> None:
    scenario = scenario_for(frames)
    land = landscape_of(scenario)
    sensor = ImageFolder(scenario, land)
    path = frames / "a.tif"
    write_frame(path, land, down_at(land), np.full((128, 160), 25.0), datetime.now(UTC), WIDE)
    whole = path.read_bytes()
    path.write_bytes(whole[:9000])
    odd = Path(os.fsdecode(os.fsencode(frames) + b"/\xe9\n.tif"))
    odd.write_bytes(b"no image")
    looked(sensor)
    assert "(and 1 others)" in sensor.problem
    assert sensor.problem.isprintable()
    path.write_bytes(whole)
    odd.unlink()
    looked(sensor)
    assert sensor.problem == ""


@pytest.mark.usefixtures("without_thread")
def test_images_that_are_dropped_or_from_before_the_run_are_named(
    frames: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrived_images, "MAX_WAITING", 1)
    scenario = scenario_for(frames)
    land = landscape_of(scenario)
    sensor = ImageFolder(scenario, land)
    taken = datetime.now(UTC) - timedelta(seconds=60)
    for number in range(2):
        celsius = np.full((128, 160), 25.0)
        write_frame(frames / f"{number}.tif", land, down_at(land), celsius, taken, WIDE)
    looked(sensor)
    assert "0.tif: more than 1 newer images wait" in sensor.problem
    monkeypatch.setattr(
        "mission_service.sensors.thermal.image_folder.time.time", lambda: taken.timestamp() + 60.0
    )
    assert sensor.observe(msgspec.structs.replace(FIX, at_us=1_000_000)) is None
    assert "1.tif: was taken 59 s before mission time 0" in sensor.problem


@pytest.mark.usefixtures("without_thread")
def test_an_image_of_before_a_restart_is_not_used_again(frames: Path) -> None:
    scenario = scenario_for(frames)
    land = landscape_of(scenario)
    celsius = np.full((128, 160), 25.0)
    write_frame(frames / "a.tif", land, down_at(land), celsius, datetime.now(UTC), WIDE)
    first, files = ImageFolder(scenario, land), SensorFiles()
    looked(first)
    image = first.observe(FIX)
    assert image is not None
    files.on_event(image)
    again = ImageFolder(scenario, land)
    again.skip(files.names())
    looked(again)
    assert again.observe(FIX) is None
    assert again.problem == ""


def restarted(scenario: Scenario, path: Path) -> Engine:
    """Continue a run without vehicles from its journal, as the daemon does."""
    land = landscape_of(scenario)
    cut_off = unfinished(path, Known(scenario, land), scenario)
    assert cut_off is not None
    journal = Journal(path, {}, durable=True, rest=cut_off.rest())
    estimate, view = RunEstimate(scenario, land), StateView(scenario, land, 0)
    gateways: Any = defaultdict(MagicMock)
    service = Engine(scenario, Core(scenario, land), None, estimate, journal, view, gateways)
    replay(cut_off, service)
    service.resume(cut_off.missing, resumed(cut_off.last_us, 5.0), 0)
    return service


def burned_cells(image: Observed) -> set[tuple[int, int]]:
    return {
        (image.row + row, image.col + col)
        for row, cells in enumerate(image.cells)
        for col, letter in enumerate(cells)
        if letter == "b"
    }


def used_images(path: Path) -> list[Observed]:
    """Return the images in a journal, after the majority filter of the estimate."""
    contents = [entry.content for entry in SegmentReader(path)]
    images = [each for each in contents if isinstance(each, Observed) and each.source]
    return [without_speckles(each) for each in images]


@pytest.mark.usefixtures("without_thread")
def test_ground_that_burned_before_a_restart_and_has_cooled_stays_burned(
    frames: Path, tmp_path: Path
) -> None:
    scenario, path = scenario_for(frames), tmp_path / "journal.jsonl"
    fire, pose = camera_above_fire(scenario)
    world = world_in(tmp_path, scenario)
    photograph(frames, fire, pose, datetime.now(UTC), 1)
    looked(folder_sensor(world))
    world.fly(START_S + 120.0)
    world.simulation.service.recording.journal.close()

    service = restarted(scenario, path)
    sensor = service.sensors._sensors["thermal_frames"]
    assert isinstance(sensor, ImageFolder)
    cool = np.full((WIDE.height, WIDE.width), 25.0)
    write_frame(frames / "cool.tif", fire.landscape, pose, cool, datetime.now(UTC), WIDE)
    looked(sensor)
    at_us = world.simulation.clock.now_us + 60_000_000
    service.handle_events([msgspec.structs.replace(FIX, at_us=at_us)], 0)
    service.recording.journal.close()
    hot, cooled = used_images(path)
    assert len(burned_cells(hot)) > 50
    assert burned_cells(cooled) == burned_cells(hot)
    service.estimate.advance(at_us + 60_000_000)
    burned = service.estimate.fire.burned()
    assert all(burned[cell] for cell in burned_cells(hot))


@pytest.mark.usefixtures("without_thread")
def test_an_unexpected_error_of_one_file_is_named(
    frames: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path, pose_of: object) -> None:
        raise MemoryError

    monkeypatch.setattr(image_folder, "read_thermal_image", fail)
    scenario = scenario_for(frames)
    sensor = ImageFolder(scenario, landscape_of(scenario))
    (frames / "a.tif").write_bytes(b"")
    looked(sensor)
    assert "a.tif: MemoryError" in sensor.problem


def test_a_folder_that_does_not_exist_is_refused(frames: Path) -> None:
    with pytest.raises(ScenarioError, match="is not a folder; create it"):
        check(scenario_for(frames / "missing"))
    with pytest.raises(ScenarioError, match=r"estimate\.thermal_frames\.folder is missing"):
        check(load_scenario("default", ('estimate.sensors=["thermal_frames"]',)))


def test_the_command_shows_what_images_contribute(frames: Path, tmp_path: Path) -> None:
    fire, pose = camera_above_fire(scenario_for(frames))
    good = photograph(frames, fire, pose, datetime(2026, 7, 4, tzinfo=UTC), 1)
    out = tmp_path / "out"
    distortion = f"estimate.thermal_frames.distortion={list(LENS.distortion)}"
    common = ["--scenario", "default", "--out", str(out), "--set", distortion, "--json"]
    done = CliRunner().invoke(main, ["observe", str(good), *common])
    assert done.exit_code == 0, done.output
    (image,) = json.loads(done.stdout)["images"]
    assert image["burned_cells"] > 0
    assert image["taken"] == "2026-07-04T00:00:00+00:00"
    assert 1.0 < image["ellipse"]["minor_m"] <= image["ellipse"]["major_m"] < 6.0
    with Image.open(out / image["picture"]) as picture:
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    cool, burned, ellipse = (24, 9, 77), (140, 30, 122), (0, 229, 255)  # more than in the legend
    for colour, pixels in ((cool, 20_000), (burned, 20_000), (ellipse, 50)):
        assert np.count_nonzero((abs(colours - colour) < 30).all(axis=1)) > pixels
    both = CliRunner().invoke(main, ["observe", str(good), str(tmp_path / "none.tif"), *common])
    assert both.exit_code == 1
    first, second = json.loads(both.stdout)["images"]
    assert first["burned_cells"] == image["burned_cells"]
    assert "No such file" in second["error"]
