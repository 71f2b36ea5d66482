"""Custom fuels, moistures and rate factors of single fuels, and codes of other systems."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.readers.fuel_code_systems import advice_on
from firemodel.landscape.readers.fuel_files import (
    read_fuels,
    with_rate_factors,
)
from firemodel.landscape.readers.inputs_files import read_fuel_moistures
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.physics.fuels import FUEL_MODELS, FuelModel
from firemodel.physics.rothermel import Moisture, fuel_bed
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from tests.firemodel.grids import landscape, weather, write_raster

DRY = Moisture(0.05, 0.06, 0.07, 0.60, 0.90)
# Fuel model GS2 (122) under another number, in both units.
ENGLISH = "ENGLISH\n20 MYGS2 0.5 0.5 0 0.6 1 dynamic 2000 1800 1800 1.5 15 8000 8000 my fuel\n"
METRIC = (
    "metric  # units\n\n20, MYGS2, 1.120851, 1.120851, 0, 1.345021, 2.241702, Dynamic, "
    "65.6168, 59.0551, 59.0551, 45.72, 15, 18608000, 18608000\n"
)


def written(folder: Path, text: str, name: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("text", [ENGLISH, METRIC])
def test_a_standard_model_written_as_custom_burns_like_the_standard(
    tmp_path: Path, text: str
) -> None:
    found = read_fuels(written(tmp_path, text, "a.fmd"))[20]
    bed, standard = fuel_bed(found, DRY), fuel_bed(FUEL_MODELS[122], DRY)
    assert found.dynamic
    assert bed.no_wind_rate_ft_min == pytest.approx(standard.no_wind_rate_ft_min, rel=1e-4)
    assert bed.wind_c == pytest.approx(standard.wind_c, rel=1e-4)
    assert bed.reaction_intensity_btu_ft2_min == pytest.approx(
        standard.reaction_intensity_btu_ft2_min, rel=1e-4
    )


def test_an_older_file_has_static_models_and_two_heats(tmp_path: Path) -> None:
    text = "19 2.25 1.5 3.71 0 1 2000 1800 1500 0.6 25 8000 9000\n"
    fuel = read_fuels(written(tmp_path, text, "a.FMD"))[19]
    assert not fuel.dynamic
    assert (fuel.heat_btu_lb, fuel.heat_live_btu_lb) == (8000.0, 9000.0)
    colder = replace(fuel, heat_live_btu_lb=None)
    hot, cold = fuel_bed(fuel, DRY), fuel_bed(colder, DRY)
    assert hot.reaction_intensity_btu_ft2_min > cold.reaction_intensity_btu_ft2_min


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "contains no fuel model"),
        (ENGLISH.replace("20 ", "5 "), "line 2: fuel code 5 is a standard fuel model"),
        (ENGLISH.replace("20 ", "x "), "line 2: fuel code 'x' must be a whole number"),
        (ENGLISH + ENGLISH.split("\n")[1], "line 3: fuel code 20 occurs twice in the file"),
        ("20 1 2 3\n", "line 1: 4 fields; required are number, code, five loads"),
        (ENGLISH.replace("0.6 1 ", "0.6 one "), "line 2: a value is 'one'"),
        (ENGLISH.replace(" 0.5 0.5 0 ", " 0 0 0 "), "loads of dead fuel are 0"),
        (ENGLISH.replace("ENGLISH", "METRIC"), "line 2: fuel model 20: "),
        (METRIC.replace("metric", "english"), "line 3: fuel model 20: "),
    ],
)
def test_bad_models_are_refused_with_their_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FireModelError, match=message) as caught:
        read_fuels(written(tmp_path, text, "a.fmd"))
    assert "\n" not in str(caught.value)


def test_a_fire_burns_custom_fuel_at_its_own_rate_and_moisture(tmp_path: Path) -> None:
    """Code 20 with the values of GS2 burns like GS2; with the factor 0.5 it takes twice as long."""
    custom = read_fuels(written(tmp_path, ENGLISH, "a.fmd"))
    half = with_rate_factors(custom, written(tmp_path, "20 0.5\n98 2\n", "a.adj"))
    entry = weather(4.0)
    wet = replace(entry, of_fuels=((20, Moisture(0.10, 0.10, 0.10, 0.60, 0.90)),))
    standard = landscape(122)

    def arrival_s(fuels: dict[int, FuelModel], given: Weather = entry) -> Floats:
        codes = np.full_like(standard.fuel_model, 20)
        land = replace(standard, fuel_model=codes, custom_fuels=fuels)
        fire = AnyAngleFire(land, WeatherStream([given]), [(20, 20, 0.0)], None)
        fire.advance(3600.0)
        return fire.arrival_time_s

    fire = AnyAngleFire(standard, WeatherStream([entry]), [(20, 20, 0.0)], None)
    fire.advance(3600.0)
    same = arrival_s(custom)
    assert np.allclose(same, fire.arrival_time_s, rtol=1e-9)
    burned = np.isfinite(arrival_s(half))
    assert np.allclose(arrival_s(half)[burned], 2.0 * same[burned], rtol=1e-6)
    assert arrival_s(custom, wet)[23, 20] > 1.1 * same[23, 20]


def test_rate_factors_of_standard_and_unknown_fuels(tmp_path: Path) -> None:
    found = with_rate_factors(FUEL_MODELS, written(tmp_path, "1 0.25  # grass\n", "a.adj"))
    assert found == {1: replace(FUEL_MODELS[1], rate_factor=0.25)}
    with pytest.raises(FireModelError, match=r"a.adj line 1: fuel code 20 is unknown"):
        with_rate_factors(FUEL_MODELS, written(tmp_path, "20 1\n", "a.adj"))
    with pytest.raises(FireModelError, match=r"a.adj line 1: the factor is '-1'"):
        with_rate_factors(FUEL_MODELS, written(tmp_path, "1 -1\n", "a.adj"))


def test_moistures_of_single_fuels_in_percent(tmp_path: Path) -> None:
    found = read_fuel_moistures(written(tmp_path, "0 3 4 6 70 100\n101 2 3 5 60 90 12\n", "a.fms"))
    assert found[0] == Moisture(0.03, 0.04, 0.06, 0.70, 1.00)
    assert found[101].live_woody == 0.9
    for text, message in (
        ("", "contains no moistures"),
        ("0 3 4 6 70\n", "line 1: 5 fields"),
        ("0 3 4 6 70 900\n", "line 1: a moisture is '900'"),
        ("0 3 4 6 70 90\n0 3 4 6 70 90\n", "line 2: fuel code 0 occurs twice in the file"),
    ):
        with pytest.raises(FireModelError, match=message):
            read_fuel_moistures(written(tmp_path, text, "b.fms"))


FBP = (
    "grid_value, export_value, descriptive_name, fuel_type\n1,1,Spruce,C-1\n101,101,none,Non-fuel\n"
)
SPAIN = "grid_value,export_value,descriptive_name,fuel_type\n1,1,grass,FM1\n101,101,grass,GR1\n"


def test_a_lookup_table_beside_the_raster_shows_another_system(tmp_path: Path) -> None:
    """All codes exist in this package, but the table assigns them to other fuels."""
    fuel = write_raster(tmp_path / "fuel.tif", np.full((3, 4), 1, dtype=np.int16))
    dem = write_raster(tmp_path / "dem.tif", np.zeros((3, 4), dtype=np.float32))
    files = {"fuel": fuel, "elevation": dem}
    written(tmp_path, SPAIN, "spain_lookup_table.csv")
    written(tmp_path, "not, a table\n", "other_lookup_table.csv")
    assert (read_landscape(files).fuel_model == 1).all()
    written(tmp_path, FBP, "fbp_lookup_table.csv")
    with pytest.raises(FireModelError, match=r"Canadian FBP, in which code 1 is C-1, not short"):
        read_landscape(files)
    assert (read_landscape(files, fuel_codes={1: 10}).fuel_model == 10).all()


def test_codes_of_other_systems_are_named() -> None:
    for codes, system in (
        ({1, 2, 7, 31, 425, 101}, "Canadian FBP"),
        ({1, 8, 14, 28, 31}, "Kitral"),
        ({214, 222, 237, 99}, "Portuguese"),
        ({112, 311, 324, 512}, "CORINE"),
        ({1111, 1211, 33, 61}, "European"),
        ({3001, 3046}, "Australian"),
    ):
        assert f"the system {system}" in advice_on(codes, FUEL_MODELS)
    assert "custom fuels" in advice_on({1, 101, 55}, FUEL_MODELS)
    assert "landscape.fuel_codes" in advice_on({101, 256}, FUEL_MODELS)


def test_codes_are_replaced_and_0_is_bare_ground(tmp_path: Path) -> None:
    codes = np.array([[0, 256, 1], [101, 20, 99]], dtype=np.int16)
    files = {
        "fuel": write_raster(tmp_path / "fuel.tif", codes),
        "elevation": write_raster(tmp_path / "dem.tif", np.zeros((2, 3), dtype=np.float32)),
    }
    with pytest.raises(FireModelError, match="unknown fuel code 256 at row 0, column 1"):
        read_landscape(files)
    custom = read_fuels(written(tmp_path, ENGLISH, "a.fmd"))
    land = read_landscape(files, fuel_codes={256: 91, 1: 2}, custom_fuels=custom)
    assert land.fuel_model.tolist() == [[99, 91, 2], [101, 20, 99]]
    assert land.fuels[20].name.startswith("MYGS2")
    assert land.digest() != replace(land, custom_fuels=custom | {21: custom[20]}).digest()
    assert read_landscape(files, fuel_codes={0: 8, 256: 91, 20: 1}).fuel_model[0, 0] == 8
