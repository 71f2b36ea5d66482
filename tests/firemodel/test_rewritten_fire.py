"""Observations change some cells of a fire; the rest burns on without a loss of progress."""

import numpy as np
import pytest

from firemodel.arrays import window_at
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.assimilation.written_image import with_image
from firemodel.errors import FireModelError
from firemodel.landscape.default import jacksboro
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread import anyangle
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from tests.firemodel.grids import weather

WEATHER = WeatherStream([weather(5.0, 225.0), weather(3.0, 270.0, 9000.0)])
NOW_S, LATER_S = 5400.0, 9000.0
LAND = jacksboro(101, 91, 30.0)


@pytest.fixture(params=[False, True], ids=["corners", "precise"])
def burning(request: pytest.FixtureRequest) -> AnyAngleFire:
    """Return a fire in patchy fuel on real terrain."""
    found = AnyAngleFire(LAND, WEATHER, [(50, 40, 0.0)], precise=request.param)
    found.advance(NOW_S)
    return found


def burned_later(fire: AnyAngleFire, every_s: float, change: str) -> int:
    """Return the cells that burn until ``LATER_S``, with a change at regular times."""
    fire = fire.copy()
    nothing = np.zeros(LAND.shape, dtype=bool)
    model = AnyAngleFire(LAND, WEATHER, [])
    for until_s in np.arange(fire.time_s + every_s, LATER_S + 1.0, every_s):
        if change == "rewritten":
            fire = fire.rewritten(fire.expected_s(), nothing)
        elif change == "continued":
            fire = fire.continued(model)
        elif change == "restarted":
            fire = model.restarted(burning_from_arrival(fire.expected_s(), LAND, fire.time_s))
        fire.advance(float(until_s))
    return int(np.count_nonzero(fire.burned()))


def test_a_fire_burns_on_without_loss(burning: AnyAngleFire) -> None:
    """A restart from arrival times every two minutes loses a tenth of the growth in an hour."""
    now = np.count_nonzero(burning.burned())
    whole = burned_later(burning, 120.0, "nothing") - now
    for change in ("rewritten", "continued"):
        assert 0.98 * whole < burned_later(burning, 120.0, change) - now < 1.06 * whole
    assert burned_later(burning, 120.0, "restarted") - now < 0.95 * whole


def test_new_inputs_replace_earlier_ones(burning: AnyAngleFire) -> None:
    model = AnyAngleFire(LAND, WEATHER, [])
    perturbed = burning.copy()
    perturbed.perturb(1.3, 20.0, 1.2)
    perturbed.advance(LATER_S)
    once = burning.continued(model, 1.3, 20.0, 1.2)
    twice = burning.continued(model, 0.5, 90.0, 2.0).continued(model, 1.3, 20.0, 1.2)
    for each in (once, twice):
        each.advance(LATER_S)
    assert np.array_equal(once.arrival_time_s, perturbed.arrival_time_s)
    share = np.count_nonzero(twice.burned() ^ once.burned()) / np.count_nonzero(once.burned())
    assert share < 0.01


def test_each_path_has_a_tip_after_a_rewritten_fire_is_lit_again(burning: AnyAngleFire) -> None:
    """Without a tip for each path the kernels would write outside of their arrays."""
    arrival_s, changed = burning.expected_s(), np.zeros(LAND.shape, dtype=bool)
    row = int(np.argwhere(burning.burned())[:, 0].max())
    changed[row - 6 : row + 1, :] = True
    arrival_s[changed] = np.inf
    found = burning.rewritten(arrival_s, changed)
    best_s, source, _ = found._labels
    _, keys, waiting = found._queue
    ahead = np.flatnonzero((best_s > found.time_s) & (source >= 0))
    queued = np.concatenate([keys[: found._size], waiting[: found._waits]])
    assert np.isin(ahead, queued).all()
    burnable = np.isin(LAND.fuel_model, list(LAND.fuels))
    for lit_row, lit_col in np.argwhere(changed & burnable)[::40].tolist():
        found.light(lit_row, lit_col, found.time_s)
    paths, tips = found._active_paths(found.time_s)
    assert np.isin(paths.target, tips.target).all()


