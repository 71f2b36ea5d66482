"""Scenario files: an error is one line with file, key and value."""

import re
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import get_args

import pytest
from click.testing import CliRunner

from firemodel.errors import FireModelError
from firemodel.spread.schemes import SCHEMES, SchemeName
from mission_service.cli.main import main
from mission_service.config.fire_sections import FireSection
from mission_service.config.scenario import SHIPPED, load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_check import check

ISLAM_HU = (SHIPPED / "islam-hu.toml").read_text(encoding="utf-8")


def refusal(tmp_path: Path, text: str) -> str:
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((ScenarioError, FireModelError)) as caught:
        check(load_scenario(str(path)))
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message or "ignition" in message
    return message


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_scenario_is_sound(path: Path) -> None:
    assert check(load_scenario(path.stem))["vehicles"]


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        ("seed = 1", "sead = 1", ["sead", "unknown key"]),
        ("alpha = 1.0", "alpha = -1.0", ["planner.alpha", "-1.0"]),
        ("airspeed_m_s = 12", "airspeed_m_s = -12", ["vehicles.0.airspeed_m_s", "-12"]),
        ("wind_speed_m_s = 4", "wind_speed_m_s = -4", ["weather.0.wind_speed_m_s", "-4"]),
        ('rule = "islam_hu_damped"', 'rule = "dampened"', ["planner.rule", "dampened"]),
        ("duration_s = 21600", 'duration_s = "six hours"', ["duration_s", "six hours"]),
        ("duration_s = 21600", "", ["duration_s", "is missing; specify a number, above 0"]),
        ('source = "jacksboro"', 'source = "files"', ["landscape", "requires `file`, or `fuel`"]),
        ('source = "jacksboro"', 'fuel = "no.tif"', ["landscape", 'source = "files"']),
        (
            'source = "jacksboro"',
            'source = "files"\nfuel = "no.tif"\nelevation = "no.tif"',
            ["landscape.fuel", "no such file", "no.tif"],
        ),
        (
            "[[ignition]]\nlat_deg",
            '[[ignition]]\nfile = "x.kml"\nlat_deg',
            ["ignition.0", "either"],
        ),
        ("[[ignition]]\nlat_deg = 36.364232", "[[ignition]]", ["ignition.0", "either"]),
        ('scheme = "devs8"', 'scheme = "huygens"', ["fire.scheme", "huygens"]),
        ('source = "jacksboro"', 'source = "jacksboro"\ncrs = "EPSG:1"', ["`crs` has no effect"]),
        ('name = "islam-hu"', 'name = "a\\nb"', ["name", "one line of printable characters"]),
        ('name = "islam-hu"', 'name = ""', ["name", "1"]),
        ('name = "islam-hu"', f'name = "{101 * "a"}"', ["name", "100"]),
        ("seed = 1", "service.mqtt = {broker = ':1883'}", ["service.mqtt.broker", "HOST:PORT"]),
        ("seed = 1", "service.mqtt = {prefix = 'a/#'}", ["service.mqtt.prefix", "topic prefix"]),
        ('name = "hawk"', 'name = "all"', ["vehicles.0.name", "all vehicles", "another name"]),
        ('source = "jacksboro"', 'barriers = "a.kml"', ["landscape.barriers", "a list"]),
        ("wind_speed_m_s = 4", "wind_speed_m_s = 400", ["weather.0.wind_speed_m_s", "400"]),
        ('scheme = "devs8"', 'arrival = "."', ["fire.arrival", "is a folder, not a file"]),
        ('scheme = "devs8"', 'perimeter = "missing.kml"', ["fire.perimeter", "no such file"]),
        ("seed = 1", 'weather_file = {path = "w.csv"}', ["either weather entries"]),
        ('scheme = "devs8"', "spotting = true", ["fire", "`spotting` requires `crown`"]),
        (
            'scheme = "devs8"',
            'scheme = "probabilistic"\nacceleration = true',
            ["fire", "`acceleration` has no effect"],
        ),
        ("seed = 1", "suppression = [{at_s = 1}]", ["suppression.0", "either `points` or `file`"]),
        (
            "seed = 1",
            "suppression = [{points = [[36.0, -84.0], [36.0, -84.1]], rate_m_h = 0}]",
            ["suppression.0.rate_m_h", "above 0"],
        ),
        ('scheme = "devs8"', "firebrands_per_ha = 1001", ["firebrands_per_ha", "0 to 1000"]),
        ('scheme = "devs8"', "initial_cells = 9", ["fire", 'scheme = "probabilistic"']),
        (
            "airspeed_m_s = 12",
            "min_airspeed_m_s = 30",
            ["vehicles.0", "less than max_airspeed_m_s"],
        ),
        ("[[ignition]]\nlat_deg = 36", "[[ignition]]\nlat_deg = 46", ["outside the landscape"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, before: str, after: str, named: list[str]) -> None:
    assert before in ISLAM_HU
    message = refusal(tmp_path, ISLAM_HU.replace(before, after, 1))
    for words in named:
        assert words in message


def test_two_vehicles_of_one_name_are_refused(tmp_path: Path) -> None:
    vehicle = ISLAM_HU[ISLAM_HU.index("[[vehicles]]") :]
    assert "different names" in refusal(tmp_path, ISLAM_HU + vehicle)


def test_broken_toml_and_missing_files_are_named(tmp_path: Path) -> None:
    assert "not valid TOML" in refusal(tmp_path, "name = ")
    with pytest.raises(ScenarioError, match="no such file"):
        load_scenario("no-such-scenario")


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(ISLAM_HU, encoding="utf-8-sig")
    assert load_scenario(str(path)).name == "islam-hu"


@pytest.mark.parametrize("key", ["ignition.0.lat_deg", "vehicles.0.home_lat_deg"])
def test_config_check_names_the_file_of_a_place_outside_the_landscape(
    tmp_path: Path, key: str
) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(ISLAM_HU, encoding="utf-8")
    done = CliRunner().invoke(main, ["config", "check", str(path), "--set", f"{key}=10.0"])
    assert done.exit_code == 1
    assert re.match(rf"Error: {re.escape(str(path))}: .* outside the landscape\n$", done.output)


def test_config_check_refuses_crown_fire_without_canopy_layers() -> None:
    found = CliRunner().invoke(
        main, ["config", "check", "default", "--set", 'fire.crown="scott_reinhardt"']
    )
    assert found.exit_code == 1
    assert "crown fire: the landscape lacks canopy_height" in found.stderr


def test_times_after_the_end_of_the_run_give_warnings(tmp_path: Path) -> None:
    late = ("--set", "duration_s=3600", "--set", "ignition.0.at_s=4000")
    lines = [
        "Warning: ignition.0: at_s = 4000 is not before duration_s = 3600, so this ignition has "
        "no effect",
        "Warning: deploy_at_s = 3600 is not before duration_s = 3600, so no vehicle takes off",
    ]
    assert (
        CliRunner().invoke(main, ["config", "check", "default", *late]).stderr.splitlines()[:2]
        == lines
    )
    arguments = ["sim", "default", "--out", str(tmp_path), "--set", "duration_s=60"]
    shown = CliRunner().invoke(main, arguments).stderr
    assert "Warning: deploy_at_s = 3600 is not before duration_s = 60" in shown


def test_an_override_changes_one_key() -> None:
    scenario = load_scenario("default", ("planner.alpha=5", "vehicles.0.stack=ardupilot"))
    assert scenario.planner.alpha == 5.0
    assert scenario.vehicles[0].stack == "ardupilot"
    assert load_scenario("default").planner.alpha == 1.0


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (("vehicles.0.kind=copter",), "hawk: .* is for planes"),
        (("vehicles.0.backend=mavsdk", "vehicles.0.link=udpin:127.0.0.1:14551"), "no orbits"),
    ],
)
def test_only_planes_with_our_own_client_fly_in_a_formation(
    overrides: tuple[str, ...], named: str
) -> None:
    with pytest.raises(ScenarioError, match=named):
        load_scenario("default", ("planner.rule=formation", *overrides))


@pytest.mark.parametrize("override", ["planner.alpha", "vehicles.7.name=x", "name.first=x"])
def test_an_override_that_leads_nowhere_is_refused(override: str) -> None:
    with pytest.raises(ScenarioError, match="--set"):
        load_scenario("default", (override,))


def test_each_spread_scheme_takes_its_settings_from_the_scenario() -> None:
    assert get_args(SchemeName) == tuple(SCHEMES)
    for scheme in SCHEMES.values():
        taken = signature(getattr(import_module(scheme.module), scheme.fire)).parameters
        assert set(scheme.arguments) <= set(taken)
        assert set(scheme.settings) <= set(FireSection.model_fields)
        assert scheme.random == ("rng" in taken)
