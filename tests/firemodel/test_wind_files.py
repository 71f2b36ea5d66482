"""Grids of wind in files of WindNinja, FARSITE, GeoTIFF, NetCDF and GRIB."""

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import rasterio
import rasterio.shutil
from netCDF4 import Dataset
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.gridded_wind import WindStack, from_grid_north, with_wind_stack
from firemodel.landscape.info import describe
from firemodel.landscape.readers.wind_files import WindFiles, read_wind
from firemodel.physics.rothermel import M_S_PER_MPH
from firemodel.physics.weather import WeatherSource, WeatherStream, wind_20ft_from_10m
from firemodel.physics.wind_field import WindGrids
from tests.firemodel.grids import CELL_M, CRS, NORTH_M, WEST_M, landscape, weather, write_raster

LAND = landscape(shape=(30, 40))
START = datetime(2026, 8, 1, 12, tzinfo=UTC)


def asc(
    path: Path,
    values: NDArray[np.floating] | float,
    *,
    west_m: float = WEST_M - 200.0,
    cell_m: float = 100.0,
    crs: str | None = CRS,
) -> Path:
    """Write an ASCII grid as WindNinja does, a little larger than the landscape."""
    grid = np.broadcast_to(values, (13, 16))
    header = (
        f"ncols 16\nnrows 13\nxllcorner {west_m}\nyllcorner {NORTH_M + 200.0 - 13 * cell_m}\n"
        f"cellsize {cell_m}\nNODATA_value -9999\n"
    )
    rows = "\n".join(" ".join(f"{value:.4f}" for value in row) for row in grid)
    path.write_text(header + rows + "\n", encoding="ascii")
    if crs is not None:
        wkt = pyproj.CRS.from_user_input(crs).to_wkt("WKT1_ESRI")
        path.with_suffix(".prj").write_text(wkt, encoding="ascii")
    return path


def pair(
    folder: Path,
    name: str,
    speed: NDArray[np.floating] | float,
    from_deg: NDArray[np.floating] | float,
    **options: Any,
) -> tuple[Path, Path]:
    """Write a pair of ASCII grids."""
    return (
        asc(folder / f"{name}_vel.asc", speed, **options),
        asc(folder / f"{name}_ang.asc", from_deg, **options),
    )


def read_pair(paths: tuple[Path, Path], **options: Any) -> WindStack:
    given = {"unit": "mph", "height": "20ft", **options}
    return read_wind(WindFiles(pairs=((*paths, None),), **given), LAND)


def toward(stack: WindStack, number: int = 0) -> NDArray[np.complex128]:
    """Return the wind (y, x): north + i east."""
    north, east = stack.grids.toward[number].astype(float)
    return np.asarray(north + 1j * east)


def test_a_pair_of_ascii_grids(tmp_path: Path) -> None:
    stack = read_pair(pair(tmp_path, "west", 20.0, 270.0))
    assert stack.at_s == (0.0,)
    np.testing.assert_allclose(toward(stack), 20.0 * M_S_PER_MPH * 1j, atol=1e-5)


@pytest.mark.parametrize(
    ("unit", "height", "m_s"),
    [
        ("m_s", "20ft", 1.0),
        ("mph", "10m", float(wind_20ft_from_10m(0.44704))),
        ("kmh", "20ft", 1.0 / 3.6),
        ("kts", "20ft", 1852.0 / 3600.0),
    ],
)
def test_units_and_heights(tmp_path: Path, unit: str, height: str, m_s: float) -> None:
    stack = read_pair(pair(tmp_path, "south", 10.0, 180.0), unit=unit, height=height)
    np.testing.assert_allclose(toward(stack), 10.0 * m_s, atol=1e-5)


def test_directions_are_interpolated_as_vectors(tmp_path: Path) -> None:
    """Between 350 and 10 degrees is 0 degrees, not 180; the speed is linear in between."""
    sides = np.where(np.arange(16) < 8, 350.0, 10.0)
    stack = read_pair(pair(tmp_path, "north", 10.0, sides))
    found = toward(stack)
    x_m = WEST_M + (np.arange(40) + 0.5) * CELL_M
    column = int(np.argmin(np.abs(x_m - (WEST_M - 200.0 + 800.0))))  # the border of the sides
    assert abs(found[10, column].imag) < 0.2 * abs(found[10, column].real)
    assert (found.real < 0.0).all()


