"""A journal's scenario is flown again: identical with its own settings; errors are one line."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mission_service.cli.main import main
from mission_service.commands import DirectionDecision
from mission_service.config.scenario import flying, load_scenario
from mission_service.core.core import Core
from mission_service.errors import JournalError
from mission_service.events import (
    Aborted,
    AnyOperatorEvent,
    Approved,
    MissionAccepted,
    OperatorHeartbeat,
    OrderGiven,
    Resumed,
    SettingsChanged,
    WindSet,
)
from mission_service.journal.journal_file import SegmentReader
from mission_service.journal.reader import JournalReader
from mission_service.replay.verification import verify
from mission_service.replay.what_if import (
    Script,
    figures_of,
    past_run,
    repeatable_requests,
    what_if,
    with_settings,
)
from mission_service.runtime.run_outputs import summary_of
from mission_service.sensors.watched_folder import WatchedFolder
from mission_service.simulation import sim
from mission_service.simulation.sim import simulate

CHANGES = ("start_s=3590", "duration_s=4200", "planner.alpha=5", "vehicles.0.airspeed_m_s=18")
ANN = ("ann", "desk")


def script() -> Script:
    """Operators' events in the first flight: wind, other settings and a hold."""
    events: list[AnyOperatorEvent] = [
        OperatorHeartbeat(3_600_000_000, *ANN),
        WindSet(3_700_000_000, *ANN, 12.0, 10.0),
        SettingsChanged(3_750_000_000, *ANN, alpha=0.2, dwell_s=30.0),
        OrderGiven(3_900_000_000, *ANN, "hawk", "hold"),
        OrderGiven(3_960_000_000, *ANN, "hawk", "resume"),
    ]
    return Script(events)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "journal.jsonl"
    simulate(flying(load_scenario("islam-hu", CHANGES)), path, "", crew=script().due)
    return path


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["replay", *arguments])


def lines(path: Path) -> list[bytes]:
    """Return all lines except the header, which contains the date."""
    return path.read_bytes().splitlines()[1:]


def test_with_the_journals_own_settings_it_is_the_same_flight_again(
    run: Path, tmp_path: Path
) -> None:
    again = tmp_path / "journal.jsonl"
    found = what_if(run, ["planner=islam_hu_damped"], tmp_path, "")
    assert lines(again) == lines(run)
    assert found.recorded == found.what_if
    assert found.recorded["decisions"] > 50
    assert found.notes == []
    assert verify(again).differing == []


