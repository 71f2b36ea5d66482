"""Observations of people, detectors and satellites: late, wrong, unconfirmed, and many."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from firemodel.assimilation.observation import BURNED, UNBURNED, Observation
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.events import Corrected, FireObserved, Observed, WindSet
from mission_service.fire.late_observation import WINDS_APART_S, with_observation, with_wind
from mission_service.fire.observed_window import in_letters
from mission_service.fire.reported_observations import CORRECTION_SD_M, observation_of
from mission_service.fire.run_ensemble import Images, processed
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import begun_again, fire_of, landscape_of, weather_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.replay.verification import verify
from mission_service.requests import MAX_AGE_S
from tests.api.worlds import World, world_in

SCENARIO = load_scenario("default", ("start_s=1380", "deploy_at_s=1380", "planner.rule=circling"))
FREE = np.zeros((SCENARIO.landscape.rows, SCENARIO.landscape.cols), dtype=bool)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(SCENARIO)


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """Return a flight without a simulated fire, 25 minutes after ignition."""
    scenario = SCENARIO.model_copy(update={"simulation": type(SCENARIO.simulation)()})
    found = world_in(tmp_path, scenario)
    found.fly(1500.0)
    yield found
    found.simulation.service.recording.journal.close()


def observe(world: World, cells: list[tuple[int, int]], **keys: object) -> dict[str, object]:
    """Report the centres of cells (row, column)."""
    land = world.simulation.estimate.landscape
    places = [land.lat_lon_of(*land.xy_of(float(row), float(col))) for row, col in cells]
    request = {
        "do": "observe",
        "by": "anna",
        "station": "tower",
        "state": "burning",
        "shape": "points",
        "points": [[float(lat), float(lon)] for lat, lon in places],
        **keys,
    }
    reply: dict[str, object] = world.context.request_handler.ask(request)
    return reply


def burned(world: World) -> np.ndarray:
    world.simulation.estimate.advance(world.simulation.clock.now_us)
    return world.simulation.estimate.fire.burned().copy()


def far_cell(world: World) -> tuple[int, int]:
    """Return an unburned cell that can burn, some hundred metres from the fire."""
    row, col = np.argwhere(burned(world)).mean(axis=0).astype(int)
    return int(row) - 35, int(col)


def test_a_late_observation_changes_the_fire_as_if_it_had_been_in_time(land: Landscape) -> None:
    def begin(burning, weather, at_s):  # type: ignore[no-untyped-def]
        return begun_again(SCENARIO, land, burning, weather, at_s)

    row, col = np.argwhere(np.isfinite(fire_of(SCENARIO, land).arrival_time_s))[0].tolist()
    state = np.full((3, 3), BURNED, dtype=np.uint8)
    seen = Observation(2000.0, row - 40, col - 1, state)
    in_time = fire_of(SCENARIO, land)
    in_time.advance(2000.0)
    in_time = with_observation(in_time, seen, FREE, begin, in_time.weather)
    in_time.advance(4000.0)
    late = fire_of(SCENARIO, land)
    late.advance(4000.0)
    without = late.burned().copy()
    late = with_observation(late, seen, FREE, begin, in_time.weather)
    grown = in_time.burned() & ~without
    assert np.count_nonzero(grown) > 20
    assert np.count_nonzero(late.burned() ^ in_time.burned()) < 0.1 * np.count_nonzero(grown)
    late.advance(5000.0)
    in_time.advance(5000.0)
    differ = np.count_nonzero(late.burned() ^ in_time.burned())
    assert differ < 0.05 * np.count_nonzero(in_time.burned())


def test_a_late_unburned_observation_holds_the_fire_back_until_now(land: Landscape) -> None:
    def begin(burning, weather, at_s):  # type: ignore[no-untyped-def]
        return begun_again(SCENARIO, land, burning, weather, at_s)

    fire = fire_of(SCENARIO, land)
    fire.advance(5400.0)
    rows, cols = np.nonzero(fire.arrival_time_s <= 4800.0)
    top, left = int(rows.mean()), int(cols.min())
    state = np.full((int(rows.max()) - top + 1, int(np.ptp(cols)) + 1), UNBURNED, dtype=np.uint8)
    found = with_observation(fire, Observation(4800.0, top, left, state), FREE, begin, fire.weather)
    here = Observation(4800.0, top, left, state).where
    assert (found.expected_s()[here] > 4800.0).all()
    assert 0 < np.count_nonzero(found.burned()[here]) < np.count_nonzero(fire.burned()[here])


def test_an_agreeing_observation_changes_nothing(world: World) -> None:
    before = burned(world)
    row, col = np.argwhere(before)[0]
    reply = observe(world, [(int(row), int(col))], age_s=100.0, position_sd_m=60.0)
    assert reply["ok"], reply
    assert reply["burned_ha_before"] == reply["burned_ha_after"]


def test_a_person_reports_a_spot_fire_and_planners_and_forecast_have_it(world: World) -> None:
    place = far_cell(world)
    reply = observe(world, [place], age_s=600.0)
    assert reply["ok"], reply
    found = burned(world)
    assert found[place]
    assert np.count_nonzero(found[place[0] - 6 : place[0] + 7]) > 3  # it has burned on since then
    (window,) = (
        entry.content
        for entry in SegmentReader(world.context.journal_path)
        if isinstance(entry.content, Observed) and entry.content.corrects
    )
    assert window.vehicle == "hawk"
    assert window.cells[place[0] - window.row][place[1] - window.col] == "b"
    inputs = world.simulation.estimate.ensemble.inputs_until(world.now_s)
    late = [each for each in inputs if isinstance(each, Observation) and each.at_s < 1000.0]
    assert len(late) == 1
    times = [each.at_s for each in inputs if isinstance(each, Observation | Images)]
    assert times == sorted(times)


def test_a_false_alarm_needs_a_second_report(world: World) -> None:
    place, before = far_cell(world), burned(world)
    keys = {"false_alarms_pct": 10.0, "source": "satellite", "position_sd_m": 60.0}
    assert observe(world, [place], **keys)["ok"]
    assert np.array_equal(burned(world), before)
    near = (place[0] + 3, place[1] - 2)
    assert observe(world, [near], **keys | {"source": "tower"})["ok"]
    assert burned(world)[near]


def test_a_confirmed_place_reaches_the_ensemble_too(world: World) -> None:
    place = far_cell(world)
    for source in ("satellite", "tower"):
        assert observe(world, [place], false_alarms_pct=5.0, source=source)["ok"]
    ensemble = world.simulation.estimate.ensemble
    inputs = ensemble.inputs_until(world.now_s)
    assert processed(ensemble.processed, inputs).burned()[place]


def test_a_detector_that_repeats_its_report_confirms_it(world: World) -> None:
    place = far_cell(world)
    for _ in range(3):
        assert observe(world, [place], false_alarms_pct=5.0, source="tower")["ok"]
        assert not burned(world)[place]
        world.fly(world.now_s + 4.0)
    assert observe(world, [place], false_alarms_pct=5.0, source="tower")["ok"]
    assert burned(world)[place]


def test_a_line_without_length_is_a_point(world: World) -> None:
    place = far_cell(world)
    assert observe(world, [place, place], shape="line")["ok"]
    assert burned(world)[place]


@pytest.mark.parametrize("age_s", [0, 700, 3600])
def test_the_first_report_of_a_fire_may_be_of_any_age(age_s: int) -> None:
    empty = {"simulation": type(SCENARIO.simulation)(), "ignition": ()}
    land = landscape_of(SCENARIO)
    estimate = RunEstimate(SCENARIO.model_copy(update=empty), land)
    lat, lon = land.lat_lon_of(*land.xy_of(100.0, 100.0))
    seen_at_us = (700 - age_s) * 1_000_000
    estimate.apply_report(
        FireObserved(
            *(700_000_000, "ann", "", "burning", "points", ((float(lat), float(lon)),)),
            *(seen_at_us, 10.0, 0.0, ""),
        )
    )
    estimate.advance(700_000_000)
    assert estimate.fire.burned()[100, 100]
    inputs = estimate.ensemble.inputs_until(700.0)
    assert processed(estimate.ensemble.processed, inputs).burned()[100, 100]


def test_ground_that_a_camera_saw_burned_is_not_reported_as_unburned(tmp_path: Path) -> None:
    world = world_in(tmp_path, SCENARIO)
    world.fly(2500.0)
    before = burned(world)
    cells = [(each[0], each[1]) for each in np.argwhere(before).tolist()]
    reply = observe(world, cells, state="unburned")
    assert not reply["ok"]
    assert "contradict it in" in str(reply["error"])
    assert np.array_equal(burned(world), before)


def test_a_refusal_does_not_depend_on_earlier_reads() -> None:
    """Waiting images contradict a report, whether the estimate was read before or not."""
    land = landscape_of(SCENARIO)
    lat, lon = land.lat_lon_of(*land.xy_of(25.0, 35.0))
    place = ((float(lat), float(lon)),)
    for reads in (True, False):
        estimate = RunEstimate(SCENARIO, land)
        estimate.on_event(Observed(100_000_000, "hawk", 20, 30, ("u" * 12,) * 12))
        estimate.on_event(Observed(200_000_000, "hawk", 20, 30, ("u" * 12,) * 12))
        if reads:
            estimate.advance(200_000_000)
        report = FireObserved(
            200_000_000, "ann", "", "burned", "points", place, 50_000_000, 5.0, 0.0, ""
        )
        with pytest.raises(FireModelError, match="contradict it in 1 of 1 cells"):
            estimate.apply_report(report)


def test_places_within_the_error_of_the_front_change_nothing(world: World) -> None:
    before = burned(world)
    row, col = np.argwhere(before).min(axis=0)
    assert observe(world, [(int(row) - 5, int(col))], position_sd_m=375.0)["ok"]
    assert np.array_equal(burned(world), before)


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"points": [[36.36, -54.14]]}, "36.36, -54.14 is outside the landscape"),
        ({"points": [[-84.14, 36.36]]}, "latitude and longitude are swapped"),
        ({"age_s": 7 * 3600.0}, "age_s: must be a number from 0 to 21600"),
        ({"age_s": -5.0}, "age_s"),
        ({"false_alarms_pct": 100.0}, "false_alarms_pct"),
        ({"shape": "polygon"}, "a polygon requires 3"),
    ],
)
def test_impossible_reports_are_refused_with_one_line(
    world: World, keys: dict[str, object], reason: str
) -> None:
    before, size = burned(world), world.context.journal_path.stat().st_size
    reply = observe(world, [far_cell(world)], **keys)
    assert not reply["ok"]
    assert reason in str(reply["error"])
    assert "\n" not in str(reply["error"])
    assert np.array_equal(burned(world), before)
    assert world.context.journal_path.stat().st_size == size


@pytest.mark.long
def test_a_mirrored_perimeter_that_cameras_contradict_is_refused(tmp_path: Path) -> None:
    world = world_in(tmp_path, SCENARIO)
    world.fly(4000.0)
    before = burned(world)
    cells = np.argwhere(before)
    mirrored = cells * (-1, 1) + (2 * cells[:, 0].min() - 1, 0)
    reply = observe(world, [(each[0], each[1]) for each in mirrored.tolist()], state="burned")
    assert not reply["ok"]
    assert "contradict it in" in str(reply["error"])
    assert np.array_equal(burned(world), before)


def test_ten_thousand_observations_at_once_leave_the_estimate_sane(world: World) -> None:
    """Nine in ten points are near the fire; one in ten is anywhere, and is reported once."""
    rng = np.random.default_rng(3)
    before = burned(world)
    inside = np.argwhere(before)
    for batch in range(10):
        places = inside[rng.integers(len(inside), size=900)] + rng.integers(-1, 2, (900, 2))
        anywhere = rng.integers(5, 195, (100, 2))
        cells = [(each[0], each[1]) for each in np.vstack([places, anywhere]).tolist()]
        keys = {"age_s": 60.0, "position_sd_m": 40.0, "false_alarms_pct": 10.0}
        assert observe(world, cells, source="satellite", **keys)["ok"], batch
    found = burned(world)
    assert np.count_nonzero(found & ~before) < 0.3 * np.count_nonzero(before)
    assert found[before].all()


def test_reports_are_equal_after_a_replay(world: World, tmp_path: Path) -> None:
    assert observe(world, [far_cell(world)], age_s=400.0)["ok"]
    world.fly(1600.0)
    world.simulation.service.recording.journal.close()
    assert verify(tmp_path / "journal.jsonl").difference is None


def test_reads_after_the_latest_event_do_not_change_the_estimate(tmp_path: Path) -> None:
    """The image of an earlier time may arrive after the read."""
    land = landscape_of(SCENARIO)
    estimates = [RunEstimate(SCENARIO, land) for _ in range(2)]
    for at_us in range(1_000_000, 400_000_000, 7_000_000):
        state = np.full((30, 30), ord("u"), dtype=np.uint8)
        state[10:20, 10 : 12 + at_us // 40_000_000] = ord("b")
        image = Observed(at_us, "hawk", 20, 30, in_letters(state))
        for estimate in estimates:
            estimate.on_event(image)
        estimates[0].advance(at_us + 6_900_000)
        estimates[0].advance(at_us + 60_000_000)
        assert estimates[0].fire.time_s == (at_us + 60_000_000) / 1e6
    for estimate in estimates:
        estimate.advance(395_000_000)
    one, other = (estimate.fire.expected_s() for estimate in estimates)
    assert np.array_equal(one, other)


def test_images_that_are_a_few_seconds_late_do_not_depend_on_reads() -> None:
    """The period of some of these images has ended by the latest event."""
    land = landscape_of(SCENARIO)
    estimates = [RunEstimate(SCENARIO, land) for _ in range(2)]
    for at_us in range(11_000_000, 400_000_000, 7_000_000):
        state = np.full((30, 30), ord("u"), dtype=np.uint8)
        state[10:20, 10 : 12 + at_us // 25_000_000] = ord("b")
        image = Observed(at_us - 8_000_000, "hawk", 20, 30, in_letters(state))
        other = Observed(at_us, "kite", 100, 100, ("uu", "uu"))
        for number, estimate in enumerate(estimates):
            for event in (other, image):
                estimate.on_event(event)
                if not number:
                    estimate.advance(at_us)
    for estimate in estimates:
        estimate.advance(395_000_000)
    one, other_s = (estimate.fire.expected_s() for estimate in estimates)
    assert np.array_equal(one, other_s)


def test_reports_of_the_same_wind_lose_no_growth() -> None:
    land = landscape_of(SCENARIO)
    plain, reported = (RunEstimate(SCENARIO, land) for _ in range(2))
    for at_us in range(600_000_000, 7_200_000_001, 600_000_000):
        for estimate in (plain, reported):
            estimate.on_event(Observed(at_us, "hawk", 0, 0, (".",)))
            estimate.advance(at_us)
        wind = reported.fire.weather.weather_at(at_us / 1e6)
        report = WindSet(at_us, "ann", "", wind.wind_speed_m_s, wind.wind_from_deg)
        reported.apply_report(report)
    differ = np.count_nonzero(plain.fire.burned() ^ reported.fire.burned())
    assert differ < 0.03 * np.count_nonzero(plain.fire.burned())


def test_a_late_image_takes_its_place_in_time() -> None:
    """The images of one camera arrive two minutes late."""
    land = landscape_of(SCENARIO)
    in_time, late = (RunEstimate(SCENARIO, land) for _ in range(2))
    state = np.full((30, 30), ord("u"), dtype=np.uint8)
    state[10:20, 10:20] = ord("b")
    image = Observed(1_200_000_000, "hawk", 20, 30, in_letters(state))
    others = [
        Observed(at_us, "kite", 100, 100, ("uu", "uu"))
        for at_us in range(1_200_000_000, 1_320_000_001, 1_000_000)
    ]
    in_time.on_event(image)
    for other in others:
        in_time.on_event(other)
        late.on_event(other)
    late.on_event(image)
    for estimate in (in_time, late):
        estimate.on_event(Observed(3_000_000_000, "kite", 100, 100, ("uu", "uu")))
        estimate.advance(3_000_000_000)
    assert late.fire.burned()[30:40, 40:50].all()
    differ = np.count_nonzero(late.fire.burned() ^ in_time.fire.burned())
    assert differ <= 0.03 * np.count_nonzero(in_time.fire.burned())


def reported(world: World, **keys: object) -> bool:
    """Report a far place; return whether the estimate has it as burned."""
    place = far_cell(world)
    reply = observe(world, [place], **keys)
    assert reply["ok"], reply
    return bool(burned(world)[place])


def test_ground_as_hot_as_ignition_burns_and_cooler_ground_needs_a_second_report(
    world: World,
) -> None:
    keys = {"state": "hot", "source": "satellite"}
    assert not reported(world, temperature_c=319.0, **keys)
    assert reported(world, temperature_c=319.0, **keys | {"source": "tower"})


def test_hot_ground_burns_at_once(world: World) -> None:
    assert reported(world, state="hot", temperature_c=320.0)


@pytest.mark.parametrize("keys", [{"state": "hot"}, {"state": "burned", "temperature_c": 400.0}])
def test_a_temperature_is_that_of_hot_ground(world: World, keys: dict[str, object]) -> None:
    reply = observe(world, [far_cell(world)], **keys)
    words = 'observe: the state "hot", and no other state, requires temperature_c'
    assert reply["error"] == words


def north_edge(world: World) -> list[tuple[int, int]]:
    """Burned cells at the north edge of the fire, which no camera has seen."""
    cells = np.argwhere(burned(world))
    return [(row, col) for row, col in cells.tolist() if row < cells[:, 0].min() + 5]


def test_unburned_ground_that_smoke_covered_was_not_seen(world: World) -> None:
    cells, before = north_edge(world), burned(world)
    keys = {"position_sd_m": 5.0, "age_s": 60.0}
    assert observe(world, cells, state="smoke", age_s=300.0)["ok"]
    assert np.array_equal(burned(world), before)
    assert observe(world, cells, state="unburned", **keys)["ok"]
    assert np.array_equal(burned(world), before)
    place = far_cell(world)
    assert observe(world, [place], state="smoke")["ok"]
    assert observe(world, [place], state="burned", **keys)["ok"]  # burned ground counts
    assert burned(world)[place]


def test_unburned_ground_without_smoke_changes_the_estimate(world: World) -> None:
    cells, before = north_edge(world), burned(world)
    assert observe(world, cells, state="unburned", position_sd_m=5.0, age_s=60.0)["ok"]
    assert np.count_nonzero(burned(world)) < np.count_nonzero(before)


@pytest.mark.parametrize(
    ("smoke", "changes"),
    [
        ({"source": "hawk"}, False),
        ({"source": "kite"}, True),
        ({}, True),  # cameras may see through smoke that hid the fire from a person
        ({"source": "hawk", "age_s": 700.0}, True),
    ],
)
def test_smoke_hides_unburned_ground_from_the_sensor_that_reports_it(
    world: World, smoke: dict[str, object], changes: bool
) -> None:
    cells = north_edge(world)
    assert observe(world, cells, state="smoke", **smoke)["ok"]
    rows, cols = zip(*cells, strict=True)
    size = (max(rows) - min(rows) + 1, max(cols) - min(cols) + 1)
    image = Observed(
        round(world.now_s * 1e6), "hawk", min(rows), min(cols), ("u" * size[1],) * size[0]
    )
    before = burned(world)
    world.simulation.service.handle_events([image], world.simulation.link_us)
    world.fly(world.now_s + 40.0)
    after = burned(world)
    removed = [each for each in cells if before[each] and not after[each]]
    assert bool(removed) == changes


def test_unburned_places_of_a_sensor_that_misses_fire_need_a_second_report(world: World) -> None:
    cells, before = north_edge(world), burned(world)
    keys = {"state": "unburned", "position_sd_m": 5.0, "missed_pct": 20.0}
    assert observe(world, cells, source="satellite", **keys)["ok"]
    assert np.array_equal(burned(world), before)
    assert observe(world, cells, source="tower", **keys)["ok"]
    assert np.count_nonzero(burned(world)) < np.count_nonzero(before)


def test_a_late_report_burns_on_in_the_wind_of_its_time() -> None:
    """The wind has turned round since: the fire has grown downwind of the earlier wind."""
    land = landscape_of(SCENARIO)
    late, in_time = (RunEstimate(SCENARIO, land) for _ in range(2))
    spot = observed_at(land, 600_000_000, (30, 100))
    in_time.apply_report(spot)
    for at_s, from_deg in ((700, 0.0), (1800, 180.0)):
        for estimate in (late, in_time):
            estimate.apply_report(WindSet(at_s * 1_000_000, "ann", "", 9.0, from_deg))
    seen_late = msgspec.structs.replace(spot, at_us=1_900_000_000)
    late.apply_report(seen_late)
    for estimate in (late, in_time):
        estimate.advance(1_900_000_000)
    assert np.count_nonzero(in_time.fire.burned()[10:, 80:120]) > 30
    differ = late.fire.burned() ^ in_time.fire.burned()
    assert np.count_nonzero(differ) < 0.1 * np.count_nonzero(in_time.fire.burned()[10:, 80:120])


def observed_at(land: Landscape, at_us: int, cell: tuple[int, int]) -> FireObserved:
    lat, lon = land.lat_lon_of(*land.xy_of(*map(float, cell)))
    place = ((float(lat), float(lon)),)
    return FireObserved(at_us, "ann", "", "burning", "points", place, at_us, 5.0, 0.0, "")


@pytest.mark.long
def test_the_winds_of_many_reports_are_stored_once_a_minute_for_six_hours() -> None:
    weather = weather_of(SCENARIO)
    for at_s in range(0, 30_000, 10):
        weather = with_wind(weather, 5.0, float(at_s % 360), float(at_s))
    assert len(weather.entries) <= MAX_AGE_S / WINDS_APART_S + 2
    assert weather.weather_at(29_995.0).wind_from_deg == 29_990 % 360
    assert weather.weather_at(15_000.0).wind_from_deg == pytest.approx(15_000 % 360, abs=60.0)


@pytest.mark.parametrize("scheme", ["devs8", "probabilistic"])
def test_a_late_report_burns_on_with_every_scheme(scheme: str) -> None:
    scenario = load_scenario("default", (f'fire.scheme="{scheme}"', "planner.rule=circling"))
    land = landscape_of(scenario)
    late, in_time = (RunEstimate(scenario, land) for _ in range(2))
    spot = observed_at(land, 600_000_000, (40, 100))
    in_time.apply_report(spot)
    late.apply_report(msgspec.structs.replace(spot, at_us=5_400_000_000))
    for estimate in (late, in_time):
        estimate.advance(5_400_000_000)
    grown, expected = (
        np.count_nonzero(estimate.fire.burned()[20:60, 80:120]) for estimate in (late, in_time)
    )
    assert expected > 20  # from one cell
    assert 0.5 * expected < grown < 2.0 * expected


def test_a_correction_and_a_report_of_the_same_area_show_the_same_cells() -> None:
    land = landscape_of(SCENARIO)
    corners = [land.lat_lon_of(*land.xy_of(*each)) for each in ((50.0, 60.0), (52, 80), (70, 70))]
    points = tuple((float(lat), float(lon)) for lat, lon in corners)
    by = (9_000_000, "ann", "tower")
    drawn = observation_of(Corrected(*by, "unburned", "polygon", points, 8_000_000), land)
    seen = observation_of(
        FireObserved(*by, "unburned", "polygon", points, 8_000_000, 5.0, 0.1, "", None, 0.2), land
    )
    assert np.array_equal(drawn.state, seen.state)
    assert drawn[:3] == seen[:3] == (8.0, 51, 61)
    assert drawn[4:8] == (CORRECTION_SD_M, 0.0, 0.0, "ann at tower")
    assert seen[4:8] == (5.0, 0.2, 0.1, "ann at tower")