def test_a_linear_wind_is_reproduced_exactly(tmp_path: Path) -> None:
    east_m_s = 2.0 + np.arange(20)[None, :] * np.ones((15, 1)) * 0.5
    north_m_s = 1.0 + np.arange(15)[:, None] * np.ones((1, 20)) * 0.25
    path = write_raster(
        tmp_path / "uv.tif",
        np.stack([east_m_s, north_m_s]).astype("f4"),
        ("u", "v"),
        transform=rasterio.Affine(100.0, 0.0, WEST_M - 200.0, 0.0, -100.0, NORTH_M + 200.0),
    )
    found = toward(read_wind(WindFiles(path, unit="m_s", height="20ft"), LAND))
    row, col = np.indices(LAND.shape)
    x_cells = (200.0 + (col + 0.5) * CELL_M) / 100.0 - 0.5
    y_cells = (200.0 + (row + 0.5) * CELL_M) / 100.0 - 0.5
    np.testing.assert_allclose(found.imag, 2.0 + 0.5 * x_cells, rtol=1e-6)
    np.testing.assert_allclose(found.real, 1.0 + 0.25 * y_cells, rtol=1e-6)


@pytest.mark.parametrize("north", ["grid", "true"])
def test_vectors_are_turned_to_the_north_of_the_landscape(tmp_path: Path, north: str) -> None:
    """A grid in the next UTM zone; its north differs by 3.5 degrees."""
    x, y = pyproj.Transformer.from_crs(CRS, "EPSG:32615", always_xy=True).transform(WEST_M, NORTH_M)
    path = write_raster(
        tmp_path / "uv.tif",
        np.stack([np.zeros((40, 40)), np.ones((40, 40))]).astype("f4"),
        ("u", "v"),
        crs="EPSG:32615",
        transform=rasterio.Affine(100.0, 0.0, x - 1000.0, 0.0, -100.0, y + 1500.0),
    )
    stack = read_wind(WindFiles(path, unit="m_s", height="20ft", north=north), LAND)  # type: ignore[arg-type]
    lat_deg, lon_deg = LAND.centre_lat_lon
    other = pyproj.Proj("EPSG:32615").get_factors(lon_deg, lat_deg).meridian_convergence
    turn_deg = -LAND.grid_convergence_deg + (other if north == "grid" else 0.0)
    found = toward(stack)
    np.testing.assert_allclose(np.degrees(np.angle(found)), turn_deg, atol=0.02)
    np.testing.assert_allclose(np.abs(found), 1.0, rtol=1e-6)
    assert abs(turn_deg) > 3.0 or north == "true"


ATM = """{first}
{units}
# a comment

8 1 1100 a_vel.asc a_ang.asc
8 1 1300 b_vel.asc b_ang.asc b_cld.asc
8 1 1500 a_vel.asc a_ang.asc
"""


@pytest.mark.parametrize(
    ("units", "m_s"),
    [
        ("", M_S_PER_MPH),
        ("ENGLISH", M_S_PER_MPH),
        ("metric", float(wind_20ft_from_10m(1 / 3.6))),
    ],
)
def test_an_atm_file(tmp_path: Path, units: str, m_s: float) -> None:
    pair(tmp_path, "a", 20.0, 270.0)
    pair(tmp_path, "b", 10.0, 180.0)
    path = tmp_path / "wind.atm"
    path.write_text(ATM.format(first="WINDS", units=units), encoding="ascii")
    stack = read_wind(WindFiles(path), LAND, [START.replace(tzinfo=None)], until_s=3000.0)
    assert stack.at_s == (-3600.0, 3600.0)  # not the third, which is not needed
    np.testing.assert_allclose(toward(stack, 0), 20.0 * m_s * 1j, atol=1e-5)
    np.testing.assert_allclose(toward(stack, 1), 10.0 * m_s, atol=1e-5)
    without_start = read_wind(WindFiles(path), LAND)
    assert without_start.at_s == (0.0, 7200.0, 14400.0)


