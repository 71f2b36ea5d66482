"""Sources of images that contradict the others are found without a model of the fire."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from firemodel.assimilation.observation import BURNED, UNBURNED, Observation
from mission_service.config.scenario import load_scenario
from mission_service.events import Observed, Telemetry
from mission_service.fire.source_agreement import SourceAgreement
from mission_service.journal.journal_file import SegmentReader
from mission_service.replay.verification import verify
from tests.api.worlds import World, world_in

SIZE = 60
KEYS = ("kind=visible", "missed=0.1")
FALSE_IMAGES = {
    "unburned": str.maketrans("b", "u"),
    "burned": str.maketrans("u", "b"),
    "inverted": str.maketrans("bu", "ub"),
}


def image(source: str, at_s: float, burned_cols: int, sd_m: float = 5.0) -> Observation:
    """An image of the whole grid with burned western columns."""
    state = np.full((SIZE, SIZE), UNBURNED, dtype=np.uint8)
    state[:, :burned_cols] = BURNED
    return Observation(at_s, 0, 0, state, sd_m, source=source)


def compared(*images: Observation) -> SourceAgreement:
    agreement = SourceAgreement((SIZE, SIZE), 30.0)
    for each in images:
        agreement.add_image(each)
    return agreement


def test_a_growing_fire_is_no_contradiction() -> None:
    images = [image("abc"[at % 3], 10.0 * at, 10 + at) for at in range(30)]
    assert compared(*images).contradictions() == {}


def test_of_three_sources_the_one_that_contradicts_both_others_is_distrusted() -> None:
    agreement = compared(image("a", 0.0, 20), image("b", 10.0, 21), image("c", 20.0, 5))
    assert agreement.distrusted == {"c"}
    assert "observations of c are not used" in agreement.contradictions()["c"]
    assert list(agreement.contradictions()) == ["c"]


def test_a_source_that_sees_fire_too_far_is_distrusted() -> None:
    agreement = compared(image("c", 0.0, 50), image("a", 10.0, 20), image("b", 20.0, 21))
    assert agreement.distrusted == {"c"}


def test_of_two_sources_either_may_be_wrong() -> None:
    agreement = compared(image("a", 0.0, 20), image("b", 10.0, 5))
    assert not agreement.distrusted
    assert agreement.contradictions() == {
        "a": "the observations of a and b contradict each other; check both"
    }


def test_a_source_is_trusted_again_after_it_agreed_for_some_time() -> None:
    agreement = compared(image("a", 0.0, 20), image("b", 10.0, 20), image("c", 20.0, 5))
    for at_s in np.arange(30.0, 4000.0, 30.0):
        for source in "abc":
            agreement.add_image(image(source, float(at_s), 22))
    assert not agreement.distrusted


@pytest.mark.parametrize("cols", [(5, 20, 40), (5, 5, 30, 30), (5, 20, 20, 40)])
def test_without_a_majority_no_source_is_distrusted(cols: tuple[int, ...]) -> None:
    agreement = SourceAgreement((SIZE, SIZE), 30.0)
    for at in range(10):
        for number, each in enumerate(cols):
            agreement.add_image(image("abcd"[number], 40.0 * at + 10.0 * number, each))
    assert not agreement.distrusted
    assert agreement.contradictions()


def test_old_sightings_are_not_compared() -> None:
    """A source that was wrong and then observes another part of the ground is used again."""
    agreement = compared(image("a", 0.0, 20), image("b", 10.0, 20), image("c", 20.0, 50))
    east = np.full((SIZE, 5), UNBURNED, dtype=np.uint8)
    for at_s in np.arange(30.0, 6000.0, 10.0):
        for source in "ab":
            agreement.add_image(image(source, float(at_s), 21))
        agreement.add_image(Observation(float(at_s), 0, SIZE - 5, east, 5.0, source="c"))
    assert not agreement.distrusted


def test_a_front_within_the_error_of_position_is_no_contradiction() -> None:
    images = (image("a", 0.0, 22, 60.0), image("b", 10.0, 20, 60.0), image("c", 20.0, 18, 60.0))
    assert compared(*images).contradictions() == {}
    assert compared(*(each._replace(position_sd_m=1.0) for each in images)).contradictions()


def flown(folder: Path, false_image: str | None) -> tuple[float, World]:
    """Fly four vehicles, one of them with a wrong camera; return the error of the estimate."""
    folder.mkdir()
    scenario = load_scenario("team", ("simulation.camera.kind=thermal", "deploy_at_s=3600"))
    world = world_in(folder, scenario)
    cameras = world.simulation.service.cameras
    assert cameras is not None
    observe = cameras.observe

    def falsified(fix: Telemetry) -> Observed | None:
        found = observe(fix)
        if found is None or fix.vehicle != "kite" or false_image is None:
            return found
        letters = FALSE_IMAGES[false_image]
        return msgspec.structs.replace(
            found, cells=tuple(row.translate(letters) for row in found.cells)
        )

    cameras.observe = falsified  # type: ignore[method-assign]
    world.fly(4500.0)
    estimate, true = world.simulation.estimate.fire.burned(), cameras.fire.fire.burned()
    return np.count_nonzero(estimate ^ true) / np.count_nonzero(true), world


@pytest.mark.long
@pytest.mark.parametrize("false_image", FALSE_IMAGES)
def test_one_false_camera_among_four_is_outvoted_with_an_alarm(
    tmp_path: Path, false_image: str
) -> None:
    honest, _ = flown(tmp_path / "honest", None)
    assert honest < 0.06
    error, world = flown(tmp_path / false_image, false_image)
    assert error < honest + 0.06
    service = world.simulation.service
    alarms = [key for key in service.state_view.alarms if key.startswith("observer/")]
    assert alarms == ["observer/kite"]
    service.recording.journal.close()
    reader = SegmentReader(tmp_path / false_image / "journal.jsonl")
    contents = [reader.entry(*line).content for line in reader.lines(reader.begin)]
    images = [each for each in contents if isinstance(each, Observed)]
    assert {each.vehicle for each in images if each.distrusted} == {"kite"}


def test_images_with_errors_are_equal_in_a_replay(tmp_path: Path) -> None:
    scenario = load_scenario(
        "default",
        ("deploy_at_s=600", *(f"simulation.camera.{each}" for each in KEYS)),
    )
    world = world_in(tmp_path, scenario)
    world.fly(900.0)
    world.simulation.service.recording.journal.close()
    found = verify(tmp_path / "journal.jsonl")
    assert all(stage.difference is None for stage in found.stages)
