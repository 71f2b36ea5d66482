"""The core processes a logged flight: the same track at the same times, and decisions."""

import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot_bridge.vehicle.client_events import Position
from mission_service.commands import DirectionDecision
from mission_service.config.scenario import Scenario, parse_scenario
from mission_service.errors import FlightError
from mission_service.events import (
    BatteryUpdated,
    MissionProgress,
    ModeChanged,
    Observed,
    Telemetry,
    UploadFinished,
    WindMeasured,
)
from mission_service.replay.flights.batch import analysis_of, analysis_with_fire
from mission_service.replay.flights.flight_logs import Flight, flight_of, survey
from mission_service.replay.flights.journal_log import JournalLog, open_flight
from mission_service.replay.flights.run_analysis import RunAnalysis
from mission_service.replay.flights.run_figures import figures_of
from mission_service.replay.flights.scenario_pairing import (
    Pairing,
    mission_time,
    pair,
    scenario_for,
)
from mission_service.replay.verification import verify
from mission_service.simulation.sim import simulate
from tests.bridge.log_writers import bin_flight, dataflash, round_flight, ulg_flight

FLIGHTS = Path(__file__).parents[3] / "shared" / "data" / "flights"
REAL = sorted(FLIGHTS.glob("*.*")) if FLIGHTS.exists() else []
LOGS = [path for path in REAL if path.suffix.lower() in (".tlog", ".bin", ".ulg")]


def lit(lat_deg: float, lon_deg: float) -> list[tuple[float, float]]:
    """Return an ignition at a place and a ring with a radius of 300 m."""
    angles = [math.radians(angle) for angle in range(0, 360, 20)]
    ring = [(lat_deg + 0.0027 * math.cos(a), lon_deg + 0.00335 * math.sin(a)) for a in angles]
    return [(lat_deg, lon_deg), *ring]


def scenario(lat_deg: float = 36.35, lon_deg: float = -84.16, **changes: Any) -> Scenario:
    """Return a scenario: a grass fire on level ground, an hour old at the start of the flight."""
    settings: dict[str, Any] = {
        "name": "level",
        "duration_s": 7200.0,
        "deploy_at_s": 3600.0,
        "landscape": {
            "source": "flat",
            "rows": 120,
            "cols": 120,
            "lat_deg": lat_deg,
            "lon_deg": lon_deg,
            "elevation_m": 300.0,
        },
        "weather": [{"at_s": 0, "wind_speed_m_s": 1.0, "wind_from_deg": 200}],
        "ignition": [{"lat_deg": lat, "lon_deg": lon} for lat, lon in lit(lat_deg, lon_deg)],
        "vehicles": [{"name": "hawk", "home_lat_deg": lat_deg, "home_lon_deg": lon_deg}],
        "planner": {"rule": "circling"},
        **changes,
    }
    return parse_scenario(settings, Path("level.toml"))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "round.bin"
    path.write_bytes(round_flight())
    return path


def replayed(log: Path | str, out: Path, **changes: Any) -> tuple[RunAnalysis, JournalLog]:
    what = level_pairing(flight_of([str(log)]), **changes)
    return analysis_with_fire("round", what, out, "today"), JournalLog(out / "journal.jsonl")


def level_pairing(flight: Flight, **changes: Any) -> Pairing:
    return pair(flight, survey(flight), scenario(**changes))


def positions(path: Path) -> list[Position]:
    entries = [entry.event for entry in open_flight(path).entries()]
    return [event for event in entries if isinstance(event, Position)]


def telemetry(journal: JournalLog) -> list[Telemetry]:
    return [thing for thing in journal.contents() if isinstance(thing, Telemetry)]


def same_track(flown: list[Position], reported: list[Telemetry], first_us: int) -> None:
    """Check that positions have exact times; above 20 positions a second some are omitted."""
    at = {fix.at_us - flown[0].at_us + first_us: fix for fix in flown}
    assert reported[0].at_us == first_us
    assert 0.99 * len(flown) <= len(reported) <= len(flown)
    for there in reported:
        fix = at[there.at_us]
        assert (fix.lat_deg, fix.lon_deg) == (there.lat_deg, there.lon_deg)
        assert fix.altitude_amsl_m == there.altitude_amsl_m