def test_an_atm_file_is_described(tmp_path: Path) -> None:
    pair(tmp_path, "a", 20.0, 270.0)
    pair(tmp_path, "b", 10.0, 180.0)
    path = tmp_path / "wind.atm"
    path.write_text(ATM.format(first="WINDS_AND_CLOUDS", units="METRIC"), encoding="ascii")
    found = describe(path)
    assert found["details"] == ["3 winds from 08-01 11:00 to 08-01 15:00, in kmh at 10m"]
    (tmp_path / "b_ang.asc").unlink()
    (problem,) = describe(path)["problems"]
    assert problem.endswith("b_ang.asc: no such file")


def test_an_atm_file_over_the_turn_of_the_year(tmp_path: Path) -> None:
    pair(tmp_path, "a", 20.0, 270.0)
    path = tmp_path / "wind.atm"
    lines = "WINDS\n12 31 2300 a_vel.asc a_ang.asc\n1 1 0100 a_vel.asc a_ang.asc\n"
    path.write_text(lines, encoding="ascii")
    assert read_wind(WindFiles(path), LAND).at_s == (0.0, 7200.0)
    for start in (
        datetime.fromisoformat("2027-01-01T00:00"),
        datetime(2026, 12, 31, 23, 30, tzinfo=UTC),
    ):
        stack = read_wind(WindFiles(path), LAND, [start])
        assert stack.at_s in ((-3600.0, 3600.0), (-1800.0, 5400.0))


def test_a_geotiff_with_times(tmp_path: Path) -> None:
    bands = np.stack([np.full((30, 40), each, "f4") for each in (5.0, 90.0, 7.0, 0.0)])
    names = ("speed 0", "direction 0", "speed 3600", "direction 3600")
    path = write_raster(tmp_path / "a.tif", bands, names)
    stack = read_wind(WindFiles(path, unit="m_s", height="20ft"), LAND)
    assert stack.at_s == (0.0, 3600.0)
    np.testing.assert_allclose(toward(stack, 0), -5.0j, atol=1e-5)
    np.testing.assert_allclose(toward(stack, 1), -7.0, atol=1e-5)
    dates = tuple(f"{kind} 2026-08-01T{hour}:00Z" for hour in (12, 14) for kind in ("u", "v"))
    dated = write_raster(tmp_path / "b.tif", bands, dates)
    found = read_wind(WindFiles(dated, unit="m_s", height="20ft"), LAND, [START])
    assert found.at_s == (0.0, 7200.0)
    unnamed = write_raster(tmp_path / "c.tif", bands, ("Wind Speed", "Wind Direction") * 2)
    given = WindFiles(unnamed, at_s=(0.0, 600.0), unit="m_s", height="20ft")
    assert read_wind(given, LAND).at_s == (0.0, 600.0)


def netcdf(path: Path, names: Sequence[str], units: str = "m s-1") -> Path:
    """Write two hours of wind on longitudes from 0 to 360 and ascending latitudes."""
    lat_deg, lon_deg = LAND.centre_lat_lon
    with Dataset(path, "w") as file:
        axes = {
            "time": np.array([0.0, 1.0]),
            "latitude": lat_deg + 0.05 * np.arange(-2, 3),
            "longitude": lon_deg + 360.0 + 0.05 * np.arange(-2, 3),
        }
        for name, values in axes.items():
            file.createDimension(name, len(values))
            axis = file.createVariable(name, "f8", (name,))
            axis.units = {
                "time": "hours since 2026-08-01 12:00:00",
                "latitude": "degrees_north",
                "longitude": "degrees_east",
            }[name]
            axis.standard_name = name
            axis[:] = values
        for number, name in enumerate(names):
            band = file.createVariable(name, "f4", tuple(axes))
            band.units, band.standard_name = units, name
            band[:] = (np.array([3.0, 6.0]) + number)[:, None, None]
    return path


