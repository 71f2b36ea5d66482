"""Crown fire: each equation against a value from its publication, cells against `behave`."""

import csv
import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray

import firemodel
from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.member_fires import Start
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.outputs.geotiff import write_rasters
from firemodel.physics import CrownMethod, crown_fire, rothermel
from firemodel.physics.rothermel import FT_MIN_PER_M_S, KW_M_PER_BTU_FT_S, M_PER_FT
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.crown_spread import WIND_B, WIND_C, crowning_wind_of, with_crowns
from firemodel.spread.crown_winds import crown_winds_of, crowning_wind, torching_wind
from firemodel.spread.local_spread import (
    CROWN,
    HEAT,
    Tables,
    Terrain,
    crowned_head,
    surface_head,
    tables_of,
    terrain_of,
)
from firemodel.spread.rate_options import RateOptions
from firemodel.spread.schemes import SchemeName, new_fire
from tests.firemodel.grids import landscape, steady, weather, write_raster
from tests.firemodel.shared import shared_file

METHODS: tuple[CrownMethod, ...] = ("rothermel", "scott_reinhardt", "cruz")


def forest(
    fuel: int = 10,
    shape: tuple[int, int] = (41, 41),
    height_m: float = 20.0,
    base_m: float = 1.0,
    density_kg_m3: float = 0.15,
    cover: float = 0.1,
) -> Landscape:
    """Return flat ground with the same trees in all cells."""

    def layer(value: float) -> NDArray[np.float32]:
        return np.full(shape, value, dtype=np.float32)

    return replace(
        landscape(fuel, shape=shape),
        canopy_cover=layer(cover),
        canopy_height_m=layer(height_m),
        canopy_base_m=layer(base_m),
        canopy_bulk_density_kg_m3=layer(density_kg_m3),
    )


def head(
    land: Landscape, entry: Weather, method: CrownMethod, foliar_pct: float = 100.0
) -> tuple[float, float, float, float, float]:
    """Return rate, direction (north, east), eccentricity and crown fraction in the first cell."""
    options = RateOptions(crown=method, foliar_moisture_pct=foliar_pct)
    found: tuple[float, float, float, float, float] = crowned_head(
        0, 0, terrain_of(land, [entry], options), tables_of(land, [entry], options)
    )
    return found


def test_critical_intensity_is_van_wagners() -> None:
    # Scott & Reinhardt 2001, table 3: base height 2 m and foliar moisture 100 %: 477 kW/m.
    assert crown_fire.critical_intensity_kw_m(2.0, 100.0) == pytest.approx(477, abs=1)
    assert crown_fire.critical_intensity_kw_m(0.0, 100.0) == crown_fire.critical_intensity_kw_m(
        0.1, 100.0
    )
    assert crown_fire.critical_intensity_kw_m(1.0, 10.0) == crown_fire.critical_intensity_kw_m(
        1.0, 30.0
    )


def test_an_active_crown_fire_needs_three_kg_a_minute() -> None:
    assert crown_fire.critical_rate_m_s(0.20) * 60.0 == pytest.approx(15.0)


def test_crowning_wind_gives_the_critical_rate() -> None:
    still_m_s, critical_m_s = 0.02, crown_fire.critical_rate_m_s(0.15)
    wind_m_s = crown_fire.crowning_wind_m_s(critical_m_s, still_m_s, WIND_B, WIND_C)
    rate_m_s = crown_fire.rothermel_rate_m_s(still_m_s, WIND_B, WIND_C, wind_m_s)
    assert rate_m_s == pytest.approx(critical_m_s)
    assert crown_fire.crowning_wind_m_s(0.01, still_m_s, WIND_B, WIND_C) == 0.0


