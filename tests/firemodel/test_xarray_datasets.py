"""Landscapes and fires as datasets of xarray, and back."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray

import firemodel
from firemodel.landscape.landscape import Landscape
from tests.firemodel.grids import landscape, steady


def wooded() -> Landscape:
    """Return a landscape with all layers, which differ in each cell."""
    base = firemodel.jacksboro()
    rng = np.random.default_rng(3)

    def layer(most: float) -> "np.ndarray[tuple[int, ...], np.dtype[np.float32]]":
        return (most * rng.random(base.shape)).astype(np.float32)

    return replace(
        base,
        canopy_cover=layer(1.0),
        canopy_height_m=layer(30.0),
        canopy_base_m=layer(5.0),
        canopy_bulk_density_kg_m3=layer(0.3),
    )


@pytest.mark.parametrize("land", [wooded(), landscape(), firemodel.jacksboro()])
def test_a_landscape_comes_back_equal(land: Landscape) -> None:
    back = firemodel.from_xarray(firemodel.to_xarray(land))
    assert back.digest() == land.digest()
    assert back.shape == land.shape


def test_a_landscape_comes_back_equal_from_a_file(tmp_path: Path) -> None:
    land = wooded()
    firemodel.to_xarray(land).to_netcdf(tmp_path / "land.nc")
    with xarray.open_dataset(tmp_path / "land.nc") as read:
        assert firemodel.from_xarray(read.load()).digest() == land.digest()


def test_the_order_of_axes_and_dimensions_does_not_matter() -> None:
    land = wooded()
    dataset = firemodel.to_xarray(land)
    turned = dataset.isel(y=slice(None, None, -1), x=slice(None, None, -1)).transpose("x", "y")
    assert firemodel.from_xarray(turned).digest() == land.digest()


def test_a_part_has_the_place_of_its_cells() -> None:
    land = firemodel.jacksboro()
    part = firemodel.from_xarray(firemodel.to_xarray(land).isel(y=slice(10, 60), x=slice(20, 90)))
    assert part.shape == (50, 70)
    assert part.xy_of(0, 0) == land.xy_of(10, 20)


def test_a_fire_has_its_arrival_times_and_its_landscape() -> None:
    fire = firemodel.burn(landscape(), steady(), duration_s=1800.0)
    dataset = firemodel.to_xarray(fire)
    burned = fire.burned()
    arrival = dataset["arrival_time"]
    assert arrival.dims == ("y", "x")
    assert arrival.attrs["units"] == "s"
    assert np.array_equal(np.isfinite(arrival.values), burned)
    assert np.array_equal(arrival.values[burned], fire.arrival_time_s[burned])
    x_m, y_m = fire.landscape.xy_of(3, 5)
    assert (dataset["x"][5], dataset["y"][3]) == (x_m, y_m)


def test_a_change_of_the_dataset_does_not_change_the_landscape() -> None:
    land = landscape()
    before = land.digest()
    dataset = firemodel.to_xarray(land)
    for name in ("fuel_model", "elevation", "gradient_north"):
        dataset[name].values[:] = 1
    assert land.digest() == before


def test_another_fuel_changes_the_fire() -> None:
    dataset = firemodel.to_xarray(landscape())
    west = dataset["x"] < dataset["x"].mean()
    water = dataset.assign(fuel_model=dataset["fuel_model"].where(~west, 98).astype("int16"))
    fire = firemodel.burn(firemodel.from_xarray(water), steady(), duration_s=3600.0)
    assert not fire.burned()[:, west.values].any()
    assert fire.burned().any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.drop_vars("fuel_model"), "the dataset lacks fuel_model"),
        (lambda data: data.drop_vars("x"), "the dataset lacks x"),
        (lambda data: data.drop_vars("crs"), "the dataset has no CRS"),
        (lambda data: data.isel(x=[0]), "need at least 2 cells"),
        (lambda data: data.isel(x=[0, 1, 3]), "must be squares of one size"),
        (lambda data: data.assign_coords(x=data["x"] * 2), "must be squares of one size"),
        (lambda data: data.assign(elevation=data["elevation"] + 1e5), "elevation is "),
    ],
)
def test_an_unusable_dataset_is_refused_in_one_line(change: object, message: str) -> None:
    data = change(firemodel.to_xarray(firemodel.jacksboro()))  # type: ignore[operator]
    with pytest.raises(firemodel.FireModelError, match=message) as caught:
        firemodel.from_xarray(data)
    assert "\n" not in str(caught.value)


def test_other_objects_and_custom_fuels_are_refused() -> None:
    with pytest.raises(firemodel.FireModelError, match="ndarray cannot be converted"):
        firemodel.to_xarray(np.zeros(3))  # type: ignore[arg-type]
    custom = replace(landscape(), custom_fuels={300: firemodel.FUEL_MODELS[1]})
    with pytest.raises(firemodel.FireModelError, match="cannot contain custom fuel models"):
        firemodel.to_xarray(custom)


def test_without_xarray_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(firemodel.FireModelError, match=r"mission-service\[export\]"):
        firemodel.to_xarray(landscape())
