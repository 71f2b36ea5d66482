"""``sortie plan``: flight times in the scenario's wind, the table, the sentence, the picture."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mission_service.cli.main import main
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import landscape_of
from mission_service.relief.plan_words import aircraft_line, clock, length, summary
from mission_service.relief.relief_plan import plan_watch
from mission_service.relief.scenario_aircraft import scenario_aircraft
from mission_service.relief.watch import NEVER_S, WatchAircraft
from tests.service.relief_worlds import aircraft, watch

ENDURANCE = ("--set", "vehicles.0.endurance_s=2700")
FLAT = (
    "landscape.source=flat",
    "landscape.lat_deg=36.367",
    "landscape.lon_deg=-84.137",
    "landscape.fuel_model=1",
    "vehicles.0.endurance_s=2700",
    "vehicles.0.climb_m_s=100",
)
PNG = b"\x89PNG\r\n"


def sortie_plan(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["sortie", "plan", *arguments])


def flat(*changes: str, wind_m_s: float = 0.0, from_deg: float = 0.0) -> Scenario:
    """Return the default scenario on flat ground with one constant wind."""
    found = load_scenario("default", (*FLAT, *changes))
    entry = found.weather[0].model_copy(
        update={"wind_speed_m_s": wind_m_s, "wind_from_deg": from_deg}
    )
    return found.model_copy(update={"weather": (entry,)})


def one_aircraft(scenario: Scenario, east_m: float, north_m: float) -> WatchAircraft:
    """Return the aircraft of a scenario for a task at a distance from its home."""
    landscape, section = landscape_of(scenario), scenario.vehicles[0]
    home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    task_m = (home_m[0] + east_m, home_m[1] + north_m)
    return scenario_aircraft(scenario, landscape, task_m, 43200.0, True)[0]


def test_without_wind_the_flights_take_distance_by_airspeed_and_a_turn() -> None:
    found = one_aircraft(flat(), 1200.0, 0.0)
    assert found.out_s == 100  # 12 m/s
    # The way back begins with half a turn of 60 m radius, away from home.
    assert 100 + math.pi * 60 / 12 <= found.back_s <= 100 + math.tau * 60 / 12


def test_a_headwind_lengthens_and_a_tailwind_shortens_the_flight() -> None:
    against = one_aircraft(flat(wind_m_s=4.0, from_deg=0.0), 0.0, 1200.0)
    assert against.out_s == pytest.approx(1200 / 8, abs=1)
    along = one_aircraft(flat(wind_m_s=4.0, from_deg=180.0), 0.0, 1200.0)
    assert along.out_s == pytest.approx(1200 / 16, abs=1)
    assert along.back_s > against.back_s


def test_the_least_favourable_wind_of_the_watch_counts() -> None:
    scenario = flat(wind_m_s=4.0, from_deg=180.0)
    (entry,) = scenario.weather
    later = entry.model_copy(update={"at_s": 10800.0, "wind_from_deg": 0.0})
    turned = scenario.model_copy(update={"weather": (entry, later)})
    both = one_aircraft(turned, 0.0, 1200.0)
    assert both.out_s == one_aircraft(flat(wind_m_s=4.0, from_deg=0.0), 0.0, 1200.0).out_s
    assert both.back_s == one_aircraft(scenario, 0.0, 1200.0).back_s


def test_an_aircraft_that_the_wind_keeps_away_is_not_used() -> None:
    found = one_aircraft(flat(wind_m_s=20.0, from_deg=0.0), 0.0, 1200.0)
    assert found.out_s == NEVER_S
    assert "wind prevents" in aircraft_line(watch(1, 1, 1), found)


def test_copters_climb_before_they_fly_to_the_task() -> None:
    change = ("vehicles.0.kind=copter", "vehicles.0.climb_m_s=3", "vehicles.0.altitude_agl_m=90")
    found = one_aircraft(flat(*change), 1200.0, 0.0)
    assert found.out_s == 30 + 100
    assert (found.landing_s, found.pool) == (74, "battery")  # from 90 m: 80 m fast, 10 m slowly


def test_near_homes_are_one_home_and_far_homes_are_not() -> None:
    team = load_scenario("team", tuple(f"vehicles.{n}.endurance_s=2700" for n in range(4)))
    crew = scenario_aircraft(team, landscape_of(team), (3000.0, 3000.0), 3600.0, False)
    assert [each.home for each in crew] == [0, 0, 1, 1]
    assert [each.pool for each in crew] == ["plane", "plane", "plane", "copter"]


def test_a_vehicle_without_endurance_is_refused_with_the_key() -> None:
    scenario = load_scenario("default")
    with pytest.raises(ScenarioError, match=r"hawk has no endurance_s.*vehicles\.0\.endurance_s"):
        scenario_aircraft(scenario, landscape_of(scenario), (0.0, 0.0), 3600.0, True)


def test_the_sentence_names_lapse_reason_and_remedy() -> None:
    result = sortie_plan("default", "--batteries", "3", *ENDURANCE)
    assert result.exit_code == 0
    *_, last = result.stdout.splitlines()
    assert last.startswith("lapses at 0:38 for ")
    assert "no aircraft ready; " in last
    assert last.endswith("1 more charger and 1 more aircraft like hawk prevent this")


def test_the_sentence_of_a_kept_watch_states_its_period() -> None:
    kept = watch(2, 4, 2)
    words = summary(kept, plan_watch(kept), None)
    assert words == "kept up for 12 h; it repeats every 1 h 20 min and can be kept up for any time"


def test_the_sentence_states_the_number_and_the_total_of_lapses() -> None:
    # 40 min on task and 15 min until the next arrival: lapses from 40, 95 and 150 min on.
    alone = watch(1, 9, 0, duration_s=10800)
    assert summary(alone, plan_watch(alone), None).startswith(
        "lapses at 0:45 for 15 min (3 lapses, 45 min in all): no aircraft ready; "
    )


def test_the_sentence_states_what_follows_after_the_watch() -> None:
    short = watch(2, 12, 0, duration_s=2 * 3600)  # twelve sorties of 40 min
    assert summary(short, plan_watch(short), None) == (
        "kept up for 2 h; if continued, it lapses at 8:05"
    )
    week = watch(2, 300, 0, duration_s=7 * 24 * 3600)
    assert summary(week, plan_watch(week), None) == "kept up for 168 h"


def test_the_sentence_of_a_task_that_is_too_far_names_no_remedy() -> None:
    far = replace(watch(1, 1, 1), aircraft=(aircraft(endurance_s=640),))
    assert summary(far, plan_watch(far), None).startswith("not kept up at all: no aircraft can")


def test_the_table_has_a_line_for_each_sortie_with_its_charge() -> None:
    result = sortie_plan("default", "--batteries", "1", "--hours", "2", *ENDURANCE)
    lines = result.stdout.splitlines()
    assert lines[0].startswith("hawk: 38 min on task, ")
    (row,) = [line for line in lines if line.split()[:1] == ["0:00"]]
    assert row.split()[4:] == ["hawk", "battery", "1", "0:50", "to", "1:50", "(1)"]


def test_json_contains_the_plan_and_the_addition(tmp_path: Path) -> None:
    output = tmp_path / "plan.png"
    arguments = ("--batteries", "3", "--hours", "5", *ENDURANCE, "--json", "-o", str(output))
    result = sortie_plan("default", *arguments)
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert found["addition"]["chargers"] == 1
    assert found["addition"]["aircraft"] == ["hawk"]
    assert found["sorties"][0]["takeoff_s"] == 0
    assert found["charges"][0]["start_s"] == found["sorties"][0]["landing_s"] + 300
    assert found["lapses"][0]["reason"] == "no aircraft ready"
    assert 0.0 < found["coverage"] < 1.0
    assert output.read_bytes().startswith(PNG)


def test_batteries_by_kind_are_not_shared(tmp_path: Path) -> None:
    changes = [f"vehicles.{n}.endurance_s={2700 if n < 3 else 1800}" for n in range(4)]
    sets = [word for change in changes for word in ("--set", change)]
    result = sortie_plan("team", "--batteries", "plane=3, copter=2", "--json", *sets)
    assert result.exit_code == 0
    for each in json.loads(result.stdout)["sorties"]:
        assert each["battery"].split()[0] == ("copter" if each["aircraft"] == "wren" else "plane")
    alone = sortie_plan("team", "--batteries", "plane=3", *sets)
    assert alone.exit_code == 2
    assert "copter=NUMBER,plane=NUMBER" in alone.stderr


def test_a_given_task_replaces_the_position_of_the_fire() -> None:
    near = sortie_plan("default", "--batteries", "2", "--task", "36.3707,-84.1324", *ENDURANCE)
    far = sortie_plan("default", "--batteries", "2", "--task", "36.35,-84.16", *ENDURANCE)
    on_task_min = [int(each.stdout.split()[1]) for each in (near, far)]
    assert on_task_min[0] > on_task_min[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("default",), "Missing option '--batteries'"),
        (("default", "--batteries", "6"), "has no endurance_s"),
        (("nowhere", "--batteries", "6"), "nowhere"),
        (("default", "--batteries", "0"), "from 1 to 500"),
        (("default", "--batteries", "²"), "from 1 to 500"),
        (("default", "--batteries", "plane=1,plane=2"), "a number for each kind"),
        (("default", "--batteries", "=3"), "a number for each kind"),
        (("default", "--batteries", "boat=3"), "a number for each kind"),
        (("default", "--batteries", "copter=3", *ENDURANCE), "plane=NUMBER"),
        (("default", "--batteries", "6", "--hours", "nan"), "from 0.0166667 to 168"),
        (("default", "--batteries", "6", "--hours", "999"), "from 0.0166667 to 168"),
        (("default", "--batteries", "6", "--charge-min", "-1"), "from 0 to 1440"),
        (("default", "--batteries", "6", "--swap-min", "soon"), "not a valid float"),
        (("default", "--batteries", "6", "--on-task", "0"), "--on-task"),
        (("default", "--batteries", "6", "--task", "north"), "LAT,LON"),
        (("default", "--batteries", "6", "--task", "36,nan"), "LAT,LON"),
        (("default", "--batteries", "6", "--task", "10,10"), "outside the landscape"),
        (("default", "--batteries", "6", "-o", "plan.pdf"), ".png"),
        (("default", "--batteries", "6", "-o", "/nowhere/plan.png"), "-o /nowhere/plan.png"),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments: tuple[str, ...], words: str) -> None:
    result = sortie_plan(*arguments)
    assert result.exit_code in (1, 2)
    assert result.stdout == ""
    (error,) = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    assert words in error


def test_times_and_durations_are_in_hours_and_minutes() -> None:
    assert [clock(0), clock(6180), clock(45000)] == ["0:00", "1:43", "12:30"]
    assert [length(40), length(720), length(43200)] == ["40 s", "12 min", "12 h"]
    assert [length(59.7), length(3599)] == ["1 min", "1 h"]


def test_an_aircraft_with_too_little_time_on_task_is_named() -> None:
    short = aircraft(endurance_s=640)
    line = aircraft_line(replace(watch(1, 1, 1), aircraft=(short,)), short)
    assert line == "hawk: not used, too little time on task (5 min there, 5 min back, 0 s to land)"