def test_rewritten_cells_change_and_all_others_keep_their_times(burning: AnyAngleFire) -> None:
    before = burning.arrival_time_s.copy()
    arrival_s, changed = burning.expected_s(), np.zeros(LAND.shape, dtype=bool)
    row, col = np.argwhere(burning.burned()).max(axis=0)
    changed[row - 3 : row + 1, :] = True  # the southern part has not burned
    arrival_s[changed] = np.where(arrival_s <= NOW_S, NOW_S + 600.0, arrival_s)[changed]
    changed[10:13, 10:13] = True  # a spot fire in the north-west
    arrival_s[10:13, 10:13] = NOW_S - 60.0
    found = burning.rewritten(arrival_s, changed)
    assert np.array_equal(burning.arrival_time_s, before)
    assert not found.burned()[row - 3 : row + 1].any()
    assert found.burned()[10:13, 10:13].all()
    same = ~changed
    assert np.array_equal(found.arrival_time_s[same], before[same])
    found.advance(LATER_S)
    assert found.burned()[row - 3, col - 10 : col + 10].any() or found.burned()[row - 3].any()
    assert np.count_nonzero(found.burned()[:25, :25]) > 12


def test_a_fire_without_burned_cells_cannot_be_rewritten(burning: AnyAngleFire) -> None:
    everywhere = np.ones(LAND.shape, dtype=bool)
    with pytest.raises(FireModelError, match="no cell has an arrival"):
        burning.rewritten(np.full(LAND.shape, np.inf), everywhere)


EVERYWHERE = window_at(0, 0, LAND.shape)


def image_of(land: Landscape, burned_cols: int) -> np.ndarray:
    """Return an image with burned western columns."""
    state = np.full(land.shape, UNBURNED, dtype=np.uint8)
    state[:, :burned_cols] = BURNED
    return state


def test_an_image_changes_only_cells_in_another_state_and_their_neighbours() -> None:
    arrival_s = np.where(np.arange(91) < 40, 100.0, 2000.0) + np.zeros(LAND.shape)
    free = np.zeros(LAND.shape, dtype=bool)
    assert with_image(arrival_s, EVERYWHERE, image_of(LAND, 40), 1000.0, 30.0, free) is None
    found = with_image(arrival_s, EVERYWHERE, image_of(LAND, 43), 1000.0, 30.0, free)
    assert found is not None
    new_s, changed = found
    assert np.flatnonzero(changed[0]).tolist() == [40, 41, 42, 43]
    assert (new_s[:, :43] <= 1000.0).all()
    assert (new_s[:, 43:] > 1000.0).all()
    assert np.array_equal(new_s[~changed], arrival_s[~changed])


def test_cells_that_were_not_seen_or_cannot_burn_keep_their_times() -> None:
    arrival_s = np.full(LAND.shape, np.inf)
    state = image_of(LAND, 5)
    state[:50] = UNSEEN
    cannot = np.zeros(LAND.shape, dtype=bool)
    cannot[:, 2] = True
    found = with_image(arrival_s, EVERYWHERE, state, 1000.0, 30.0, cannot)
    assert found is not None
    assert np.isinf(found[0][:50]).all()
    assert np.isinf(found[0][:, 2]).all()
    assert (found[0][50:, [0, 1, 3, 4]] <= 1000.0).all()


def test_points_without_use_are_dropped_and_the_fire_burns_on_equally(
    burning: AnyAngleFire, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many images change a cell at the front; times are equal with and without dropping points."""

    def rewritten_often(some_points: int) -> AnyAngleFire:
        monkeypatch.setattr(anyangle, "SOME_POINTS", some_points)
        fire = burning.copy()
        rng = np.random.default_rng(5)
        for step in range(40):
            arrival_s, changed = fire.expected_s(), np.zeros(LAND.shape, dtype=bool)
            rows, cols = np.nonzero(np.isfinite(arrival_s) & (arrival_s > fire.time_s - 600.0))
            chosen = rng.integers(rows.size)
            changed[rows[chosen], cols[chosen]] = True
            other_s = fire.time_s + (30.0 if step % 2 else -30.0)
            fire = fire.rewritten(np.where(changed, other_s, arrival_s), changed)
            fire.advance(fire.time_s + 30.0)
        return fire

    kept, dropped = rewritten_often(10**9), rewritten_often(0)
    assert dropped._used < 0.5 * kept._used
    assert np.array_equal(kept.arrival_time_s, dropped.arrival_time_s)
    np.testing.assert_array_equal(kept.arrival_vectors(), dropped.arrival_vectors())
    for fire in (kept, dropped):
        fire.advance(fire.time_s + 1800.0)
    assert np.array_equal(kept.arrival_time_s, dropped.arrival_time_s)
    assert np.array_equal(kept.expected_s(), dropped.expected_s())