def test_a_netcdf_file(tmp_path: Path) -> None:
    path = netcdf(tmp_path / "wind.nc", ("eastward_wind", "northward_wind"))
    stack = read_wind(WindFiles(path, height="10m"), LAND, [START + timedelta(minutes=30)])
    assert stack.at_s == (-1800.0, 1800.0)
    scale = float(wind_20ft_from_10m(1.0))
    np.testing.assert_allclose(toward(stack, 0), scale * (4.0 + 3.0j), rtol=1e-3)
    np.testing.assert_allclose(toward(stack, 1), scale * (7.0 + 6.0j), rtol=1e-3)


def test_a_grib_file(tmp_path: Path) -> None:
    lat_deg, lon_deg = LAND.centre_lat_lon
    plain = write_raster(
        tmp_path / "wind.tif",
        np.stack([np.full((6, 6), each, "f4") for each in (3.0, 4.0)]),
        crs="EPSG:4326",
        transform=rasterio.Affine(0.05, 0.0, lon_deg - 0.15, 0.0, -0.05, lat_deg + 0.15),
    )
    options = {}
    for band, element in ((1, 2), (2, 3)):
        options[f"BAND_{band}_DISCIPLINE"] = "0"
        options[f"BAND_{band}_IDS"] = (
            "CENTER=7 SUBCENTER=0 MASTER_TABLE=2 LOCAL_TABLE=1 SIGNF_REF_TIME=1 "
            "REF_TIME=2026-08-01T12:00:00Z PROD_STATUS=0 TYPE=1"
        )
        options[f"BAND_{band}_PDS_PDTN"] = "0"
        options[f"BAND_{band}_PDS_TEMPLATE_NUMBERS"] = (
            f"2 {element} 2 0 96 0 0 0 1 0 0 0 1 103 0 0 0 0 10 255 0 0 0 0 0"
        )
    path = tmp_path / "wind.grib2"
    rasterio.shutil.copy(plain, path, driver="GRIB", **options)
    stack = read_wind(WindFiles(path), LAND, [START + timedelta(hours=1)])
    assert stack.at_s == (0.0,)
    scale = float(wind_20ft_from_10m(1.0))
    np.testing.assert_allclose(toward(stack), scale * (4.0 + 3.0j), rtol=1e-3)


def test_longitudes_from_0_to_360(tmp_path: Path) -> None:
    lat_deg, lon_deg = LAND.centre_lat_lon
    west_deg = lon_deg + 360.0 - 0.1
    path = small(
        tmp_path / "a.tif",
        crs="EPSG:4326",
        transform=rasterio.Affine(0.005, 0.0, west_deg, 0.0, -0.005, lat_deg + 0.075),
    )
    found = toward(read_wind(WindFiles(path, unit="m_s", height="20ft"), LAND))
    np.testing.assert_allclose(np.abs(found), 5.0, rtol=1e-6)


def test_calm_air_needs_no_direction(tmp_path: Path) -> None:
    speed = np.where(np.arange(16) < 8, 0.0, 10.0)
    direction = np.where(np.arange(16) < 8, -9999.0, 90.0)
    found = np.abs(toward(read_pair(pair(tmp_path, "a", speed, direction))))
    assert found[0, 0] == 0.0
    assert found[0, -1] > 4.0


def stack_of(*winds: complex) -> WindStack:
    grids = [np.stack([np.full(LAND.shape, part) for part in (w.real, w.imag)]) for w in winds]
    return WindStack(tuple(3600.0 * n for n in range(len(winds))), WindGrids(np.stack(grids)))


