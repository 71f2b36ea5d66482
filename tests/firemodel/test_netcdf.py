"""NetCDF files with the CF conventions."""

from datetime import datetime, timedelta, timezone
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from pyproj import CRS

from firemodel.errors import FireModelError
from firemodel.outputs import netcdf
from firemodel.outputs.netcdf import write_netcdf
from firemodel.spread.behaviour import behaviour_of
from tests.firemodel import grids
from tests.firemodel.test_front_files import TIMES_S, fire_round_a_rock

ZERO = datetime(2026, 8, 1, 12, 0, tzinfo=timezone(timedelta(hours=-7)))
LAYERS = {
    "arrival_time": "seconds since 2026-08-01T19:00:00Z",
    "spread_rate": "m s-1",
    "spread_toward": "degree",
    "flame_length": "m",
    "fireline_intensity": "kW m-1",
}


def test_a_file_has_the_fire_its_grid_and_its_units(tmp_path: Path) -> None:
    fire = fire_round_a_rock()
    write_netcdf(tmp_path / "fire.nc", fire, TIMES_S, "rock", ZERO)
    found = behaviour_of(fire)
    expected = (
        *(fire.arrival_time_s, found.spread_rate_m_s, found.toward_deg),
        *(found.flame_length_m, found.intensity_kw_m),
    )
    with netCDF4.Dataset(tmp_path / "fire.nc") as file:
        assert (file.Conventions, file.title) == ("CF-1.8", "rock")
        for (name, unit), values in zip(LAYERS.items(), expected, strict=True):
            variable = file[name]
            assert (variable.dimensions, variable.units) == (("y", "x"), unit)
            assert np.isnan(variable._FillValue)
            assert (variable.grid_mapping, variable.coordinates) == ("crs", "lat lon")
            assert np.array_equal(~np.ma.getmaskarray(variable[:]), fire.burned())
            np.testing.assert_allclose(
                variable[:].compressed(), np.asarray(values)[fire.burned()], rtol=1e-6
            )
        assert CRS.from_cf(file["crs"].__dict__) == CRS(grids.CRS)
        assert np.array_equal(file["fuel_model"][:], fire.landscape.fuel_model)
        assert file["x"][:2].tolist() == [grids.WEST_M + 15.0, grids.WEST_M + 45.0]
        assert file["y"][:2].tolist() == [grids.NORTH_M - 15.0, grids.NORTH_M - 45.0]
        lat_deg, lon_deg = fire.landscape.lat_lon_of(*fire.landscape.xy_of(3, 5))
        assert (file["lat"][3, 5], file["lon"][3, 5]) == pytest.approx((lat_deg, lon_deg))


def test_the_state_over_time_has_calendar_times(tmp_path: Path) -> None:
    fire = fire_round_a_rock()
    write_netcdf(tmp_path / "fire.nc", fire, TIMES_S, "rock", ZERO)
    with netCDF4.Dataset(tmp_path / "fire.nc") as file:
        time = file["time"]
        dates = [str(netCDF4.num2date(each, time.units, time.calendar)) for each in time[:]]
        assert dates == ["2026-08-01 20:00:00", "2026-08-01 21:00:00", "2026-08-01 21:46:40"]
        assert file["state"].flag_meanings == "unburned burning burned cannot_burn"
        for number, time_s in enumerate(TIMES_S):
            assert np.array_equal(file["state"][number], fire.state_at(time_s))
            burned = np.count_nonzero(fire.arrival_time_s <= time_s)
            assert file["burned_area"][number] == burned * 900.0


def test_times_without_a_date_are_elapsed_seconds(tmp_path: Path) -> None:
    write_netcdf(tmp_path / "fire.nc", fire_round_a_rock(), TIMES_S, "rock")
    with netCDF4.Dataset(tmp_path / "fire.nc") as file:
        assert "time" not in file.variables
        assert file["state"].dimensions == ("elapsed", "y", "x")
        for name in ("elapsed", "arrival_time"):
            assert file[name].units == "s"
            assert "no calendar date" in file[name].comment
        assert file["elapsed"][:].tolist() == TIMES_S


@pytest.mark.parametrize("zero", [ZERO, None])
def test_equal_fires_give_equal_bytes(tmp_path: Path, zero: datetime | None) -> None:
    for name in ("a", "b"):
        write_netcdf(tmp_path / name, fire_round_a_rock(), TIMES_S, "rock", zero)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_file_is_whole_or_missing(tmp_path: Path) -> None:
    with pytest.raises(FireModelError, match="not computed yet"):
        write_netcdf(tmp_path / "fire.nc", fire_round_a_rock(), [20_000.0], "rock")
    assert not list(tmp_path.iterdir())
    with pytest.raises(FireModelError, match=r"missing/fire.nc: cannot be written: .*; use"):
        write_netcdf(tmp_path / "missing" / "fire.nc", fire_round_a_rock(), TIMES_S, "rock")


def test_without_its_library_netcdf_gets_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(netcdf, "find_spec", lambda name: None)
    with pytest.raises(FireModelError, match=r"NetCDF needs netCDF4, .* pip install"):
        write_netcdf(tmp_path / "fire.nc", fire_round_a_rock(), TIMES_S, "rock")
