"""The whole loop in virtual time: fire, camera, planner, missions as MAVLink frames, journal."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from autopilot_bridge.missions.check import adapted, check
from autopilot_bridge.missions.read_back import as_read_back, same_as_sent
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.spread.fire_scheme import Fire
from mission_service.commands import UploadMission
from mission_service.config.scenario import load_scenario
from mission_service.journal.journal_file import SegmentReader
from mission_service.replay.verification import Verification, in_text, verify
from mission_service.runtime.run_outputs import write_outputs
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.simulation.sim import simulate

# One hour of fire, then forty minutes of flight in a fresh wind.
SHORT = (
    "start_s=3500",
    "duration_s=5900",
    "weather.0.wind_speed_m_s=7",
    "planner.alpha=5",
)


@dataclass
class Run:
    journal: Path
    record: RunStatistics
    fire: Fire


def fly(path: Path, *overrides: str, name: str = "default") -> Run:
    scenario = load_scenario(name, (*SHORT, *overrides))
    record, fire = simulate(scenario, path, created="2026-01-01")
    return Run(path, record, fire)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return fly(tmp_path_factory.mktemp("run") / "journal.jsonl")


def test_the_vehicle_monitors_the_front(run: Run) -> None:
    hawk = run.record.vehicles["hawk"]
    assert hawk.decisions > 300
    assert hawk.uploads["accepted"] > 20
    assert hawk.uploads.total() == hawk.uploads["accepted"]
    assert len(hawk.reversals) < 20


def test_telemetry_comes_four_times_a_second(run: Run) -> None:
    assert run.record.telemetry == pytest.approx(2400 * 4, abs=8)


def test_the_vehicle_stays_near_the_front(run: Run) -> None:
    import numpy as np

    land, arrival = run.fire.landscape, run.fire.arrival_time_s
    burned_rows, burned_cols = np.indices(land.shape)
    far = []
    for at_us, lat, lon, _ in run.record.vehicles["hawk"].track[900::20]:
        row, col = land.row_col_of(*land.xy_of_lat_lon(lat, lon))
        burned = arrival <= at_us / 1e6
        inside = burned[round(float(row)), round(float(col))]
        distance = np.hypot(burned_rows - row, burned_cols - col)
        far.append(float(distance[~burned if inside else burned].min()) * land.cell_size_m)
    assert np.mean(far) < 60.0
    assert max(far) < 250.0


def test_two_runs_with_one_seed_are_identical_byte_for_byte(run: Run, tmp_path: Path) -> None:
    path, until_s = tmp_path / "again.jsonl", 4400.0
    simulate(load_scenario("default", SHORT), path, created="2026-01-01", until_s=until_s)
    again, _, end = path.read_bytes().rstrip(b"\n").rpartition(b"\n")
    assert end.startswith(b'{"end":true')
    assert again.count(b"UploadMission") > 5
    assert run.journal.read_bytes().startswith(again)


def test_every_event_is_journalled_before_its_commands(run: Run) -> None:
    entries = list(SegmentReader(run.journal))
    assert entries[0].is_event
    assert all(entry.intact for entry in entries)


LANDING = (189, 31, 16, 16, 21)  # the landing that PX4 requires for a plane


def test_every_mission_is_one_that_the_stack_takes_as_it_is(run: Run) -> None:
    stack = stack_named("px4", "plane")  # the value of the default scenario
    missions = [
        entry.content.items
        for entry in SegmentReader(run.journal)
        if isinstance(entry.content, UploadMission)
    ]
    assert len(missions) > 20
    for mission in missions:
        for each in (stack, stack_named("ardupilot", "plane"), stack_named("ardupilot", "copter")):
            items = mission if each is stack else mission[: -len(LANDING)]
            assert [str(problem) for problem in check(items, each)] == []
            assert all(same_as_sent(item, as_read_back(item, each), each) for item in items)
        assert tuple(item.command for item in mission[-len(LANDING) :]) == LANDING
        assert adapted(mission, stack) == mission


def test_a_replay_reproduces_every_decision(run: Run) -> None:
    """The journal contains all inputs of a core: replayed without a fire, it decides the same."""
    result = verify(run.journal)
    assert result.difference is None
    assert result.decisions == run.record.vehicles["hawk"].decisions
    assert result.events > run.record.telemetry + run.record.observations


def altered(
    run: Run, tmp_path: Path, marker: str, before: str, after: str
) -> tuple[Verification, int]:
    """Change the first match after the middle of the journal; return its line and the result."""
    lines = run.journal.read_text(encoding="utf-8").splitlines(keepends=True)
    half = len(lines) // 2
    index = next(i for i in range(half, len(lines)) if marker in lines[i] and before in lines[i])
    lines[index] = lines[index].replace(before, after, 1)
    path = tmp_path / "altered.jsonl"
    path.write_text("".join(lines), encoding="utf-8")
    found = verify(path)
    assert found.difference is not None
    assert found.stage("file").counts["altered"] == 1
    return found, index + 1


@pytest.mark.long
def test_an_altered_decision_is_named_with_line_and_field(run: Run, tmp_path: Path) -> None:
    found, line = altered(run, tmp_path, "DirectionDecision", '"front_cells":', '"front_cells":9')
    assert found.differing == ["file", "planner", "core"]
    assert str(found.difference).startswith(f"line {line}: altered, its checksum does not match")
    for name in ("planner", "core"):
        stage = found.stage(name)
        assert "DirectionDecision.front_cells: journal has 9" in str(stage.difference)
        assert [each["field"] for each in stage.details] == ["DirectionDecision.front_cells"]
    assert str(found.stage("core").difference).startswith(f"line {line}: ")


@pytest.mark.long
def test_an_altered_event_is_named_even_where_no_decision_changes(run: Run, tmp_path: Path) -> None:
    found, line = altered(run, tmp_path, "Telemetry", '"altitude_amsl_m":', '"altitude_amsl_m":1')
    assert found.differing == ["file"]
    assert str(found.difference).startswith(f"line {line}: altered")


def test_a_lost_line_is_named(run: Run, tmp_path: Path) -> None:
    lines = run.journal.read_bytes().splitlines(keepends=True)
    path = tmp_path / "lost.jsonl"
    path.write_bytes(b"".join(lines[:2000] + lines[2001:]))
    difference = verify(path).difference
    assert difference is not None
    assert "line 2001" in difference


def test_a_journal_cut_off_is_verified_up_to_the_cut(run: Run, tmp_path: Path) -> None:
    data = run.journal.read_bytes()
    path = tmp_path / "cut.jsonl"
    path.write_bytes(data[: len(data) // 3])
    result = verify(path)
    assert result.difference is None
    assert result.cut_at_line is not None


def test_a_journal_cut_between_two_lines_has_no_regular_end(run: Run, tmp_path: Path) -> None:
    lines = run.journal.read_bytes().splitlines(keepends=True)
    path = tmp_path / "half.jsonl"
    path.write_bytes(b"".join(lines[: len(lines) // 2]))
    half, whole = (verify(each, stages=["file"]) for each in (path, run.journal))
    assert (half.difference, half.ended) == (None, False)
    assert (whole.difference, whole.ended) == (None, True)
    assert "the journal has no regular end" in in_text(half)
    assert "regular end" not in in_text(whole)


def test_what_a_run_leaves_can_be_read(run: Run, tmp_path: Path) -> None:
    scenario = load_scenario("default", SHORT)
    summary = write_outputs(tmp_path, scenario, run.record, run.fire)
    assert summary["vehicles"][0]["reversals"] == len(run.record.vehicles["hawk"].reversals)
    tracks = json.loads((tmp_path / "tracks.geojson").read_text(encoding="utf-8"))
    kinds = [feature["geometry"]["type"] for feature in tracks["features"]]
    assert kinds[0] == "LineString"
    assert kinds.count("Point") == summary["vehicles"][0]["reversals"]
    fronts = json.loads((tmp_path / "perimeters.geojson").read_text(encoding="utf-8"))
    areas = [feature["properties"]["area_ha"] for feature in fronts["features"]]
    assert areas == sorted(areas)
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_on_ardupilot_and_over_a_bad_link_the_loop_still_works(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    run = fly(
        path,
        "vehicles.0.stack=ardupilot",
        "duration_s=4500",
        "link.loss=0.15",
        "link.jitter_ms=150",
        "link.duplication=0.1",
    )
    hawk = run.record.vehicles["hawk"]
    assert hawk.uploads["accepted"] > 5
    assert hawk.decisions > 50
    assert verify(path).difference is None


@pytest.mark.long
def test_a_copter_flies_the_front_too(tmp_path: Path) -> None:
    run = fly(tmp_path / "journal.jsonl", "vehicles.0.kind=copter", "duration_s=4700")
    assert run.record.vehicles["hawk"].decisions > 50


@pytest.mark.long
def test_a_fire_whose_ignition_is_unknown_is_monitored_around_its_centre(tmp_path: Path) -> None:
    run = fly(
        tmp_path / "journal.jsonl",
        "duration_s=5000",
        "planner.ignition_known=false",
        "planner.reported_lat_deg=36.3635",
        "planner.reported_lon_deg=-84.1415",
    )
    assert run.record.vehicles["hawk"].decisions > 100


@pytest.mark.parametrize(
    "rule",
    [
        "islam_hu_damped",
        "predictive",
        "team.balanced",
        *(
            pytest.param(rule, marks=pytest.mark.long)
            for rule in (
                "islam_hu",
                "circling",
                "team.circling",
                "team.bumper",
                "team.highest-dynamic",
                "team.predictive",
            )
        ),
    ],
)
def test_a_fire_of_one_cell_is_monitored(rule: str, tmp_path: Path) -> None:
    early = ("start_s=0", "deploy_at_s=0", f'planner.rule="{rule}"')
    simulate(load_scenario("default", early), tmp_path / "journal.jsonl", "", until_s=300.0)
    found = verify(tmp_path / "journal.jsonl")
    assert found.difference is None
