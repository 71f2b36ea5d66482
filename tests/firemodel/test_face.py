"""``import firemodel``: the names that a notebook uses, which are imported at their first use."""

import doctest
import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import firemodel
from firemodel import simulate
from firemodel.errors import FireModelError
from tests.firemodel.grids import landscape, steady

FUNCTIONS = [name for name in firemodel.__all__ if inspect.isfunction(getattr(firemodel, name))]


def test_the_example_of_burn_gives_the_documented_output() -> None:
    found = doctest.testmod(simulate)
    assert found.attempted >= 4
    assert found.failed == 0


def test_all_names_are_there_and_no_others() -> None:
    assert sorted(firemodel.__all__) == sorted(firemodel._MODULES)
    assert set(firemodel.__all__) <= set(dir(firemodel))
    with pytest.raises(AttributeError, match="'firemodel' has no attribute 'flames'"):
        _ = firemodel.flames


def test_the_import_takes_no_library() -> None:
    code = "import firemodel, sys; print([n for n in ('numpy', 'numba') if n in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_function_is_documented(name: str) -> None:
    function = getattr(firemodel, name)
    text = inspect.getdoc(function) or ""
    assert "Args:" in text
    assert ("Returns:" in text) == (inspect.signature(function).return_annotation is not None)
    for parameter in inspect.signature(function).parameters:
        assert f"\n    {parameter}: " in text, parameter


def test_a_burn_of_one_s_own_landscape_weather_and_file(tmp_path: Path) -> None:
    land = landscape()
    lat, lon = land.lat_lon_of(*land.xy_of(10, 12))
    point = {"type": "Point", "coordinates": [float(lon), float(lat)]}
    path = tmp_path / "lit.geojson"
    path.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": point}))
    weather = steady()
    by_place = firemodel.burn(land, weather, [(float(lat), float(lon))], duration_s=1800.0)
    by_file = firemodel.burn(land, weather.weather_at(0.0), path, duration_s=1800.0)
    assert by_place.arrival_time_s[10, 12] == 0.0
    assert by_place.burned_ha > 0.1
    assert np.array_equal(by_place.arrival_time_s, by_file.arrival_time_s)
    middle = firemodel.burn(land, duration_s=60.0, scheme="devs8", wind_limit=True)
    assert np.argwhere(middle.arrival_time_s == 0.0).tolist() == [[20, 20]]


def test_an_ignition_off_the_landscape_is_refused() -> None:
    with pytest.raises(firemodel.FireModelError, match=r"lat 0\.0, lon 0\.0 lies outside"):
        firemodel.burn(landscape(), ignitions=[(0.0, 0.0)])


def test_a_scheme_by_chance_takes_its_settings() -> None:
    fires = [
        firemodel.burn(
            landscape(),
            duration_s=1800.0,
            scheme="probabilistic",
            p_spread=0.1,
            update_s=60.0,
            seed=seed,
        )
        for seed in (1, 1, 2)
    ]
    one, same, other = (fire.arrival_time_s for fire in fires)
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_a_scheme_by_chance_has_default_settings() -> None:
    fire = firemodel.burn(landscape(), duration_s=1800.0, scheme="probabilistic")
    given = firemodel.burn(
        landscape(), duration_s=1800.0, scheme="probabilistic", p_spread=0.025, update_s=60.0
    )
    assert np.array_equal(fire.arrival_time_s, given.arrival_time_s)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scheme": "zigzag"}, "scheme = 'zigzag': must be one of anyangle, devs8, probabilistic"),
        ({"ignitions": (36.364, -84.141)}, r"ignitions = .*: must be one or more \(latitude"),
        ({"ignitions": [("a", "b")]}, "ignitions = .*: must be one or more"),
        ({"ignitions": [(36.364, -84.141, 0.0)]}, "ignitions = .*: must be one or more"),
        ({"ignitions": []}, "ignitions = .*: must be one or more"),
        ({"duration_s": "x"}, "duration_s = 'x': must be a number of seconds"),
        ({"weather": []}, r"weather = \[\]: must be a Weather"),
        ({"landscape": 5}, "landscape = 5: must be a Landscape"),
        (
            {"wind": 3.0},
            "wind: scheme anyangle has no such setting; it has wind_limit, precise, crown,",
        ),
    ],
)
def test_the_error_of_burn_gives_the_argument_and_the_remedy(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(FireModelError, match=message) as caught:
        firemodel.burn(**{"duration_s": 60.0, **arguments})
    assert "\n" not in str(caught.value)