def test_winds_are_interpolated_in_time() -> None:
    entries = [weather(1.0, 5.0), replace(weather(2.0, 5.0, 1000.0), dead_1h_pct=3.0)]
    still = WeatherStream(entries, WeatherSource("station.csv", None, (20.0, 10.0)))
    found = with_wind_stack(still, stack_of(10.0, 10.0j), LAND, 900.0)
    times = [entry.at_s for entry in found.entries]
    assert times == [0.0, 900.0, 1000.0, 1800.0, 2700.0, 3600.0]
    assert found.source is not None
    assert found.source.humidity_pct == (20.0, 20.0, 10.0, 10.0, 10.0, 10.0)
    middle = found.weather_at(1800.0)
    assert middle.wind_speed_m_s == pytest.approx(math.hypot(5.0, 5.0))
    assert LAND.grid_deg(middle.wind_from_deg) == pytest.approx(225.0)
    assert found.weather_at(1000.0).dead_1h_pct == 3.0
    assert found.weather_at(1000.0).wind_field == found.weather_at(900.0).wind_field
    assert found.weather_at(9000.0).wind_speed_m_s == pytest.approx(10.0)
    assert middle.wind_field is not None
    np.testing.assert_allclose(middle.wind_field.ratio()[0], 1.0, rtol=1e-6)


def test_grids_a_year_apart_are_refused() -> None:
    apart = stack_of(10.0, 10.0j)._replace(at_s=(-365.0 * 86_400.0, 0.0))
    with pytest.raises(FireModelError, match=r"at most 10,000 winds .*correct the times"):
        with_wind_stack(WeatherStream([weather()]), apart, LAND, 900.0)
    with pytest.raises(FireModelError, match="at most 10,000 winds"):
        with_wind_stack(WeatherStream([weather()]), apart._replace(at_s=(0.0, 1e300)), LAND, 900.0)


def test_a_landscape_whose_north_is_not_true_north() -> None:
    """The mean wind is stated relative to true north, as in other weather."""
    east = replace(LAND, west_m=WEST_M + 200_000.0)
    assert east.grid_convergence_deg > 1.0
    found = with_wind_stack(WeatherStream([weather()]), stack_of(10.0), east, 900.0).entries[0]
    assert found.wind_from_deg == pytest.approx(180.0 + east.grid_convergence_deg)
    from_grid = WeatherStream([replace(weather(), wind_from_deg=359.5)], WeatherSource("a", None))
    turned = from_grid_north(from_grid, east)
    assert turned.source == from_grid.source
    assert turned.entries[0].wind_from_deg == pytest.approx(east.grid_convergence_deg - 0.5)
    assert east.grid_deg(turned.entries[0].wind_from_deg) == pytest.approx(-0.5)


def small(path: Path, **changes: Any) -> Path:
    """Write a GeoTIFF of speed and direction on the landscape's grid."""
    bands = np.stack([np.full((30, 40), 5.0, "f4"), np.full((30, 40), 90.0, "f4")])
    return write_raster(path, bands, changes.pop("names", ("speed", "direction")), **changes)


