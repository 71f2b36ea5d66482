"""Thermal video with metadata reaches the estimate, from a stream, a UDP port or a file."""

import json
import select
import socket
import time
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.klv_video import TEMPERATURES_C, VideoWriter, grey, packet, pose_values
from firemodel.spread.fire_scheme import Fire
from mission_service.cli.main import main
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.events import Observed, Telemetry
from mission_service.fire.scenario_check import check
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.sensors import MAX_IMAGES, Sensors
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens
from mission_service.sensors.video import thermal_video
from mission_service.sensors.video.thermal_video import ThermalVideo
from mission_service.sensors.video.video_sources import DatagramSource
from mission_service.simulation.thermal_images import rendered
from tests.api.worlds import world_in
from tests.patience import PATIENCE_S, wait_until
from tests.sensors.test_image_folder import (
    START_S,
    camera_above_fire,
    pose_at,
    sources_in,
    wrong_cells,
)

FIX = Telemetry(7_200_000_000, "hawk", 36.36, -84.15, 600.0, 120.0, 20.0, 0.0, 0.0)
WIDE = Lens(160, 128, 70.0)
RANGE = f"estimate.thermal_video.grey_level_range_c={list(TEMPERATURES_C)}"


def scenario_for(source: str, *changes: str) -> Scenario:
    """Return a run without a simulated fire, whose only sensor receives a video."""
    found = load_scenario(
        "default",
        (
            *(f"start_s={START_S:g}", f"deploy_at_s={START_S:g}", "planner.rule=circling"),
            *('estimate.sensors=["thermal_video"]', f'estimate.thermal_video.source="{source}"'),
            *(RANGE, *changes),
        ),
    )
    return found.model_copy(update={"simulation": type(found.simulation)()})


def film(writer: VideoWriter, fire: Fire, pose: CameraPose, taken: datetime, at_s: float) -> bytes:
    """Return the part of a stream with two pictures of a fire; the second one ends the first."""
    rng = np.random.default_rng(round(at_s * 10.0))
    picture = grey(rendered(fire.landscape, fire.arrival_time_s, fire.time_s, pose, rng, WIDE))
    values = pose_values(fire.landscape, pose, WIDE)
    for number in range(2):
        later_s = number / 30.0
        metadata = packet(taken + timedelta(seconds=later_s), values)
        writer.add(at_s + later_s, picture, [metadata])
    return writer.taken()


def clip(taken: datetime, seconds: float) -> bytes:
    """Return a whole stream of the default scenario's fire, with a picture every half second."""
    fire, pose = camera_above_fire(scenario_for("none.ts"))
    writer = VideoWriter(WIDE.width, WIDE.height)
    parts = [
        film(writer, fire, pose, taken + timedelta(seconds=float(at_s)), float(at_s))
        for at_s in np.arange(0.0, seconds, 0.5)
    ]
    return b"".join(parts) + writer.close()