@pytest.mark.long
def test_another_planner_flies_otherwise_and_both_are_reported(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("planner=predictive", "dwell_s=90", "baseline_s=300")
    result = call(str(run), "--what-if", *words, "--out", str(out), "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["settings"] == {"rule": "predictive", "dwell_s": 90.0, "baseline_s": 300.0}
    assert report["recorded"] != report["what_if"]
    assert report["what_if"]["vehicles"]["hawk"]["uploads_accepted"] > 0
    names = {"journal.jsonl", "map.png", "perimeters.geojson", "summary.json", "tracks.geojson"}
    assert names | {"report.html"} <= {each.name for each in out.iterdir()}
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert figures_of(summary) == report["what_if"]
    entries = [entry.content for entry in SegmentReader(out / "journal.jsonl")]
    assert (
        sum(isinstance(each, DirectionDecision) for each in entries)
        == report["what_if"]["decisions"]
    )
    settings = [each for each in entries if isinstance(each, SettingsChanged)]
    assert [each.given for each in settings] == [{"alpha": 0.2}]
    assert sum(isinstance(each, OrderGiven | WindSet | OperatorHeartbeat) for each in entries) == 4
    assert verify(out / "journal.jsonl").differing == []


def test_settings_may_stand_in_one_word_or_in_several(run: Path, tmp_path: Path) -> None:
    short = tmp_path / "short.jsonl"
    part = run.read_bytes().splitlines(keepends=True)[:200]
    short.write_bytes(b"".join(part))
    journal = JournalReader(short)
    for words in (["alpha=1.5,dwell_s=10"], ["alpha=1.5 dwell_s=10"]):
        assert with_settings(journal, words)[1] == {"alpha": 1.5, "dwell_s": 10.0}
    words = ["alpha=1.5", "--what-if", "dwell_s=10"]
    result = call(str(short), "--what-if", *words, "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output
    assert "with alpha = 1.5, dwell_s = 10.0" in result.stdout
    rows = [line.split() for line in result.stdout.splitlines()]
    assert ["recorded", "what-if"] in rows


def test_a_recorded_flight_is_described_by_its_journal_alone(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    scenario = flying(load_scenario("islam-hu", CHANGES))
    record, fire = simulate(scenario, path, "", crew=script().due)
    past = past_run(JournalReader(path))
    assert summary_of(scenario, past.record, past.estimate.fire) == summary_of(
        scenario, record, fire
    )
    assert [type(each) for each in past.requests] == [
        OperatorHeartbeat, WindSet, SettingsChanged, OrderGiven, OrderGiven,
    ]  # fmt: skip


def test_a_burn_is_flown_again_by_simulated_operators(tmp_path: Path) -> None:
    small = ("landscape.rows=120", "landscape.cols=120", "duration_s=150")
    path = tmp_path / "journal.jsonl"
    simulate(flying(load_scenario("burn", small)), path, "")
    out = tmp_path / "again"
    out.mkdir()
    found = what_if(path, ["alpha=2"], out, "")
    assert lines(out / "journal.jsonl") == lines(path)
    assert (
        "a simulated crew confirms the GO/NO-GO checklist, is present and approves the plans"
        in found.notes
    )


def test_sensors_that_read_files_at_the_time_of_the_clock_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = f"estimate.observation_files.folder={tmp_path}"
    named = ('estimate.sensors=["observation_files"]', folder, "duration_s=3660")
    live = tmp_path / "live.jsonl"
    with monkeypatch.context() as patch:
        patch.setattr(sim, "CLOCK_SENSORS", ())  # the journal of a live run
        patch.setattr(WatchedFolder, "start", lambda self: None)
        simulate(flying(load_scenario("islam-hu", (*CHANGES, *named))), live, "")
    (tmp_path / "out").mkdir()
    found = what_if(live, ["alpha=1"], tmp_path / "out", "")
    assert found.notes == ["the observations of observation_files are not repeated"]


def test_approvals_and_restarts_are_not_submitted_again() -> None:
    source = (1, *ANN)
    kept: list[AnyOperatorEvent] = [
        Aborted(*source),
        OperatorHeartbeat(*source),
        SettingsChanged(*source, reversal_margin=0.1),
    ]
    people: list[AnyOperatorEvent] = [
        Approved(*source, "x"),
        MissionAccepted(*source, "hawk", "y"),
        Resumed(*source, 3.0),
        SettingsChanged(*source, alpha=2.0),
        *kept,
    ]
    assert repeatable_requests(people, {"alpha": 1.0}) == kept
    filtered = Script(kept)
    core: Core = None  # type: ignore[assignment]
    assert [filtered.due(0, core), filtered.due(1, core), filtered.due(2, core)] == [[], kept, []]


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (("--what-if", "beta=1", "--out", "OUT/new"), "planner.beta: unknown key (got 1)", 1),
        (("--what-if", "planner=nix", "--out", "OUT/new"), "planner.rule: no such rule", 1),
        (
            ("--what-if", "alpha=-1", "--out", "OUT/new"),
            "planner.alpha: must be a number, at least 0",
            1,
        ),
        (("--what-if", "alpha", "--out", "OUT/new"), "write it as KEY=VALUE of [planner]", 1),
        (("--what-if", "alpha.x=1", "--out", "OUT/new"), "write it as KEY=VALUE of [planner]", 1),
        (("--what-if", "alpha=1", "--out", "RUN"), "is the folder of the journal", 1),
        (("--what-if", "alpha=1"), "--what-if needs --out DIR", 2),
        (("--verify", "alpha=1"), "--verify needs one journal", 2),
        (("--verify", "--what-if", "alpha=1", "--out", "OUT"), "--verify and --what-if cannot", 2),
        (("--what-if", "alpha=1", "--stage", "core", "--out", "OUT"), "--stage requires", 2),
        (("alpha=1",), "1: cannot be read", 1),
    ],
)
def test_invalid_input_is_reported_in_one_line(
    run: Path, tmp_path: Path, arguments: tuple[str, ...], words: str, code: int
) -> None:
    where = {"OUT": str(tmp_path), "RUN": str(run.parent)}
    for name, folder in where.items():
        arguments = tuple(each.replace(name, folder) for each in arguments)
    before = run.read_bytes()
    result = call(str(run), *arguments)
    assert result.exit_code == code
    assert words in result.stderr
    assert "Traceback" not in result.output
    if code == 1:
        assert result.stderr.count("\n") == 1
    assert not (tmp_path / "new").exists()
    assert run.read_bytes() == before


def test_a_damaged_journal_is_not_flown_again(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(run.read_bytes().replace(b'"type":"Telemetry"', b'"type": "Telemetry"', 1))
    with pytest.raises(JournalError, match=r"line \d+ was altered; see replay --verify"):
        what_if(path, ["alpha=1"], tmp_path / "out", "")