def test_errors_of_files(tmp_path: Path) -> None:
    def refused(match: str, files: WindFiles, start: datetime = START) -> None:
        with pytest.raises(FireModelError, match=match) as found:
            read_wind(files, LAND, [start])
        assert "\n" not in str(found.value)

    def of(paths: tuple[Path, Path], **options: Any) -> WindFiles:
        return WindFiles(pairs=((*paths, None),), **{"unit": "mph", "height": "20ft", **options})

    good = pair(tmp_path, "good", 20.0, 270.0)
    refused("has no unit; specify", of(good, unit=None))
    refused("has no height; specify", of(good, height=None))
    refused(
        r"value 300.0 at row 0, column 0 .* check the unit", of(pair(tmp_path, "a", 300.0, 0.0))
    )
    refused("must be from 0 to 360 degrees", of(pair(tmp_path, "b", 20.0, 400.0)))
    refused("must be from 0 to 223.7 mph", of(pair(tmp_path, "n", -1.0, 0.0)))
    refused("covers 960 of 1,200 cells", of(pair(tmp_path, "c", 20.0, 0.0, west_m=WEST_M - 750.0)))
    hole = np.full((13, 16), 20.0)
    hole[3:6, 4:7] = -9999.0
    refused("no wind at row 3, column 8 of the landscape", of(pair(tmp_path, "d", hole, 0.0)))
    refused("has no CRS", of(pair(tmp_path, "e", 20.0, 0.0, crs=None)))
    refused("CRS 'EPSG:1' is unknown", of(pair(tmp_path, "e", 20.0, 0.0, crs=None), crs="EPSG:1"))
    refused("differs from EPSG:32617", of(good, crs="EPSG:32617"))
    other = asc(tmp_path / "f.asc", 1.0, cell_m=110.0)
    refused("resample both to one grid", of((good[0], other)))
    refused("has 2 bands; use a file with one", of((good[0], small(tmp_path / "g.tif"))))
    wrong = write_raster(tmp_path / "h.tif", np.full((30, 40), 5.0, "f4"), ("direction",))
    refused("is specified as speed", of((wrong, good[1])))
    refused("no such file", of((tmp_path / "none.asc", good[1])))
    tif = {"unit": "m_s", "height": "20ft"}
    refused("contains no wind bands", WindFiles(small(tmp_path / "i.tif", names=()), **tif))  # type: ignore[arg-type]
    one = small(tmp_path / "j.tif", names=("speed 0", "direction 60"))
    refused("or their times differ", WindFiles(one, **tif))  # type: ignore[arg-type]
    late = small(tmp_path / "k.tif", names=("speed 60", "direction 60"))
    refused("the first wind is at 60 s", WindFiles(late, **tif))  # type: ignore[arg-type]
    refused("contains times; remove at_s", WindFiles(late, at_s=(0.0,), **tif))  # type: ignore[arg-type]
    refused(
        "has 1 winds, but at_s has 2 times", WindFiles(small(tmp_path / "l.tif"), at_s=(0.0, 1.0))
    )
    bad = small(tmp_path / "m.tif", names=("speed noon", "direction noon"))
    refused("'noon' is not a time", WindFiles(bad, **tif))  # type: ignore[arg-type]
    nc = netcdf(tmp_path / "wind.nc", ("eastward_wind", "northward_wind"))
    refused("its unit is m_s, not mph", WindFiles(nc, unit="mph", height="10m"))
    local = START.replace(tzinfo=None)
    refused("one has a UTC offset, the other", WindFiles(nc, height="10m"), local)
    refused("cannot be read as a raster", WindFiles(Path(__file__)))
    turned = small(tmp_path / "n.tif", transform=rasterio.Affine.rotation(10.0))
    refused("is not a georeferenced north-up grid", WindFiles(turned, **tif))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("8 1 1200 a.asc b.asc\n", "does not begin with WINDS"),
        ("WINDS\n", "contains no wind"),
        ("WINDS\n8 1 1200 a.asc\n", "line 2: 4 fields"),
        ("WINDS\n8 1 2560 a.asc b.asc\n", "line 2: '8 1 2560' is not a time"),
        ("WINDS\n8 1 1200 a.asc b.asc\n", "a.asc: no such file"),
    ],
)
def test_errors_of_atm_files(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "wind.atm"
    path.write_text(text, encoding="ascii")
    with pytest.raises(FireModelError, match=match):
        read_wind(WindFiles(path), LAND)


def test_times_with_and_without_utc_offsets(tmp_path: Path) -> None:
    """Local times are those of a start without offset, or else of the zone of another start."""
    paths = pair(tmp_path, "a", 20.0, 270.0)
    naive = datetime(2026, 8, 1, 12)  # noqa: DTZ001
    files = WindFiles(
        pairs=((*paths, naive), (*paths, naive + timedelta(hours=1))), unit="mph", height="20ft"
    )
    assert read_wind(files, LAND, [START]).at_s == (0.0, 3600.0)
    assert read_wind(files, LAND, [START, naive + timedelta(minutes=5)]).at_s == (-300.0, 3300.0)
    mixed = replace(files, pairs=((*paths, START), (*paths, naive)))
    with pytest.raises(FireModelError, match="one has a UTC offset"):
        read_wind(mixed, LAND, [START])
    twice = replace(files, pairs=((*paths, naive), (*paths, naive)))
    with pytest.raises(FireModelError, match="is not later than the previous"):
        read_wind(twice, LAND)