@pytest.fixture
def without_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test passes the bytes itself, so that each image is used at its own time."""
    monkeypatch.setattr(ThermalVideo, "_run", lambda self: None)


@pytest.mark.long
@pytest.mark.usefixtures("without_thread")
def test_the_estimate_follows_a_fire_that_only_the_video_shows(tmp_path: Path) -> None:
    """The true fire burns in a wind that differs by 40 degrees from the reported wind."""
    scenario = scenario_for("udpin:127.0.0.1:5600")
    turned = (f"weather.0.wind_from_deg={(scenario.weather[0].wind_from_deg + 40.0) % 360:g}",)
    land = landscape_of(scenario)
    true = fire_of(load_scenario("default", turned), land)
    world = world_in(tmp_path, scenario)
    sensor = world.simulation.service.sensors._sensors["thermal_video"]
    alone = fire_of(scenario, land)
    assert isinstance(sensor, ThermalVideo)
    writer, begun, at_s = VideoWriter(WIDE.width, WIDE.height), datetime.now(UTC), START_S
    while at_s < START_S + 1500.0:
        at_s += 15.0
        world.fly(at_s)
        fix = world.context.state_view.telemetry.get("hawk")
        if fix is None:
            continue
        true.advance(at_s)
        taken = begun + timedelta(seconds=at_s)
        sensor.use(film(writer, true, pose_at(land, fix), taken, at_s), taken)
    assert sensor._stream.counts.images > 90
    sensor.end_window()
    assert sensor.problem == ""
    error, of_model = wrong_cells(world, true, alone, at_s + 30.0)
    assert error < 0.2 * of_model
    assert len(sensor.images) == MAX_IMAGES
    assert sources_in(world, tmp_path / "journal.jsonl") == {"thermal_video"}


def received(sensor: ThermalVideo) -> list[Observed]:
    """Return the observations that wait in a sensor."""
    found = []
    while (image := sensor.observe(FIX)) is not None:
        found.append(image)
    return found


@pytest.fixture(scope="module")
def two_seconds() -> bytes:
    """Return a stream of two seconds from twenty seconds ago."""
    return clip(datetime.now(UTC) - timedelta(seconds=20), 2.0)


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def sensor_at(port: int, *changes: str) -> ThermalVideo:
    scenario = scenario_for(f"udpin:127.0.0.1:{port}", *changes)
    return ThermalVideo(scenario, landscape_of(scenario))


def use_all(sensor: ThermalVideo) -> None:
    """Use the datagrams that wait at the port."""
    assert isinstance(sensor._source, DatagramSource)
    assert sensor._source._socket is not None
    while select.select([sensor._source._socket], [], [], 0.0)[0]:
        sensor.use(sensor._source.next_bytes(), datetime.now(UTC))


def send(sender: socket.socket, port: int, data: bytes) -> None:
    for start in range(0, len(data), 7 * 188):
        sender.sendto(data[start : start + 7 * 188], ("127.0.0.1", port))


@pytest.mark.usefixtures("without_thread")
def test_one_sender_is_used_among_garbage_and_other_senders_until_it_is_silent(
    two_seconds: bytes, port: int
) -> None:
    sensor = sensor_at(port)
    with (
        closing(sensor._source),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        assert sensor._source.next_bytes() == b"", "opens the port"
        first.sendto(b"no video", ("127.0.0.1", port))
        send(first, port, two_seconds)
        send(second, port, two_seconds)
        use_all(sensor)
        found = received(sensor)
        assert len(found) == 2, "one a second"
        assert sensor._stream.counts.size == len(two_seconds)
        assert FIX.at_us - found[0].at_us >= 19_000_000
        assert "b" in "".join(found[0].cells)
        sensor.end_window()
        assert "127.0.0.1" in sensor.problem
        assert "sends to the same port and is ignored" in sensor.problem
        sensor.end_window()
        assert "nothing has arrived for 10 s; check the sender" in sensor.problem
        send(second, port, two_seconds)
        use_all(sensor)
        assert len(received(sensor)) == 2
        first.sendto(b"no video", ("127.0.0.1", port))
        use_all(sensor)
        sensor.end_window()
        assert "datagrams from 127.0.0.1 are not plain MPEG transport packets" in sensor.problem


def test_a_thread_receives_a_stream_that_begins_after_a_silence(
    two_seconds: bytes, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thermal_video, "WINDOW_S", 0.3)
    sensor = sensor_at(port)
    assert sensor.observe(FIX) is None
    wait_until(lambda: "nothing has arrived" in sensor.problem)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for _ in range(100):
            send(sender, port, two_seconds)
            time.sleep(0.5)
            if received(sensor):
                break
        else:
            pytest.fail("no observation in 50 s")
    sensor.close()
    wait_for_end(sensor)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))  # the sensor's socket is closed


def wait_for_end(sensor: ThermalVideo) -> None:
    """Wait until the sensor's thread has ended."""
    assert sensor._thread is not None
    sensor._thread.join(PATIENCE_S)
    assert not sensor._thread.is_alive()


@pytest.mark.usefixtures("without_thread")
def test_ground_that_burned_before_a_restart_and_has_cooled_stays_burned() -> None:
    scenario = scenario_for("udpin:127.0.0.1:5600")
    land = landscape_of(scenario)
    fire, pose = camera_above_fire(scenario)
    burned = fire.burned()
    fire.arrival_time_s[:] = np.inf  # all ground is cool
    now, at_us = datetime.now(UTC), FIX.at_us - 60_000_000
    sensors = Sensors({"thermal_video": ThermalVideo(scenario, land)}, land.shape)
    since_s = np.where(burned, at_us / 1e6 - 600.0, np.inf)
    sensors.restore_burned({"thermal_video": since_s}, at_us)
    (sensor,) = sensors._sensors.values()
    assert isinstance(sensor, ThermalVideo)
    sensor.use(film(VideoWriter(WIDE.width, WIDE.height), fire, pose, now, 0.0), now)
    (image,) = sensors.observe(FIX)
    letters = np.array([list(row) for row in image.cells])
    seen = burned[image.row :, image.col :][: letters.shape[0], : letters.shape[1]]
    assert (letters == "b").sum() > 50
    assert (letters[seen] != "u").all()
    assert (letters[~seen] != "b").all()