def test_cruz_active_rate_at_a_hand_computed_point() -> None:
    factor = crown_fire.cruz_still_factor(8.0)
    rate_m_s = crown_fire.cruz_active_rate_m_s(factor, 30.0 / 3.6, 0.2)
    expected_m_min = 11.02 * 30.0**0.90 * 0.2**0.19 * math.exp(-0.17 * 8.0)
    assert rate_m_s * 60.0 == pytest.approx(expected_m_min)
    assert rate_m_s * 60.0 == pytest.approx(44.4, abs=0.1)
    assert crown_fire.cruz_passive_rate_m_s(rate_m_s, rate_m_s) == pytest.approx(rate_m_s / math.e)


def test_thomas_flame_length() -> None:
    # 1000 Btu/ft/s give 20 ft.
    assert crown_fire.crown_flame_length_m(1000.0 * KW_M_PER_BTU_FT_S) == pytest.approx(
        20.0 * M_PER_FT
    )


def test_crown_fraction_rises_from_initiation_to_the_crowning_wind() -> None:
    assert crown_fire.linked_crown_fraction(1.0, 2.0, 4.0) == 0.0
    assert crown_fire.linked_crown_fraction(3.0, 2.0, 4.0) == pytest.approx(0.5)
    assert crown_fire.linked_crown_fraction(9.0, 2.0, 4.0) == 1.0
    assert crown_fire.linked_crown_fraction(3.0, 4.0, 2.0) == 0.0
    # Van Wagner 1993: 0.9 at 10 m/min above the initiation.
    assert crown_fire.excess_crown_fraction(11.0 / 60, 1.0 / 60) == pytest.approx(0.9, abs=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_crowns_do_not_burn_below_the_critical_intensity(method: CrownMethod) -> None:
    high = forest(8, base_m=15.0)
    assert head(high, weather(3.0, 270.0), method) == (
        *head(high, weather(3.0, 270.0), "none")[:4],
        0.0,
    )


def test_the_linked_fire_speeds_up_with_the_wind_without_jumps() -> None:
    """By Scott & Reinhardt, the rate at the crowning wind is that of the active crown fire."""
    land, winds = forest(), np.arange(0.0, 25.0, 0.02)
    found = np.array([head(land, weather(w, 270.0), "scott_reinhardt") for w in winds])
    rates, fractions = found[:, 0], found[:, 4]
    assert (np.diff(rates) >= 0.0).all()
    assert np.diff(rates).max() < 0.02 * rates.max()
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    surface = np.array([head(land, weather(w, 270.0), "none")[0] for w in winds])
    assert rates[-1] > 3.0 * surface[-1]


def test_torching_crowns_do_not_speed_up_rothermels_fire() -> None:
    land, entry = forest(density_kg_m3=0.02), weather(8.0, 270.0)
    by_rothermel, surface = head(land, entry, "rothermel"), head(land, entry, "none")
    assert by_rothermel[:4] == surface[:4]
    assert by_rothermel[4] == 1.0


def test_a_surface_fire_faster_than_its_crown_fire_moves_the_front() -> None:
    """Grass under trees in a gale: the front has the rate of the faster fire."""
    grass, entry = forest(3, cover=0.0), weather(20.0, 270.0)
    assert head(grass, entry, "rothermel")[0] == head(grass, entry, "none")[0]
    assert head(grass, entry, "rothermel")[4] == 1.0


def test_moist_needles_prevent_crown_fire() -> None:
    land, entry = forest(base_m=2.5), weather(6.0, 270.0)
    assert head(land, entry, "rothermel", 80.0)[4] == 1.0
    assert head(land, entry, "rothermel", 300.0)[4] == 0.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scheme", ["anyangle", "devs8"])
def test_a_fire_crowns_in_trees_only(method: CrownMethod, scheme: SchemeName) -> None:
    """Behind a line without trees the same fire is a surface fire."""
    land = forest(shape=(21, 81))
    density = land.canopy_bulk_density_kg_m3
    assert density is not None
    density[:, 40:] = 0.0
    times, fractions = {}, {}
    for crown in ("none", method):
        fire = new_fire(scheme, land, steady(12.0, 270.0), [(10, 3, 0.0)], crown=crown)
        fire.advance(30_000.0)
        times[crown] = fire.arrival_time_s[10]
        fractions[crown] = behaviour_of(fire).crown_fraction[10]
    assert (fractions["none"] == 0.0).all()
    assert (fractions[method][10:40] > 0.0).all()
    assert (fractions[method][40:] == 0.0).all()
    in_trees = np.diff(times["none"][[15, 35]]) / np.diff(times[method][[15, 35]])
    beyond = np.diff(times["none"][[50, 70]]) / np.diff(times[method][[50, 70]])
    assert in_trees > 1.5
    assert beyond == pytest.approx(1.0, abs=0.02)


def test_intensity_and_flame_length_include_the_canopy() -> None:
    land, entry = forest(), weather(12.0, 270.0)
    fire = new_fire("anyangle", land, WeatherStream([entry]), [(20, 5, 0.0)], crown="rothermel")
    fire.advance(900.0)
    found = behaviour_of(fire)
    rate_m_s, fraction = found.spread_rate_m_s[20, 15], found.crown_fraction[20, 15]
    bed = rothermel.fuel_bed(firemodel.FUEL_MODELS[10], entry.moisture)
    surface_kw_m = float(rothermel.fireline_intensity_kw_m(bed, float(rate_m_s)))
    canopy_kw_m = float(rate_m_s) * 0.15 * 19.0 * crown_fire.LOW_HEAT_KJ_KG
    assert fraction == 1.0
    assert found.intensity_kw_m[20, 15] == pytest.approx(surface_kw_m + canopy_kw_m, rel=1e-5)
    flame_ft = 0.2 * (found.intensity_kw_m[20, 15] / KW_M_PER_BTU_FT_S) ** (2 / 3)
    assert found.flame_length_m[20, 15] == pytest.approx(flame_ft * M_PER_FT, rel=1e-5)


def test_a_landscape_without_canopy_layers_is_refused() -> None:
    with pytest.raises(FireModelError, match="crown fire: the landscape lacks canopy_height and"):
        firemodel.burn(landscape(10), steady(), crown="cruz")
    bare = replace(forest(), canopy_bulk_density_kg_m3=None)
    with pytest.raises(FireModelError, match="lacks canopy_bulk_density; add what is missing"):
        firemodel.burn(bare, steady(), crown="cruz")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("wind_from_deg", [270.0, 130.0])
def test_crowns_ignite_and_carry_fire_from_the_indices_on(
    method: CrownMethod, wind_from_deg: float
) -> None:
    """Just below the torching index crowns do not burn, just above it they do; on a slope too."""
    land = forest(base_m=1.0, shape=(20, 20), density_kg_m3=0.1)
    land = replace(land, gradient=np.full((2, 20, 20), 0.1, np.float32))
    fire = new_fire("anyangle", land, steady(4.0, wind_from_deg), [], crown=method)
    torching_m_s, crowning_m_s = (float(wind[3, 3]) for wind in crown_winds_of(fire))

    def at(wind_m_s: float) -> tuple[float, float, float, float, float]:
        return head(land, weather(wind_m_s, wind_from_deg), method)

    assert 1.0 < torching_m_s < crowning_m_s < 40.0
    assert at(0.9999 * torching_m_s)[4] == 0.0
    assert at(1.0001 * torching_m_s)[4] > 0.0
    critical_m_s = crown_fire.critical_rate_m_s(0.1)
    if method != "scott_reinhardt":  # the rates jump at the crowning index
        assert at(1.0001 * crowning_m_s)[0] == pytest.approx(critical_m_s, rel=1e-3)
        assert at(0.9999 * crowning_m_s)[0] < 0.6 * critical_m_s
    elif wind_from_deg == 270.0:
        assert at(1.0001 * crowning_m_s)[4] == 1.0
        assert 0.9 < at(0.999 * crowning_m_s)[4] < 1.0


def test_the_torching_index_by_hand() -> None:
    # φ = 3 is needed: w = 3, or 2 with an upslope of 1, or sqrt(8) with a slope across the wind.
    inputs = {
        "initiation_m_s": 0.4,
        "still_rate_m_s": 0.1,
        "wind_b": 2.0,
        "wind_c": 0.5,
        "adjustment": 0.4,
    }
    for by_slope, cos_upslope, by_wind in ((0.0, 0.0, 3.0), (1.0, 1.0, 2.0), (1.0, 0.0, 8**0.5)):
        wind_m_s = crown_fire.torching_wind_m_s(
            **inputs, by_slope=by_slope, cos_upslope=cos_upslope
        )
        assert wind_m_s == pytest.approx(math.sqrt(by_wind / 0.5) / 0.4)
    calm = inputs | {"initiation_m_s": 0.15}
    assert crown_fire.torching_wind_m_s(**calm, by_slope=0.5, cos_upslope=-1.0) == 0.0
    never = inputs | {"still_rate_m_s": 0.0}
    assert crown_fire.torching_wind_m_s(**never, by_slope=0.5, cos_upslope=1.0) == math.inf


def test_cells_without_crowns_have_no_indices_and_the_driest_hour_counts() -> None:
    land = forest(base_m=3.0)
    assert land.canopy_bulk_density_kg_m3 is not None
    land.canopy_bulk_density_kg_m3[:, 20:] = 0.0
    land.fuel_model[0] = 99
    dry = replace(weather(4.0, 270.0), at_s=3600.0, dead_1h_pct=3.0, dead_10h_pct=4.0)
    stream = WeatherStream([weather(4.0, 270.0), dry])
    found = []
    for duration_s in (1800.0, 7200.0):
        fire = new_fire("anyangle", land, stream, [], crown="rothermel")
        fire.advance(duration_s)
        found.append(crown_winds_of(fire))
    for index in range(2):
        assert np.isinf(found[0][index][:, 20:]).all()
        assert np.isinf(found[0][index][0]).all()
        assert (found[1][index][1:, :20] < found[0][index][1:, :20]).all()


def inputs_of(row: dict[str, str], method: CrownMethod) -> tuple[Terrain, Tables, float]:
    """Return one cell with the inputs of a row of reference values, and its wind at 20 ft."""

    def number(name: str) -> float:
        return float(row[name] or 0.0)

    def layer(value: float) -> NDArray[np.float32]:
        return np.full((1, 1), value, dtype=np.float32)

    wind_m_s = number("out_wind_20ft_ft_min") / FT_MIN_PER_M_S
    aspect_deg, from_deg = number("aspect_deg"), number("wind_direction_deg")
    if row["wind_orientation"] == "relative_to_upslope":
        aspect_deg, from_deg = 180.0, from_deg + 180.0
    slope, up = math.tan(math.radians(number("slope_deg"))), math.radians(aspect_deg + 180.0)
    gradient = np.float32(slope) * np.array([layer(math.cos(up)), layer(math.sin(up))])
    land = Landscape(
        "EPSG:32616",
        5e5,
        4e6,
        30.0,
        np.full((1, 1), int(row["fuel_model_number"]), dtype=np.int16),
        None,
        gradient,
        layer(number("canopy_cover_frac")),
        layer(number("canopy_height_ft") * M_PER_FT),
        layer(number("canopy_base_height_ft") * M_PER_FT),
        layer(number("canopy_bulk_density_lb_ft3") * crown_fire.KG_M3_PER_LB_FT3),
    )
    classes = ("1h", "10h", "100h", "live_herb", "live_woody")
    entry = Weather(0.0, wind_m_s, 0.0, *(number(f"moisture_{name}_pct") for name in classes))
    options = RateOptions(crown=method, foliar_moisture_pct=number("moisture_foliar_pct"))
    toward = math.radians(from_deg + 180.0)
    factor = number("out_waf") or number("user_waf")
    terrain = terrain_of(land, [entry], options)._replace(midflame=np.array([factor]))
    tables = tables_of(land, [entry], options)._replace(
        wind=np.array([[wind_m_s, math.cos(toward), math.sin(toward)]])
    )
    return terrain, tables, wind_m_s


def test_every_reference_row_of_behave_is_reproduced() -> None:
    """The head's rate, crown fraction and intensity of 100 rows, in feet, minutes and Btu."""
    with shared_file("fire_reference/crown_reference.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 100
    indices = 0
    for row in rows:
        for method, name in (("rothermel", "roth"), ("scott_reinhardt", "sr")):
            terrain, tables, wind_m_s = inputs_of(row, method)  # type: ignore[arg-type]
            toward = tuple(tables.wind[0, 1:])
            surface_m_s = surface_head(0, 0, (wind_m_s, *toward), terrain, tables)[0]
            heat, factor = tables.terms[0, 0, HEAT], tables.terms[0, 0, CROWN]
            critical_kw_m = float(terrain.canopy.critical_kw_m[0])
            density = float(terrain.canopy.density_kg_m3[0])
            wind_full_m_s = crowning_wind_of(factor, density)
            full_m_s = surface_head(0, 0, (wind_full_m_s, *toward), terrain, tables)[0]
            crowns = surface_m_s * heat >= critical_kw_m
            rate_m_s, fraction, active = surface_m_s, 0.0, False
            if crowns:
                rate_m_s, fraction, active = with_crowns(
                    tables.crown_method,
                    surface_m_s,
                    critical_kw_m / heat,
                    full_m_s,
                    factor,
                    wind_m_s,
                    density,
                )
            kind = row[f"{name}_fire_type"]
            assert crowns == (kind in ("torching", "crowning")), row["case_id"]
            assert active == (kind == "crowning"), row["case_id"]
            final_btu = rate_m_s * (heat + fraction * terrain.canopy.heat_kj_m2[0])
            expected = {
                "out_surface_ros_ft_min": surface_m_s * FT_MIN_PER_M_S,
                f"{name}_final_ros_ft_min": rate_m_s * FT_MIN_PER_M_S,
                "out_critical_surface_fli_btu_ft_s": critical_kw_m / KW_M_PER_BTU_FT_S,
                "sr_crowning_wind_20ft_ft_min": wind_full_m_s * FT_MIN_PER_M_S,
                "out_crown_length_to_width": crown_fire.crown_length_to_width(wind_m_s),
            }
            # The intensity of Rothermel's torching fire is that of the active fire in `behave`.
            if (name, kind) != ("roth", "torching"):
                expected[f"{name}_final_fli_btu_ft_s"] = final_btu / KW_M_PER_BTU_FT_S
                flame = crown_fire.crown_flame_length_m if crowns else rothermel.flame_length_m
                expected[f"{name}_final_flame_length_ft"] = float(flame(final_btu)) / M_PER_FT
            if kind == "torching" and name == "sr":
                expected["sr_crown_fraction_burned"] = fraction
            torching_m_s = torching_wind(0, 0, terrain, tables)
            if name == "sr" and torching_m_s < 500.0 * rothermel.M_S_PER_MPH:
                expected["derived_torching_wind_20ft_mph"] = torching_m_s / rothermel.M_S_PER_MPH
            assert crowning_wind(0, 0, terrain, tables) == wind_full_m_s
            indices += "derived_torching_wind_20ft_mph" in expected
            for column, value in expected.items():
                if row[column]:
                    reference = pytest.approx(float(row[column]), rel=1e-6, abs=1e-6)
                    assert value == reference, (row["case_id"], method, column)
    assert indices == sum(1 for row in rows if row["derived_torching_wind_20ft_mph"])


def test_bulk_density_is_read_in_landfires_unit(tmp_path: Path) -> None:
    names = ("fuel", "elevation", "LC22_CC_230", "LC22_CH_230", "LC22_CBH_230", "LC22_CBD_230")
    values = (10, 100, 60, 180, 5, 14)
    bands = np.stack([np.full((20, 20), value, dtype=np.int16) for value in values])
    land = read_landscape(write_raster(tmp_path / "stack.tif", bands, names))
    assert land.canopy_bulk_density_kg_m3 is not None
    assert land.canopy_bulk_density_kg_m3[0, 0] == pytest.approx(0.14)
    bands[5] = 250
    with pytest.raises(FireModelError, match="canopy_bulk_density is 250"):
        read_landscape(write_raster(tmp_path / "dense.tif", bands, names))


def test_the_digest_of_a_landscape_includes_the_bulk_density() -> None:
    assert forest(density_kg_m3=0.1).digest() != forest(density_kg_m3=0.2).digest()


def test_rasters_include_the_crown_fraction_if_crowns_are_computed(tmp_path: Path) -> None:
    for crown in ("none", "cruz"):
        fire = new_fire("anyangle", forest(), steady(9.0, 270.0), [(20, 20, 0.0)], crown=crown)
        fire.advance(600.0)
        paths = write_rasters(tmp_path, fire)
        added = {"crown_fraction", "torching_wind_m_s", "crowning_wind_m_s"}
        assert added & paths.keys() == (added if crown == "cruz" else set())
    with rasterio.open(paths["crown_fraction"]) as file:
        written = file.read(1)
    assert written[20, 20] == pytest.approx(behaviour_of(fire).crown_fraction[20, 20])
    assert written[0, 0] == -1.0
    with rasterio.open(paths["torching_wind_m_s"]) as file:
        assert (file.read(1) == crown_winds_of(fire).torching_m_s).all()
        assert file.units == ("m s-1",)


def test_members_of_an_ensemble_crown_like_their_fire() -> None:
    fire = new_fire("anyangle", forest(), steady(9.0, 270.0), [(20, 10, 0.0)], crown="cruz")
    start = Start(fire)
    draw = latin_draws(Uncertainty(*[0.0] * len(fields(Uncertainty))), 1, 1, start.fuels)[0]
    member = start.member(draw, np.random.default_rng(0))
    member.advance(600.0)
    fire.advance(600.0)
    assert np.array_equal(member.burned(), fire.burned())
    window = start.window(member, draw)
    here = (slice(window.top, None), slice(window.left, None))
    expected = behaviour_of(fire).flame_length_m[here][: window.flame_m.shape[0]]
    burned = np.isfinite(window.flame_m)
    assert burned.sum() > 10
    assert window.flame_m[burned] == pytest.approx(
        expected[:, : window.flame_m.shape[1]][burned], rel=1e-5
    )


@pytest.mark.parametrize("scheme", ["anyangle", "devs8"])
@pytest.mark.parametrize("crown", METHODS)
@pytest.mark.parametrize("factor", [0.7, 1.35])
def test_a_member_with_other_moisture_burns_as_in_weather_with_this_moisture(
    scheme: SchemeName, crown: CrownMethod, factor: float
) -> None:
    """Grass responds to its moisture differently from the fuel below crowns."""
    lit = [(20, 5, 0.0)]
    stream = steady(9.0, 270.0)
    wetter = WeatherStream([stream.entries[0].with_dead_moisture(factor)])
    expected = new_fire(scheme, forest(1), wetter, lit, crown=crown)
    start = Start(new_fire(scheme, forest(1), stream, [], crown=crown), lit)
    draw = latin_draws(Uncertainty(*[0.0] * len(fields(Uncertainty))), 1, 1, start.fuels)[0]
    draw = draw._replace(moisture_factor=factor)
    member = start.member(draw, np.random.default_rng(0))
    for each in (member, expected):
        each.advance(1200.0)
    burned = expected.burned()
    assert burned.sum() > 50
    assert np.array_equal(member.burned(), burned)
    np.testing.assert_allclose(
        member.arrival_time_s[burned], expected.arrival_time_s[burned], rtol=1e-6, atol=1e-6
    )
    window = start.window(member, draw)
    rows, cols = window.flame_m.shape
    here = (slice(window.top, window.top + rows), slice(window.left, window.left + cols))
    flames = behaviour_of(expected).flame_length_m[here]
    np.testing.assert_allclose(window.flame_m, flames, rtol=1e-4)