def test_the_shadow_flies_the_very_track_and_its_journal_verifies(
    log: Path, tmp_path: Path
) -> None:
    _, journal = replayed(log, tmp_path)
    same_track(positions(log), telemetry(journal), 3_600_250_000)  # 0.25 s after the log begins
    found = verify(journal.path)
    assert found.difference is None
    assert found.commands > 5
    assert journal.open_loop
    assert journal.scenario().vehicles[0].stack == "ardupilot"  # by the log, not by the scenario
    contents = list(journal.contents())
    assert any(isinstance(thing, Observed) and "b" in "".join(thing.cells) for thing in contents)
    assert {thing.outcome for thing in contents if isinstance(thing, UploadFinished)} == {
        "accepted"
    }
    # The items are those of missions that the core would have sent, not of the flown mission.
    assert {t.current_seq for t in contents if isinstance(t, MissionProgress)} <= {0, 1}


def test_other_events_of_a_log_reach_the_core(tmp_path: Path) -> None:
    path = tmp_path / "hawk.bin"
    path.write_bytes(bin_flight())
    what = level_pairing(flight_of([str(path)]), lat_deg=36.3, lon_deg=-84.2)
    analysis_with_fire("hawk", what, tmp_path, "today")
    contents = list(JournalLog(tmp_path / "journal.jsonl").contents())
    winds = [thing for thing in contents if isinstance(thing, WindMeasured)]
    assert {(wind.speed_m_s, wind.from_deg) for wind in winds} == {(5.0, 126.9)}
    assert [t.mode for t in contents if isinstance(t, ModeChanged)][:1] == ["mission"]
    assert any(isinstance(thing, BatteryUpdated) for thing in contents)


