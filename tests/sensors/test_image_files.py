"""A mock's camera flies around a simulated fire; only its files reach the estimate."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.image_files import behind_m, front_of
from mission_service.commands import UploadMission
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.events import CameraDirection, ImageCaptured, Observed
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.simulated_fire import simulated_fire_of
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.replay.verification import verify
from mission_service.sensors.thermal.thermal_image import read_thermal_image
from mission_service.simulation import sim
from mission_service.simulation.sim import Simulation
from tests.service import test_truth_apart
from tests.service.test_truth_apart import Poisoned

START_S, FLIGHT_S = 3600.0, 240.0


def scenario_for(folder: Path, *changes: str) -> Scenario:
    return load_scenario(
        "default",
        (
            *(f"start_s={START_S:g}", f"deploy_at_s={START_S:g}", "planner.rule=circling"),
            *('estimate.sensors=["thermal_frames"]', f'estimate.thermal_frames.folder="{folder}"'),
            *("vehicles.0.camera_trigger_m=40", "vehicles.0.gimbal_pitch_deg=-90"),
            *("simulation.fire.wind_turn_deg=40", "simulation.fire.spread_factor=1.3"),
            *changes,
        ),
    )


def flight_in(out: Path, scenario: Scenario) -> tuple[Simulation, Journal]:
    landscape = landscape_of(scenario)
    header = header_of(scenario, landscape.digest(), "")
    journal = Journal(out / "journal.jsonl", header, durable=False)
    return Simulation(scenario, journal, landscape), journal


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    return folder


@pytest.mark.long
def test_the_estimate_follows_the_files_of_a_camera_without_poses(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The files contain only their times; the poses come from the telemetry of ArduPilot."""
    scenario = scenario_for(
        frames,
        *("vehicles.0.stack=ardupilot", "simulation.camera.poses_in_files=false"),
        "estimate.thermal_frames.field_of_view_deg=100",
    )
    true = simulated_fire_of(scenario, landscape_of(scenario))
    assert true is not None
    fire = true.fire

    def poisoned(*_: Any) -> Any:
        true.fire = Poisoned(fire)  # type: ignore[assignment]
        return Poisoned(true)

    writer = "mission_service.simulation.image_writer"
    monkeypatch.setattr(test_truth_apart, "SENSORS", (*test_truth_apart.SENSORS, writer))
    monkeypatch.setattr(sim, "simulated_fire_of", poisoned)
    flight, journal = flight_in(tmp_path, scenario)
    track = []
    for second in range(round(FLIGHT_S / 5.0)):
        flight.run_until(START_S + 5.0 * (second + 1))
        mock = flight.rigs[0].mock.flight
        track.append(
            flight.estimate.landscape.xy_of_lat_lon(*mock.frame.global_position(mock.motion))
        )
    assert flight.service.sensors.problems() == {}
    flight.service.advance_fire(flight.clock.now_us)
    model = fire_of(scenario, flight.estimate.landscape)
    for each in (fire, model):
        each.advance(flight.clock.now_us / 1e6)
    of_estimate, of_model = (
        behind_m(front_of(fire), front_of(each), track[-13:])
        for each in (flight.estimate.fire, model)
    )
    assert of_estimate < 15.0 < of_model
    journal.close()
    contents = [entry.content for entry in SegmentReader(tmp_path / "journal.jsonl")]
    seen = [each for each in contents if isinstance(each, Observed)]
    assert {each.source for each in seen if not each.estimated} == {"thermal_frames"}
    images = sum(isinstance(each, ImageCaptured) for each in contents)
    assert images >= sum(not each.estimated for each in seen) > 10
    directions = sum(isinstance(each, CameraDirection) for each in contents)
    assert directions < 4.0 * FLIGHT_S
    assert all(
        206 in {item.command for item in each.items}
        for each in contents
        if isinstance(each, UploadMission)
    )
    assert verify(tmp_path / "journal.jsonl").difference is None


def test_files_contain_the_pose_with_the_errors_of_the_camera(frames: Path, tmp_path: Path) -> None:
    flight, journal = flight_in(tmp_path, scenario_for(frames))
    flight.run_until(START_S + 60.0)
    journal.close()
    paths = sorted(frames.iterdir())
    images = [read_thermal_image(path) for path in paths]
    assert len(images) > 2
    pitches = np.array([image.pitch_deg for image in images])
    assert np.all(np.abs(pitches + 90.0) < 3.0)
    assert len(set(pitches)) > 1
    with pytest.raises(ScenarioError, match="frames: contains images; remove them"):
        flight_in(tmp_path, scenario_for(frames))


def test_a_vehicle_that_takes_no_images_is_refused(frames: Path, tmp_path: Path) -> None:
    scenario = scenario_for(frames)
    plain = scenario.vehicles[0].model_copy(update={"camera_trigger_m": None})
    with pytest.raises(ScenarioError, match=r"hawk takes no images .* camera_trigger_m"):
        flight_in(tmp_path, scenario.model_copy(update={"vehicles": (plain,)}))