def test_a_port_in_use_is_named(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        sensor = sensor_at(port)
        sensor._source.next_bytes()
        sensor.end_window()
    assert "Address already in use; another program may use the port" in sensor.problem


@pytest.mark.usefixtures("without_thread")
def test_a_file_may_be_created_later_grow_and_be_replaced(
    two_seconds: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "video.ts"
    scenario = scenario_for(str(path))
    sensor = ThermalVideo(scenario, landscape_of(scenario))

    def read() -> int:
        sensor.use(sensor._source.next_bytes(), datetime.now(UTC))
        return len(received(sensor))

    assert read() == 0
    sensor.end_window()
    assert "video.ts: No such file" in sensor.problem
    half = len(two_seconds) // 2 // 188 * 188
    path.write_bytes(two_seconds[:half])
    assert read() == 1
    with path.open("ab") as file:
        file.write(two_seconds[half:])
    assert read() == 1
    path.write_bytes(clip(datetime.now(UTC) - timedelta(seconds=5), 1.0))
    assert read() == 1
    path.unlink()
    path.mkdir()
    assert read() == 0
    sensor.end_window()
    assert "video.ts: is not a file" in sensor.problem


@pytest.mark.usefixtures("without_thread")
@pytest.mark.parametrize(
    ("age_s", "words"), [(-60.0, "in the future; check the camera's clock"), (7200.0, "")]
)
def test_video_of_another_time_is_not_used(age_s: float, words: str, port: int) -> None:
    """Old video is not even decoded, so that a long recording does not occupy the processor."""
    sensor, now = sensor_at(port), datetime(2026, 7, 4, tzinfo=UTC)
    sensor.use(clip(now - timedelta(seconds=age_s), 1.0), now)
    assert received(sensor) == []
    assert sensor._stream.counts.images == bool(words)
    sensor.end_window()
    assert words in sensor.problem
    assert sensor.problem


def test_settings_and_libraries_are_checked_before_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ScenarioError, match=r"estimate\.thermal_video\.source is missing"):
        check(load_scenario("default", ('estimate.sensors=["thermal_video"]',)))
    source = 'estimate.thermal_video.source="udpin:127.0.0.1:0"'
    named = ('estimate.sensors=["thermal_video"]', source)
    with pytest.raises(ScenarioError, match="set grey_level_range_c or hot_level"):
        check(load_scenario("default", named))
    with pytest.raises(ScenarioError, match="port 0 is not between 1 and 65535"):
        check(load_scenario("default", (*named, RANGE)))
    url = 'estimate.thermal_video.source="rtsp://camera/1"'
    with pytest.raises(ScenarioError, match="rtsp://camera/1 is a URL; use udpin"):
        check(load_scenario("default", (*named, url, RANGE)))
    with pytest.raises(ScenarioError, match="a lower and a higher temperature"):
        load_scenario("default", ("estimate.thermal_video.grey_level_range_c=[100, 0]",))
    monkeypatch.setattr(thermal_video, "LIBRARIES", ("av", "not_installed"))
    with pytest.raises(ScenarioError, match=r"pip install 'mission-service\[video\]'"):
        check(load_scenario("default", (*named, RANGE)))


def test_an_unexpected_error_ends_the_sensor_with_the_reason(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Panic(BaseException):
        """A fault in a library that is written in Rust."""

    def fail(self: ThermalVideo, data: bytes, now: datetime) -> None:
        raise Panic("out of bounds")

    monkeypatch.setattr(ThermalVideo, "use", fail)
    sensor = sensor_at(port)
    sensor.observe(FIX)
    wait_for_end(sensor)
    with pytest.raises(RuntimeError, match="Panic: out of bounds"):
        sensor.observe(FIX)


def test_the_command_shows_what_a_video_contributes(tmp_path: Path) -> None:
    path, out = tmp_path / "video.ts", tmp_path / "out"
    path.write_bytes(clip(datetime(2026, 7, 4, tzinfo=UTC), 2.0))
    common = ["--scenario", "default", "--out", str(out), "--set", RANGE, "--json"]
    done = CliRunner().invoke(main, ["observe", str(path), *common])
    assert done.exit_code == 0, done.output
    (image,) = json.loads(done.stdout)["images"]
    assert image["burned_cells"] > 0
    assert image["taken"] == "2026-07-04T00:00:00+00:00"
    assert (out / image["picture"]).read_bytes().startswith(b"\x89PNG")
    path.write_bytes(b"no video")
    done = CliRunner().invoke(main, ["observe", str(path), *common])
    assert done.exit_code == 1
    assert "no video of a known codec" in json.loads(done.stdout)["images"][0]["error"]