def test_two_replays_are_the_same_to_the_byte(log: Path, tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for out in (one, other):
        out.mkdir()
        replayed(log, out)
    assert (one / "journal.jsonl").read_bytes() == (other / "journal.jsonl").read_bytes()


def test_the_turn_back_and_the_difference_are_reported(log: Path, tmp_path: Path) -> None:
    story, _ = replayed(log, tmp_path)
    hawk = story.vehicles["hawk"] if "hawk" in story.vehicles else story.vehicles["round-1"]
    (turn,) = hawk.turned_back
    assert story.since_s(turn.at_us) == pytest.approx(100.0, abs=1.5)
    angle = 100.0 * 15.0 / 400.0
    assert turn.lat_deg == pytest.approx(36.35 + 400.0 * math.cos(angle) / 111_195.0, abs=2e-4)
    # The planner circles clockwise without end.
    (span,) = hawk.differs
    assert span.from_us == turn.at_us
    assert span.to_us == story.end_us


def test_another_planner_decides_otherwise(log: Path, tmp_path: Path) -> None:
    planner = {"rule": "circling", "first_direction": "anticlockwise"}
    story, _ = replayed(log, tmp_path, planner=planner)
    (hawk,) = story.vehicles.values()
    assert sum(span.to_us - span.from_us for span in hawk.differs) > 60e6
    assert all(story.since_s(span.to_us) < 105.0 for span in hawk.differs)


def test_drops_are_reported_relative_to_the_mission(log: Path, tmp_path: Path) -> None:
    story, _ = replayed(log, tmp_path)
    (hawk,) = story.vehicles.values()
    (drop,) = hawk.drops  # without its mission, servo 3 would count as a control surface
    assert drop.done is not None
    assert story.since_s(drop.done.at_us) == pytest.approx(50.25, abs=0.3)
    assert drop.off_m == pytest.approx(400.0, abs=2.0)
    path = tmp_path / "gripper.ulg"
    path.write_bytes(ulg_flight())
    since_release = analysis_of("gripper", flight_of([str(path)]))
    (kite,) = since_release.vehicles.values()
    (drop,) = kite.drops
    assert drop.planned is None
    assert drop.done is not None
    assert since_release.since_s(drop.done.at_us) == pytest.approx(4.5, abs=0.1)


def test_a_part_of_a_flight_begins_with_what_holds_then(log: Path, tmp_path: Path) -> None:
    flight = flight_of([str(log)])._replace(from_s=60.0, to_s=90.0)
    story = analysis_with_fire("part", level_pairing(flight), tmp_path, "today")
    reported = telemetry(JournalLog(tmp_path / "journal.jsonl"))
    assert len(reported) == 4 * 30 + 1
    (hawk,) = story.vehicles.values()
    assert hawk.flown.stack is not None
    assert hawk.flown.modes[0][0] == story.begin_us
    assert len(hawk.flown.missions) == 1
    nothing = flight_of([str(log)])._replace(from_s=1e6)
    with pytest.raises(FlightError, match="no vehicle in this part"):
        survey(nothing)


def test_two_logs_of_one_vehicle_report_nothing_twice(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.bin"
    copy.write_bytes(round_flight(end_s=80.0))
    both = survey(flight_of([f"hawk={log}", f"hawk={copy}"]))
    assert list(both.flown) == ["hawk"]
    assert both.flown["hawk"].positions == 640
    assert len(survey(flight_of([str(log), str(copy)])).flown) == 2


def test_when_a_flight_begins_on_the_fires_clock(tmp_path: Path) -> None:
    path = tmp_path / "hawk.bin"
    path.write_bytes(bin_flight())  # the log has a date
    flight = flight_of([str(path)])
    found = survey(flight)
    assert mission_time(flight, found, scenario()).start_us == 3_600_000_000
    assert mission_time(flight, found, scenario(), 12.5).start_us == 12_500_000
    assert flight.offset_us is not None
    begin_s = (found.begin_us + flight.offset_us) / 1e6
    zero = datetime.fromtimestamp(begin_s - 1000.0, UTC)
    by_date = mission_time(flight, found, scenario(time_zero=zero.isoformat()))
    assert by_date.start_us == pytest.approx(1_000_000_000, abs=2)
    later = datetime.fromtimestamp(begin_s + 1000.0, UTC)
    with pytest.raises(FlightError, match="--at"):
        mission_time(flight, found, scenario(time_zero=later.isoformat()))


def test_vehicles_are_those_that_flew(tmp_path: Path) -> None:
    one, other = tmp_path / "one.bin", tmp_path / "other.ulg"
    one.write_bytes(bin_flight())
    other.write_bytes(ulg_flight())
    flight = flight_of([str(one), f"kite={other}"])
    found = survey(flight)
    placed = scenario_for(scenario(), found, mission_time(flight, found, scenario()))
    stacks = {each.name: each.stack for each in placed.vehicles}
    assert stacks == {"one-1": "ardupilot", "kite": "px4"}


def test_logs_with_a_date_are_not_joined_with_others(log: Path, tmp_path: Path) -> None:
    other = tmp_path / "kite.ulg"
    other.write_bytes(ulg_flight())
    with pytest.raises(FlightError, match=r"round\.bin: has no UTC time"):
        flight_of([str(other), str(log)])


@pytest.mark.long
def test_a_journal_by_its_own_rule_has_its_own_decisions(tmp_path: Path) -> None:
    """Two vehicles with late positions in turn: each has its own mission time."""
    run, out = tmp_path / "run", tmp_path / "out"
    run.mkdir()
    out.mkdir()
    home = {"home_lat_deg": 36.346, "home_lon_deg": -84.16, "autostart": True}
    two = [{"name": "hawk", **home}, {"name": "kite", "stack": "ardupilot", **home}]
    rule = {"rule": "islam_hu", "alpha": 5.0, "dwell_s": 20.0}
    link = {"delay_ms": 50.0, "jitter_ms": 400.0}
    flown_scenario = scenario(duration_s=4200.0, vehicles=two, planner=rule, link=link)
    simulate(flown_scenario, run / "journal.jsonl", "today")
    flight = flight_of([str(run)])
    own = flight.logs[0]
    assert isinstance(own, JournalLog)
    analysis_with_fire("again", pair(flight, survey(flight), own.scenario()), out, "today")
    first_decisions, again = (decided(JournalLog(each / "journal.jsonl")) for each in (run, out))
    assert len(first_decisions) > 50
    assert again == first_decisions


def decided(journal: JournalLog) -> list[DirectionDecision]:
    return [thing for thing in journal.contents() if isinstance(thing, DirectionDecision)]


def test_a_part_begins_with_the_latest_of_what_held(tmp_path: Path) -> None:
    path = tmp_path / "modes.bin"
    messages: list[tuple[Any, ...]] = [("MSG", 1_000_000, "ArduPlane V4.6.2 (deadbeef)")]
    messages += [("MODE", 1_000_000 + 1_000_000 * n, n % 2 + 10, n % 2 + 10) for n in range(20)]
    messages += [("MISE", 1_500_000 + 1_000_000 * n, 30, n + 1) for n in range(20)]
    messages += [("POS", 1_000_000 * n, 36.35, -84.16, 300.0, 0.0, 0.0) for n in range(1, 40)]
    path.write_bytes(dataflash(sorted(messages, key=lambda each: each[1])))
    flight = flight_of([str(path)])._replace(from_s=30.0)
    (flown,) = survey(flight).flown.values()
    assert len(flown.modes) == 1
    assert flown.modes[0][0] == 31_000_000
    assert flown.turned_back_us == []


def test_a_vehicle_that_never_rises_above_the_terrain_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "stands.bin"
    messages = [("POS", 1_000_000 * n, 36.35, -84.16, 290.0, 0.0, 0.0) for n in range(1, 20)]
    path.write_bytes(dataflash([("MSG", 1, "ArduPlane V4.6.2 (deadbeef)"), *messages]))
    story, _ = replayed(path, tmp_path)
    assert figures_of(story)["vehicles"][0]["lowest_above_terrain_m"] == -10.0


def test_heights_are_above_where_it_stood_last(tmp_path: Path) -> None:
    """An autopilot's first positions have no height before its estimator has an origin."""
    path = tmp_path / "origin.bin"
    messages: list[tuple[Any, ...]] = [("MSG", 1, "ArduPlane V4.6.2 (deadbeef)")]
    heights = [0.0] * 5 + [300.0] * 5 + [300.0 + 5.0 * n for n in range(1, 21)]
    for number, height in enumerate(heights, 1):
        at_us = 1_000_000 * number
        moves = 0.0 if number <= 10 else 15.0
        messages += [("XKF1", at_us, 0, moves, 0.0, 0.0, 0.0)]
        messages += [("POS", at_us, 36.35, -84.16, height, 0.0, 0.0)]
    path.write_bytes(dataflash(messages))
    (flown,) = survey(flight_of([str(path)])).flown.values()
    assert flown.figures()["highest_above_start_m"] == 100.0


def test_a_flight_off_the_map_is_reported_in_one_line(log: Path, tmp_path: Path) -> None:
    with pytest.raises(FlightError, match=r"no position is on the landscape of level.*36\.35360"):
        replayed(log, tmp_path, lat_deg=37.0)
    assert not (tmp_path / "journal.jsonl").exists()


def test_the_journal_of_a_run_is_not_written_over(log: Path, tmp_path: Path) -> None:
    replayed(log, tmp_path)
    replayed(log, tmp_path)  # a replay's own journal may be used
    path = tmp_path / "journal.jsonl"
    begin, _, rest = path.read_bytes().partition(b"\n")
    header = json.loads(begin)["header"]
    assert header["replay"] == ["round.bin"]
    with pytest.raises(FlightError, match="choose another --out"):
        replayed(tmp_path, tmp_path)
    path.write_text("precious")
    with pytest.raises(FlightError, match="choose another --out"):
        replayed(log, tmp_path)
    assert path.read_text() == "precious"
    assert rest


@settings(max_examples=25, suppress_health_check=list(HealthCheck))
@given(share=st.floats(0.0, 1.0))
def test_a_log_cut_at_any_byte_is_replayed_up_to_there(tmp_path: Path, share: float) -> None:
    whole = round_flight(end_s=40.0)
    path = tmp_path / "cut.bin"
    data = whole[: round(share * len(whole))]
    path.write_bytes(data)
    (tmp_path / "whole.bin").write_bytes(whole)
    for old in tmp_path.glob("journal*"):
        old.unlink()
    if not any(isinstance(each, Position) for each in _events(path, data)):
        return  # the log contains no flight yet
    _, journal = replayed(path, tmp_path)
    reported = telemetry(journal)
    flown = positions(tmp_path / "whole.bin")[: len(reported)]
    same_track(flown, reported, 3_600_250_000)


def _events(path: Path, data: bytes) -> list[Any]:
    return [entry.event for entry in open_flight(path).entries()] if data else []


@pytest.mark.skipif(not LOGS, reason="no shared flights")
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_real_flights_replay_to_their_tracks(path: Path, tmp_path: Path) -> None:
    ground = {"source": "flat", "rows": 150, "cols": 150, "elevation_m": 300.0}
    place = {"lat_deg": 36.303, "lon_deg": -84.197}
    what = level_pairing(flight_of([str(path)]), **place, landscape={**ground, **place})
    story = analysis_with_fire(path.stem, what, tmp_path, "today")
    flown = positions(path)
    first_us = 3_600_000_000 + flown[0].at_us - story.zero_us
    same_track(flown, telemetry(JournalLog(tmp_path / "journal.jsonl")), first_us)
    (vehicle,) = story.vehicles.values()
    if path.stem == "arduplane_perimeter":
        turned = [story.since_s(each.at_us) for each in vehicle.turned_back]
        seen = 134.0 if path.suffix == ".tlog" else 132.0  # its clock starts a little later
        assert any(at_s == pytest.approx(seen, abs=2.0) for at_s in turned)
    if path.stem == "arducopter_drops":
        assert sum(each.done is not None for each in vehicle.drops) == 6
        off_m = [each.off_m for each in vehicle.drops if each.off_m is not None]
        assert path.suffix == ".tlog" or (len(off_m) == 6 and max(off_m) < 1.0)
