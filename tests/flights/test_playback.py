"""Playing and seeking: the same state is shown after any sequence."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from mission_service.errors import FlightError
from mission_service.journal.journal_file import SegmentReader
from mission_service.replay.flights import playback as playing
from mission_service.replay.flights.entry_cache import BLOCK, EntryCache
from mission_service.replay.flights.playback import Playback
from mission_service.replay.flights.write_once_journal import refuse_loss
from mission_service.replay.verification import verify
from tests.bridge.log_writers import bin_flight, ulg_flight
from tests.flights.worlds import journal_in, player_of, run, sought


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return journal_in(tmp_path_factory.mktemp("flown"))


@pytest.fixture(autouse=True)
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Return a player that stores a state every five seconds, so that a short flight has many."""
    monkeypatch.setattr(playing, "STATE_EVERY_US", 5_000_000)


def shown(player: Playback) -> Any:
    """Return all data that a page shows, except those that increase with each change."""
    state_view, service = player.state_view, player.replay.service
    service.estimate.advance(service.statistics.at_us)
    return msgspec.to_builtins(
        {
            "vehicles": state_view.vehicles,
            "telemetry": state_view.telemetry,
            "missions": state_view.missions,
            "alarms": state_view.alarms,
            "announcements": [(line.at_us, line.text) for line in state_view.announcements],
            "corrections": service.estimate.corrections(),
            "fire": service.estimate.fire.arrival_time_s.tobytes().hex(),
            "tracks": {
                name: list(each.track) for name, each in service.statistics.vehicles.items()
            },
        }
    )


def test_seeking_shows_the_same_as_playing_and_writes_the_same_journal(
    flown: Path, tmp_path: Path
) -> None:
    straight = {}
    with player_of(flown, tmp_path / "straight", 1.0) as player:
        player.turn(0, lambda: False)
        for share in (0.1, 0.45, 0.7, 1.0):
            length_us = player.head.end_us - player.head.begin_us
            player.turn(round(share * length_us), lambda: False)
            straight[share] = shown(player)
    assert straight[0.45]["corrections"] == []
    assert len(straight[0.7]["corrections"]) == 1
    with player_of(flown, tmp_path / "sought") as player:
        player.head.pause()
        versions = [player.state_view.version]
        for share in (0.7, 0.1, 0.45, 1.0, 0.45, 0.7, 0.1):
            sought(player, share)
            assert shown(player) == straight[share], share
            versions.append(player.state_view.version)
        assert versions == sorted(set(versions))
        assert player.jumps == 7
        assert len(player._states) > 5
    journals = [(tmp_path / name / "journal.jsonl").read_bytes() for name in ("straight", "sought")]
    assert journals[0] == journals[1]  # each line once
    for name in ("straight", "sought"):
        result = verify(tmp_path / name / "journal.jsonl")
        assert result.difference is None
        assert result.events > 500
    assert journals[0].splitlines()[-1].startswith(b'{"end"')


def test_what_is_shown_stays_until_the_other_moment_is_whole(flown: Path, tmp_path: Path) -> None:
    with player_of(flown, tmp_path) as player:
        run(player)
        before, state_view = shown(player), player.state_view
        reader = state_view.version
        state_view.alarm("broker", "no broker")
        player.head.seek(player.head.begin_us + 3_000_000)
        assert player.turn(0, lambda: True)
        assert player.turn(0, lambda: True)
        assert player.state().seeking
        assert player.state_view is state_view
        assert {**shown(player), "alarms": {}} == {**before, "alarms": {}}
        run(player)
        assert not player.state().seeking
        now = player.state_view
        assert now is not state_view
        # A reader of an earlier version receives all data, ``replay`` first; the broker is still
        # offline.
        new = {key: version for key, version in now.changed.items() if version > reader}
        assert set(new) >= {
            "replay",
            "fire",
            "announcements",
            "alarms",
            "vehicle/hawk",
            "mission/kite",
        }
        assert min(new, key=lambda key: new[key]) == "replay"
        assert set(now.alarms) == {"broker"}
        assert now.fire_version > state_view.fire_version
        assert now.announcements_after(0) == []
        assert player.state().at_us == player.pairing.mission.of(player.head.begin_us + 3_000_000)


def test_a_seek_can_change_its_mind(flown: Path, tmp_path: Path) -> None:
    with player_of(flown, tmp_path / "one") as player, player_of(flown, tmp_path / "two") as other:
        run(player)
        head = player.head
        for share in (0.2, 0.9, 0.05):
            head.seek(head.begin_us + round(share * (head.end_us - head.begin_us)))
            player.turn(0, lambda: True)
        sought(player, 0.6)
        other.head.pause()
        sought(other, 0.6)
        assert shown(player) == shown(other)


def test_states_stay_few_and_small(
    flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(playing, "MAX_STATES_BYTES", 6_000_000)
    with player_of(flown, tmp_path) as player:
        run(player)
        assert sum(each.size for each in player._states) <= 6_000_000
        assert player._states[0].number == 0
        sought(player, 0.02)  # before the second position
        assert player.state_view.at_us <= player.pairing.mission.of(player.head.at_us)


def test_a_journal_that_is_no_replays_is_not_written_over(flown: Path, tmp_path: Path) -> None:
    with pytest.raises(FlightError, match="would be overwritten; choose another --out"):
        refuse_loss(flown, [])
    refuse_loss(tmp_path / "journal.jsonl", [])
    with player_of(flown, tmp_path) as player:
        run(player)
    refuse_loss(tmp_path / "journal.jsonl", [])
    header = SegmentReader(tmp_path / "journal.jsonl").header
    assert header["replay"] == [f"{flown.parent.name}/journal.jsonl"]


@pytest.mark.parametrize("make", [bin_flight, ulg_flight], ids=["bin", "ulg"])
def test_without_a_scenario_it_flies_over_level_ground(tmp_path: Path, make: Any) -> None:
    log = tmp_path / ("one.bin" if make is bin_flight else "one.ulg")
    log.write_bytes(make())
    with player_of(log, tmp_path / "out") as player:
        run(player)
        service = player.replay.service
        assert service.statistics.telemetry > 5
        assert service.estimate.fire.burned_ha == 0.0
        assert not np.isfinite(service.estimate.fire.arrival_time_s).any()
        (mission,) = player.state_view.missions.values()
        assert mission.on_board is mission.sending is None
        assert player.complete


def test_a_cache_reads_again_what_was_received() -> None:
    taken = []

    def stream() -> Any:
        for number in range(2 * BLOCK + 3):
            taken.append(number)
            yield number

    cache = EntryCache(stream())
    assert [cache.get(number) for number in range(BLOCK + 2)] == list(range(BLOCK + 2))
    assert len(taken) == BLOCK + 2  # it reads no more than required
    assert [cache.get(number) for number in (0, BLOCK - 1, BLOCK, BLOCK + 1)] == [
        *(0, BLOCK - 1, BLOCK, BLOCK + 1)
    ]
    assert [cache.get(number) for number in range(2 * BLOCK + 3)] == list(range(2 * BLOCK + 3))
    assert cache.get(2 * BLOCK + 3) is None
    assert len(cache._last) == 3
    cache.close()
