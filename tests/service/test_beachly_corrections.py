"""The correction study of Beachly's section VII, on a small scale."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from firemodel.ellipses.point_observations import BURNED, BURNING
from mission_service.experiments.beachly import corrections as study
from mission_service.experiments.beachly import maria
from mission_service.experiments.beachly.participants import front_error_m, front_points
from mission_service.experiments.beachly.run import run_corrections
from mission_service.experiments.beachly.truth import random_burn, unit_box
from tests.firemodel.shared import shared_file

SEEDS = (1007, 1018)  # seeds other than the reported ones


@pytest.mark.long
def test_two_fires_are_corrected_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(maria, "folder", lambda: None)
    messages: list[str] = []
    rows = run_corrections(tmp_path, messages.append, SEEDS, participants=1)
    assert [(row["truth"], row["method"]) for row in rows] == [
        (f"random {seed}", method) for seed in SEEDS for method in ("paper", "gaussian")
    ]
    for paper, ours in zip(rows[::2], rows[1::2], strict=True):
        assert paper["corrections"] == ours["corrections"]
        assert 60 <= ours["corrections"] <= study.MAX_CORRECTIONS
        assert ours["mean_error_all_minutes_m"] < 0.6 * ours["mean_error_uncorrected_all_minutes_m"]
    left = {
        method: sum(row["mean_error_m"] for row in rows if row["method"] == method)
        for method in study.METHODS
    }
    uncorrected = sum(row["mean_error_uncorrected_m"] for row in rows[::2])
    assert left["gaussian"] < left["paper"] < 0.9 * uncorrected
    assert any("Maria is skipped" in text for text in messages)
    for name in ("fig10.png", "fig11.png"):
        assert (tmp_path / name).stat().st_size > 20_000


def test_participants_mark_what_they_could_see() -> None:
    burn = random_burn(1018)
    observations = study.observations_of_participant(burn, 0)
    assert np.array_equal(observations, study.observations_of_participant(burn, 0))
    watching = study.WATCHING
    within = [
        (observations[:, 2] > begin_s) & (observations[:, 2] <= begin_s + watching.segment_s)
        for begin_s in watching.begins_s
    ]
    assert np.any(within, axis=0).all()
    burning = observations[observations[:, 3] == BURNING]
    assert len(burning) > 0.5 * len(observations)
    off_m = []
    for x_m, y_m, at_s, _ in burning:
        front = front_points(burn.arrival_s, at_s, burn.landscape)
        off_m.append(np.hypot(*(front - (x_m, y_m)).T).min())
    assert 1.5 < np.mean(off_m) < 8.0  # the marks are noisy, and on the front
    row, col = (
        np.clip(np.round(at), 0, 99).astype(int)
        for at in burn.landscape.row_col_of(*observations[:, :2].T)
    )
    late_s = burn.arrival_s[row, col] - observations[:, 2]
    others = observations[:, 3] != BURNING
    assert others.any()
    right = np.where(observations[:, 3] == BURNED, late_s < 0.0, late_s > 0.0)
    assert right[others].mean() > 0.75


def test_front_errors_are_those_of_two_circles() -> None:
    west, south, east, north = unit_box()
    grid = study.grid_around(unit_box(), 50.0, 5.0, "EPSG:32614")
    middle = ((west + east) / 2.0, (south + north) / 2.0)
    away_m = np.hypot(*(study.cells_of(grid) - middle).T).reshape(grid.shape)
    true = front_points(away_m, 100.0, grid)
    assert len(true) == pytest.approx(2 * np.pi * 100.0, rel=0.01)
    assert front_error_m(true, front_points(away_m / 0.8, 100.0, grid)) == pytest.approx(
        20.0, abs=0.1
    )
    assert front_error_m(true, np.empty((0, 2))) == 150.0
    assert np.isnan(front_error_m(np.empty((0, 2)), true))


@pytest.mark.long
def test_only_what_was_marked_by_then_counts() -> None:
    burn = random_burn(1018)
    case = study.case_of(burn)
    case = case._replace(at_s=case.at_s[:6], fronts=case.fronts[:6])
    asked: list[float] = []

    def method(fire: object, observations: np.ndarray) -> object:
        asked.append(float(observations[:, 2].max(initial=0.0)))
        return fire

    observations = study.observations_of_participant(burn, 0)
    study.errors_m(case, observations, method)  # type: ignore[arg-type]
    assert asked == [0.0, 1260.0, 1320.0, 1380.0]


def test_maria_is_read_and_marked_where_its_data_is() -> None:
    perimeters = maria.read_perimeters(shared_file("maria_2019/firis_perimeters.shp"))
    assert len(perimeters) == 20
    assert perimeters[0].weather.at_s == 0.0
    assert perimeters[1].area.area == pytest.approx(7.26e6, rel=0.01)
    case = maria.case_of(perimeters[:3])
    observations = maria.random_observations(np.random.default_rng(0), 30, case)
    assert len(observations) == 30
    first = shapely.MultiPoint(case.fronts[0])
    assert (
        np.mean(shapely.distance(first, shapely.points(observations[:, :2]))) < 2 * maria.PLACE_SD_M
    )
    assert (observations[:, 2] == case.at_s[0] + 1.0).all()
    assert study.errors_m(case, observations, None)[0] > 100.0


def test_a_model_of_maria_has_burned_all_of_its_first_perimeter() -> None:
    from firemodel.physics.weather import Weather

    square = shapely.box(3e5, 38e5, 3.02e5, 38.02e5)
    weather = Weather(0.0, 5.0, 40.0, 4.0, 5.0, 6.0, 60.0, 90.0)
    later = Weather(1800.0, 5.0, 40.0, 4.0, 5.0, 6.0, 60.0, 90.0)
    case = maria.case_of(
        [maria.Perimeter(square, weather), maria.Perimeter(square.buffer(400.0), later)]
    )
    arrival_s = study.arrival_s(case, np.empty((0, 4)), None)
    inside = shapely.contains_xy(square, *case.points.T).reshape(arrival_s.shape)
    assert (arrival_s[inside] == 0.0).all()
    assert (arrival_s[~inside] > 0.0).all()
    assert study.errors_m(case, np.empty((0, 4)), None)[0] > 50.0
