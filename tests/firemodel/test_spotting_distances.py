"""Spotting distances and probabilities of ignition: `behave`, and limits that follow from them."""

import csv

import pytest

from firemodel.physics.rothermel import M_PER_FT, M_S_PER_MPH
from firemodel.physics.spotting import (
    CM_PER_IN,
    M_PER_MI,
    SPECIES,
    cover_height_ft,
    crown_distance_m,
    firebrand_ignition_probability,
    flat_distance_m,
    fuel_temperature_c,
    lightning_ignition_probability,
    mountain_distance_m,
    pile_firebrand_height_m,
    surface_distance_m,
    torching_trees,
)
from tests.firemodel.shared import shared_file

Row = dict[str, str]


def rows_of(name: str) -> list[Row]:
    with shared_file(f"fire_reference/{name}").open() as file:
        return list(csv.DictReader(file))


def flat_m(row: Row) -> float:
    """Return the distance over flat ground of a row of the reference."""

    def number(name: str) -> float:
        return float(row[name] or 0.0)

    wind_m_s = number("wind_20ft_mph") * M_S_PER_MPH
    share = 0.5 if row["downwind_canopy"] == "open" else 1.0
    cover_m = share * number("downwind_cover_height_ft") * M_PER_FT
    tree_m = number("tree_height_ft") * M_PER_FT
    match row["source"]:
        case "torching_trees":
            dbh_m = number("dbh_in") * CM_PER_IN / 100.0
            trees = torching_trees(row["species"], dbh_m, tree_m, number("torching_trees"))
            return flat_distance_m(trees.firebrand_height_m, cover_m, wind_m_s)
        case "burning_pile":
            height_m = pile_firebrand_height_m(number("pile_flame_height_ft") * M_PER_FT)
            return flat_distance_m(height_m, cover_m, wind_m_s)
        case "surface_fire":
            flame_m = number("surface_flame_length_ft") * M_PER_FT
            return surface_distance_m(flame_m, cover_m, wind_m_s)
        case _:
            flame_m = number("crown_flame_length_ft") * M_PER_FT
            intensity = number("crown_fli_kw_m") or (flame_m / 0.0775) ** (1.0 / 0.46)
            return float(crown_distance_m(share * tree_m, intensity, wind_m_s))


def test_distances_are_those_of_behave() -> None:
    rows = rows_of("spotting_reference.csv")
    assert len({row["source"] for row in rows}) == 4
    for row in rows:
        flat = flat_m(row)
        ridge_m = float(row["ridge_to_valley_distance_mi"]) * M_PER_MI
        relief_m = float(row["ridge_to_valley_elevation_ft"]) * M_PER_FT
        over_hills = mountain_distance_m(flat, row["location"], ridge_m, relief_m)
        assert flat / M_PER_FT == pytest.approx(float(row["out_flat_distance_ft"]), rel=1e-6)
        expected = float(row["out_mountain_distance_ft"])
        assert over_hills / M_PER_FT == pytest.approx(expected, rel=1e-6)


def test_probabilities_of_ignition_are_those_of_behave() -> None:
    for row in rows_of("ignition_probability.csv"):
        air_c = (float(row["air_temperature_f"]) - 32.0) / 1.8
        fuel_c = fuel_temperature_c(air_c, float(row["sun_shade_pct"]) / 100.0)
        firebrand = firebrand_ignition_probability(fuel_c, float(row["moisture_1h_pct"]) / 100.0)
        lightning = lightning_ignition_probability(
            row["fuel_bed_type"],
            float(row["moisture_100h_pct"]),
            # `behave` converts the depth from inches to centimetres twice
            float(row["duff_depth_in"]) * CM_PER_IN * CM_PER_IN,
            row["lightning_charge"],
        )
        assert fuel_c == pytest.approx(float(row["out_fuel_temperature_c"]), abs=1e-6)
        assert firebrand == pytest.approx(float(row["out_p_firebrand_frac"]), abs=1e-6)
        assert lightning == pytest.approx(float(row["out_p_lightning_frac"]), abs=1e-6)


def test_firebrands_fly_farther_in_more_wind_from_higher_flames_and_over_lower_trees() -> None:
    near, far = (flat_distance_m(100.0, 15.0, wind) for wind in (5.0, 10.0))
    assert far == pytest.approx(2.0 * near)
    assert flat_distance_m(200.0, 15.0, 5.0) > near
    assert flat_distance_m(100.0, 15.0, 0.0) == 0.0
    assert cover_height_ft(100.0 / M_PER_FT, 0.0) > 0.0  # a minimum height of the cover
    weak, strong = (crown_distance_m(20.0, power, 10.0) for power in (3000.0, 30000.0))
    assert 0.0 < weak < strong < 10_000.0
    assert crown_distance_m(20.0, 900.0, 10.0) == 0.0
    assert surface_distance_m(4.0, 0.0, 8.0) > surface_distance_m(2.0, 0.0, 8.0) > 0.0
    assert surface_distance_m(2.0, 0.0, 0.0) == 0.0


def test_more_and_thicker_trees_lift_firebrands_higher() -> None:
    for species in SPECIES:
        one, ten = (torching_trees(species, 0.4, 20.0, trees) for trees in (1.0, 10.0))
        assert ten.flame_height_m > one.flame_height_m > 0.0
        assert one.firebrand_height_m > 10.0
    assert mountain_distance_m(500.0, "ridge_top", 0.0, 300.0) == 500.0


def test_dry_and_warm_fuel_ignites_more_probably() -> None:
    dry, damp = (firebrand_ignition_probability(30.0, wet) for wet in (0.03, 0.12))
    assert 1.0 > dry > 2.0 * damp > 0.0
    assert firebrand_ignition_probability(60.0, 0.03) > dry
    assert firebrand_ignition_probability(0.0, 1.0) == 0.0
