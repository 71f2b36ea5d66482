"""The solver of the wind over terrain: exact cases, linear theory, convergence, bad input."""

import numpy as np
import pytest

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.wind import flow_kernels as kernels
from firemodel.wind import flow_solver, local_wind, surface_of_height, terrain_wind
from firemodel.wind.flow_grid import flow_grid, growing_levels
from firemodel.wind.terrain_wind import MAX_COLUMNS, MAX_DIVERGENCE, TerrainWind
from firemodel.wind.vegetation import REFERENCE_M, profile_at, profile_means

CELL_M = 30.0
WAVE_M = 1000.0


def hill(rows: int = 40, cols: int = 40, height_m: float = 120.0) -> Floats:
    """Return an elongated hill that is not symmetric."""
    row, col = np.indices((rows, cols))
    away = ((row - 18.0) / 9.0) ** 2 + ((col - 22.0) / 5.0) ** 2 + (row - 18) * (col - 22) / 60.0
    return height_m * np.exp(-away) + 2.0 * row


def solved(
    elevation_m: Floats, height_m: float = 0.3, max_columns: int = MAX_COLUMNS
) -> TerrainWind:
    surface = surface_of_height(np.full(elevation_m.shape, height_m))
    return terrain_wind(elevation_m, CELL_M, surface, max_columns=max_columns)


def rough_ground(seed: int, steepness_m: float) -> Floats:
    return np.random.default_rng(seed).uniform(0.0, steepness_m, (36, 44))


def test_the_wind_over_flat_ground_is_the_initial_wind() -> None:
    wind = solved(np.full((20, 30), 700.0))
    assert wind.steps == 0
    for above_m in (REFERENCE_M, 2.0, 40.0):
        found = wind.responses(above_m)
        profile = profile_at(
            wind.surface.height_m + above_m, wind.surface, wind.rough_m, wind.reference_m
        )
        assert np.array_equal(found[0, 0], profile.astype(np.float32))
        assert np.array_equal(found[1, 1], profile.astype(np.float32))
        assert not found[0, 1].any()
        assert not found[1, 0].any()
    assert np.all(wind.responses(REFERENCE_M)[0, 0] == 1.0)


def ridge_error(
    cell_m: float, layers: int, first_m: float, monkeypatch: pytest.MonkeyPatch
) -> float:
    """Return the error of the speed-up over low waves, relative to linear potential theory.

    Over ground of a small height h, a uniform flow of 1 m/s is faster at the ground by the sum over
    all waves of wave number times amplitude.
    """
    monkeypatch.setattr("firemodel.wind.flow_grid.FIRST_LAYER_M", first_m)
    count = round(8.0 * WAVE_M / cell_m)
    east_m = (np.arange(count) - count / 2.0 + 0.5) * cell_m
    height = 2.0 * np.cos(2.0 * np.pi * east_m / WAVE_M) * np.exp(-((east_m / 1500.0) ** 2))
    grid = flow_grid(np.tile(height, (round(4.0 * WAVE_M / cell_m), 1)), cell_m, layers)
    uniform = np.ones((layers, *grid.elevation_m.shape), np.float32)
    found = flow_solver.solve_potential(grid, (uniform, None), 1.0, 1e-9)
    tables = flow_solver.coefficients(
        grid.elevation_m, cell_m, grid.top_m, grid.levels, alpha_ratio=1.0
    )
    row, col = (part.start + 1 for part in grid.inner)
    out = np.empty((2, count))
    places = np.full(count, row + grid.shape[0] // 2), np.arange(count) + col
    kernels.corrections_at(found.phi, *places, np.zeros(count), grid.centres, out, *tables)
    longer = 16 * count
    waves = np.fft.rfft(height, longer) * 2.0 * np.pi * np.fft.rfftfreq(longer, cell_m)
    theory = np.fft.irfft(waves, longer)[:count]
    return float(np.sqrt(np.mean((out[0] - theory) ** 2) / np.mean(theory**2)))


def test_the_speed_up_over_low_waves_converges_to_linear_theory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    coarse = ridge_error(100.0, 10, 20.0, monkeypatch)
    fine = ridge_error(50.0, 20, 10.0, monkeypatch)
    assert fine < 0.05
    assert fine < 0.4 * coarse


def test_the_hilltop_hardly_depends_on_the_resolution() -> None:
    def top(cells: int) -> float:
        half = 1500.0
        at = (np.arange(cells) + 0.5) * 2.0 * half / cells - half
        ground = 100.0 * np.exp(-(at[:, None] ** 2 + at**2) / 250.0**2)
        surface = surface_of_height(np.full(ground.shape, 0.3))
        wind = terrain_wind(ground, 2.0 * half / cells, surface)
        middle = np.array([(cells - 1) / 2.0])
        return float(wind.responses_at(middle, middle, np.array([10.0]))[0, 0, 0])

    tops = [top(cells) for cells in (25, 51, 101)]
    assert 1.2 < tops[-1] < 2.5
    assert abs(tops[2] - tops[1]) < 0.4 * abs(tops[1] - tops[0])
    assert abs(tops[2] - tops[1]) < 0.03 * tops[2]


@pytest.mark.parametrize("ground", [hill(), rough_ground(1, 60.0), rough_ground(2, 300.0)])
def test_the_divergence_of_the_result_is_that_stated(ground: Floats) -> None:
    wind = solved(ground)
    assert wind.divergence <= MAX_DIVERGENCE < 1e-6
    grid, tables = wind.grid, wind.tables
    surface = surface_of_height(np.full(grid.elevation_m.shape, 0.3))
    for phi, eastward in zip(wind.potentials, (True, False), strict=True):
        image, initial = np.zeros_like(phi), np.zeros_like(phi)
        kernels.apply_flow(phi, image, tables.ground, tables.layers)
        profile = profile_means(grid, surface)
        kernels.add_divergence(profile, initial, eastward, *tables, grid.cell_m)
        volumes = tables.layers[kernels.WIDTH, :-1, None, None] * grid.depth_m
        rest = (initial - image)[:-1, 1:-1, 1:-1] / volumes
        assert np.abs(initial[:-1, 1:-1, 1:-1] / volumes).max() * CELL_M > 0.1
        assert np.abs(rest).max() * CELL_M < 1e-6


def test_corrections_are_derivatives_at_constant_height() -> None:
    grid = flow_grid(rough_ground(6, 40.0), CELL_M)
    tables = flow_solver.coefficients(
        grid.elevation_m, CELL_M, grid.top_m, grid.levels, alpha_ratio=1.0
    )
    row, col = np.indices(grid.elevation_m.shape)
    height = grid.elevation_m + grid.levels[:, None, None] * grid.depth_m
    phi = np.pad(0.3 * col * CELL_M - 0.2 * row * CELL_M + 0.7 * height, ((0, 0), (1, 1), (1, 1)))
    rows, cols = (each.ravel() + 1 for each in np.mgrid[10:20, 12:22])
    for share in (0.0, 0.01, 0.1):
        out = np.empty((2, len(rows)))
        shares = np.full(len(rows), share)
        kernels.corrections_at(phi, rows, cols, shares, grid.centres, out, *tables)
        assert np.allclose(out[0], 0.3, atol=2e-3)  # the layers grow
        assert np.allclose(out[1], -0.2, atol=2e-3)


def test_any_direction_is_a_sum_of_two_directions_and_scales_with_the_speed() -> None:
    wind = solved(hill())
    profile = profile_means(wind.grid, surface_of_height(np.full(wind.grid.elevation_m.shape, 0.3)))
    north, east = 7.0 * np.cos(2.0), 7.0 * np.sin(2.0)
    initial = ((east * profile).astype(np.float32), (-north * profile).astype(np.float32))
    direct = flow_solver.solve_potential(wind.grid, initial, 1.0, 1e-8)
    summed = east * wind.potentials[0] - north * wind.potentials[1]
    assert np.abs(direct.phi - summed).max() < 1e-4 * np.abs(summed).max()
    responses = wind.responses(REFERENCE_M)
    from_deg = np.rad2deg(2.0) + 180.0
    one, seven = (local_wind(responses, speed, from_deg) for speed in (1.0, 7.0))
    assert np.allclose(7.0 * one, seven)
    assert np.allclose(seven, north * responses[0] + east * responses[1], atol=1e-5)


def test_the_wind_turns_with_the_landscape() -> None:
    ground = hill()
    plain = solved(ground).responses(REFERENCE_M)
    # The landscape turned anticlockwise: what was towards north is towards west.
    turned = solved(np.rot90(ground)).responses(REFERENCE_M)
    north_north, north_east = (np.rot90(each) for each in plain[0])
    assert np.allclose(turned[1, 1], north_north, atol=1e-4)
    assert np.allclose(turned[1, 0], -north_east, atol=1e-4)


def test_ridges_speed_the_wind_up_and_valleys_slow_it_down() -> None:
    ground = hill()
    along = local_wind(solved(ground).responses(REFERENCE_M), 5.0, 270.0)
    speed = np.hypot(*along)
    assert speed[18, 22] > 5.0 * 1.3
    assert speed[18, 12] < 5.0
    taller = np.hypot(*local_wind(solved(hill(height_m=240.0)).responses(REFERENCE_M), 5.0, 270.0))
    assert taller[18, 22] > speed[18, 22]


def test_air_that_resists_vertical_motion_is_faster_over_a_hill() -> None:
    surface = surface_of_height(np.full((40, 40), 0.3))
    top = [
        terrain_wind(hill(), CELL_M, surface, alpha_ratio=ratio).responses(REFERENCE_M)[
            1, 1, 18, 22
        ]
        for ratio in (2.0, 1.0, 0.5)
    ]
    assert 1.0 < top[0] < top[1] - 0.1 < top[2] - 0.2


def test_rough_canopies_are_passed_faster_at_the_top_of_a_hill() -> None:
    smooth, forest = (
        solved(hill(), height_m).responses(REFERENCE_M)[1, 1, 18, 22] for height_m in (0.1, 20.0)
    )
    assert forest > smooth > 1.2


@pytest.mark.parametrize(
    ("ground", "cell_m"),
    [
        (np.array([[5.0]]), 30.0),
        (np.linspace(0.0, 500.0, 50)[None], 30.0),
        (np.where(np.arange(40)[None] < 20, 0.0, 1000.0) * np.ones((40, 1)), 10.0),
        (rough_ground(3, 4000.0), 1e5),
        (rough_ground(4, 0.01), 0.01),
        (-400.0 + rough_ground(5, 50.0), 100.0),
    ],
)
def test_every_landscape_has_finite_winds(ground: Floats, cell_m: float) -> None:
    wind = terrain_wind(ground, cell_m, surface_of_height(np.full(ground.shape, 0.3)))
    speed = np.hypot(*local_wind(wind.responses(REFERENCE_M), 1.0, 225.0))
    assert np.isfinite(speed).all()
    assert 0.0 <= speed.min() <= 1.0 <= speed.max() + 1e-6 < 10.0


def test_large_landscapes_are_solved_with_larger_cells() -> None:
    row, col = np.indices((61, 90))
    ground = 150.0 * np.exp(-(((row - 30.0) / 20.0) ** 2 + ((col - 45.0) / 20.0) ** 2))
    fine, coarse = solved(ground), solved(ground, max_columns=61 * 90 // 4)
    assert (fine.factor, coarse.factor) == (1, 3)
    assert coarse.grid.shape == (21, 30)
    assert coarse.grid.cell_m == 3.0 * CELL_M
    plain, rougher = (each.responses(REFERENCE_M)[1, 1] for each in (fine, coarse))
    assert rougher.shape == ground.shape
    assert np.abs(plain - rougher).max() < 0.06
    place = np.array([30.0]), np.array([45.0]), np.array([50.0])
    assert np.allclose(fine.responses_at(*place), coarse.responses_at(*place), atol=0.05)


def test_levels_grow_by_a_factor_from_the_first() -> None:
    levels = growing_levels(20, 0.002)
    thick = np.diff(levels)
    assert levels[0] == 0.0
    assert levels[-1] == 1.0
    assert thick[0] == pytest.approx(0.002)
    assert np.allclose(thick[1:] / thick[:-1], thick[1] / thick[0])
    assert np.allclose(np.diff(growing_levels(10, 0.5)), 0.1)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 20_000.0])
def test_an_elevation_that_is_missing_is_refused(bad: float) -> None:
    ground = hill()
    ground[7, 3] = bad
    with pytest.raises(FireModelError, match=r"elevation is (nan|inf|20000\.0) at row 7, column 3"):
        solved(ground)


def test_impossible_winds_and_cells_are_refused() -> None:
    surface = surface_of_height(np.full((40, 40), 0.3))
    with pytest.raises(FireModelError, match="cell size 0"):
        terrain_wind(hill(), 0.0, surface)
    with pytest.raises(FireModelError, match="is not a valid wind"):
        local_wind(np.ones((2, 2, 1, 1)), -1.0, 0.0)


def test_ground_that_does_not_converge_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow_solver, "MAX_STEPS", 2)
    with pytest.raises(FireModelError, match="after 2 steps"):
        solved(hill())
