"""The shared fire map: newer observations replace older ones, and all maps become equal."""

import math
from collections import defaultdict

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.errors import MissionServiceError
from mission_service.experiments.virtual_agents.camera_footprint import changed_cells
from mission_service.experiments.virtual_agents.monitoring import inaccuracy_cells
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.shared_map import MAX_DIFFERENCE_RUNS, MapMessage, SharedMap
from mission_service.guidance.formation.shared_map_kernels import CHECKSUM, TILE, cell_checksum
from mission_service.peer_messages import AnyMessage, Difference, Digest, FireUpdate

SHAPE = (40, 50)  # 3 x 4 tiles, some of them incomplete
NONE = np.empty(0, dtype=np.int64)
TICK_US = 250_000
S = 1_000_000


def cells(*numbers: int) -> np.ndarray:
    return np.array(numbers, dtype=np.int64)


def fire_of(shared: SharedMap) -> list[int]:
    return np.flatnonzero(shared.fire).tolist()


def of_type(messages: list[MapMessage], kind: type) -> list[MapMessage]:
    return [message for message in messages if isinstance(message, kind)]


def quiet(*maps: SharedMap) -> None:
    """Wait until the first digests were sent."""
    for shared in maps:
        shared.messages(0)


def exchange(maps: list[SharedMap], from_us: int, max_s: float) -> float:
    """Deliver all messages to every peer; return the seconds until all maps are equal."""
    for tick in range(int(max_s * S / TICK_US)):
        at_us = from_us + tick * TICK_US
        for message in [message for shared in maps for message in shared.messages(at_us)]:
            for shared in maps:
                shared.on_message(message)
        if all(np.array_equal(shared.stamps, maps[0].stamps) for shared in maps):
            return tick * TICK_US / S
    return math.inf


def test_an_observation_is_sent_once_with_its_time_and_received_by_others() -> None:
    one, other = SharedMap("one", SHAPE), SharedMap("other", SHAPE)
    quiet(one)
    assert [found.tolist() for found in one.add_view(cells(7, 8), cells(9), 100)] == [[7, 8], []]
    assert [found.tolist() for found in one.add_view(cells(7, 60), NONE, 200)] == [[60], []]
    sent = one.messages(300)
    assert sent == [FireUpdate(100, "one", (7, 8)), FireUpdate(200, "one", (60,))]
    assert one.messages(400) == []
    assert [found.tolist() for found in other.on_message(sent[0])] == [[7, 8], []]
    assert [found.tolist() for found in other.on_message(sent[0])] == [[], []]
    assert fire_of(other) == [7, 8]
    assert [found.tolist() for found in other.add_view(cells(8), cells(7), 500)] == [[], [7]]
    assert of_type(other.messages(600), FireUpdate) == [FireUpdate(500, "other", (), (7,))]


def test_the_map_from_before_the_mission_is_given_and_not_sent() -> None:
    shared = SharedMap("one", SHAPE)
    shared.set_initial(cells(3, 4), 0)
    assert fire_of(shared) == [3, 4]
    assert not of_type(shared.messages(0), FireUpdate)


def test_the_later_observation_wins_in_whatever_order_it_is_received() -> None:
    burns, cleared = FireUpdate(100, "x", (5,)), FireUpdate(200, "y", (), (5,))
    again = FireUpdate(300, "x", (5,))
    for order, expected in (
        ((burns, cleared), []),
        ((cleared, burns), []),
        ((again, cleared, burns), [5]),
        ((cleared, again, burns), [5]),
        ((FireUpdate(200, "x", (5,)), cleared), [5]),  # at the same time, so the cell burns
        ((cleared, FireUpdate(200, "x", (5,))), [5]),
    ):
        shared = SharedMap("one", SHAPE)
        for message in order:
            shared.on_message(message)
        assert fire_of(shared) == expected, order


def test_of_a_cell_that_is_twice_in_one_message_only_the_end_counts() -> None:
    shared = SharedMap("one", SHAPE)
    shared.set_initial(cells(5, 6), 0)
    runs = ((5, 1, 10, False), (5, 1, 20, True), (6, 1, 10, False), (7, 1, 30, True))
    on, off = shared.on_message(Difference(40, "x", (*runs, (8, 1, 10, True), (8, 1, 20, False))))
    assert fire_of(shared) == [5, 7]
    assert set(on.tolist()) <= {5, 7}
    assert 7 in on
    assert set(off.tolist()) <= {6, 8}
    assert 6 in off


def test_an_own_observation_is_later_than_all_received_whatever_the_clocks_show() -> None:
    shared = SharedMap("one", SHAPE)
    quiet(shared)
    shared.on_message(FireUpdate(9_000, "ahead", (5, 6)))
    assert shared.add_view(NONE, cells(5), 1_000)[1].tolist() == [5]
    (sent,) = shared.messages(1_000)
    other = SharedMap("other", SHAPE)
    other.on_message(FireUpdate(9_000, "ahead", (5, 6)))
    other.on_message(sent)
    assert fire_of(other) == fire_of(shared) == [6]


def test_checksums_are_those_of_the_cells_whatever_happened_to_them() -> None:
    rng = np.random.default_rng(1)
    shared = SharedMap("one", SHAPE)
    for k in range(60):
        some = rng.integers(0, 2000, 20)
        if k % 3 == 0:
            shared.add_view(some, rng.integers(0, 2000, 20), 100 * k)
        else:
            shared.on_message(
                FireUpdate(100 * k - 150, "x", tuple(some[:9].tolist()), (int(some[9]),))
            )
    expected: dict[int, int] = defaultdict(int)
    for cell in np.flatnonzero(shared.stamps).tolist():
        tile = cell // 50 // TILE * 4 + cell % 50 // TILE
        expected[tile] += int(cell_checksum(cell, int(shared.stamps.ravel()[cell])))
    (digest,) = of_type(shared.messages(10 * S), Digest)
    assert isinstance(digest, Digest)
    assert dict(digest.tiles) == {tile: total & CHECKSUM for tile, total in expected.items()}
    assert (digest.first, digest.end) == (0, 12)
    assert np.array_equal(shared.fire, shared.stamps % 2 == 1)


def test_a_peer_that_lacks_a_cell_or_two_gets_just_these() -> None:
    one, other = SharedMap("one", SHAPE), SharedMap("other", SHAPE)
    for shared in (one, other):
        shared.set_initial(np.arange(400), 0)
    (digest,) = other.messages(0)
    quiet(one)
    one.on_message(FireUpdate(50, "x", (405,)))
    one.on_message(FireUpdate(60, "x", (), (20,)))  # part of a separate tile
    one.on_message(FireUpdate(70, "x", (433, 482)))
    one.on_message(digest)
    sent = [message for k in range(12) for message in one.messages(k * TICK_US)]
    runs = [run for found in of_type(sent, Difference) for run in found.cells]  # type: ignore[union-attr]
    assert (405, 1, 50, True) in runs
    assert (433, 1, 70, True) in runs
    for message in sent:
        other.on_message(message)
    # Cell 20 has replaced an older one, which a sum does not show; it is therefore requested.
    assert exchange([one, other], 3 * S, 20.0) < 15.0


def test_where_each_lacks_much_of_a_tile_one_sends_it_whole_and_the_other_the_newer_cells() -> None:
    one, other = SharedMap("one", SHAPE), SharedMap("other", SHAPE)
    for shared, new in ((one, (400, 401, 402, 403)), (other, (405, 406, 407, 409))):
        shared.set_initial(np.arange(400), 0)
        shared.on_message(FireUpdate(50, "x", new))
    sent: list[MapMessage] = []
    for tick in range(24):
        for speaker, hearer in ((one, other), (other, one)):
            for message in speaker.messages(tick * TICK_US):
                sent.append(message)
                hearer.on_message(message)
    assert np.array_equal(one.stamps, other.stamps)
    differences = [message for message in sent if isinstance(message, Difference)]
    assert [message.whole for message in differences if message.whole] == [(0,)]
    of_whole = 8 * 16 + 4
    assert sum(run[1] for message in differences for run in message.cells) == of_whole + 4


def test_no_peer_sends_what_another_sent_meanwhile() -> None:
    team = [SharedMap(f"uav{k}", SHAPE) for k in range(9)]
    for shared in team:
        shared.set_initial(np.arange(100), 0)
        for k in range(40):
            shared.on_message(FireUpdate(0, f"far{k}", ()))
    lacks, *others = team
    (digest,) = lacks.messages(0)
    quiet(*others)
    for shared in others:
        shared.on_message(FireUpdate(50, "x", (200,)))
        shared.on_message(digest)
    sent = []
    for tick in range(20):
        for shared in others:
            for message in of_type(shared.messages(tick * TICK_US), Difference):
                sent.append(message)
                for hearer in team:
                    hearer.on_message(message)
    assert 1 <= len(sent) <= 3  # one of eight digests
    assert fire_of(lacks) == [*range(100), 200]


def test_a_peer_that_joins_without_a_map_gets_it_at_once() -> None:
    rng = np.random.default_rng(3)
    team = [SharedMap(f"uav{k}", (500, 500)) for k in range(8)]
    rows, cols = np.divmod(np.arange(250_000), 500)
    away = np.hypot(rows - 250, cols - 250) + rng.normal(0.0, 1.0, 250_000)
    order = np.argsort(away)
    for shared in team[1:]:
        shared.set_initial(order[:2600], 0)
        for k in range(160):
            new = order[2600 + 5 * k : 2605 + 5 * k]
            shared.on_message(FireUpdate(6_300_000 * k, "x", tuple(new.tolist())))
    assert exchange(team[1:], 1000 * S, 10.0) < 10.0
    assert exchange(team, 1010 * S, 15.0) <= 2.0
    assert team[0].fire.sum() == 3400


def test_fire_is_passed_from_neighbour_to_neighbour_where_not_all_receive_all() -> None:
    line = [SharedMap(f"uav{k}", SHAPE) for k in range(5)]
    quiet(*line)
    line[0].add_view(cells(*range(100, 110)), NONE, S)
    for tick in range(4, 120):
        for k, shared in enumerate(line):
            for message in shared.messages(tick * TICK_US):
                for hearer in line[max(k - 1, 0) : k + 2]:
                    hearer.on_message(message)
        if fire_of(line[4]) == list(range(100, 110)):
            break
    assert tick < 100
    assert all(np.array_equal(shared.stamps, line[0].stamps) for shared in line)


def shattered(share: float, shape: tuple[int, int], seed: int) -> FireUpdate:
    """Return single burning cells all over the map."""
    some = np.flatnonzero(np.random.default_rng(seed).random(shape) < share)
    return FireUpdate(100 + seed, f"x{seed}", tuple(some.tolist()))


def test_a_large_difference_goes_in_several_messages_bounded_in_size_and_rate() -> None:
    shape = (300, 300)
    full, empty = SharedMap("full", shape), SharedMap("empty", shape)
    for seed in range(5):
        full.on_message(shattered(0.02, shape, seed))
    sizes = defaultdict(list)
    for tick in range(400):
        at_us = tick * TICK_US
        for speaker, hearer in ((full, empty), (empty, full)):
            for message in speaker.messages(at_us):
                sizes[at_us // S, speaker.name].append(len(msgspec.json.encode(message)))
                hearer.on_message(message)
                if isinstance(message, Digest):
                    assert len(message.tiles) <= 128
                if isinstance(message, Difference):
                    assert len(message.cells) <= max(MAX_DIFFERENCE_RUNS, TILE**2)
        if np.array_equal(full.stamps, empty.stamps):
            break
    assert full.fire.sum() > 8_000
    assert np.array_equal(full.stamps, empty.stamps)
    assert max(len(of_a_second) for of_a_second in sizes.values()) <= 5
    assert max(sum(of_a_second) for of_a_second in sizes.values()) < 25_000


def test_more_tiles_than_fit_a_digest_are_sent_in_turns() -> None:
    shape = (300, 300)  # 361 tiles
    one, other = SharedMap("one", shape), SharedMap("other", shape)
    for shared in (one, other):
        shared.on_message(shattered(0.05, shape, 1))
    last = FireUpdate(900, "x", (89_999,))
    one.on_message(last)
    assert exchange([one, other], 0, 30.0) < 20.0


SIGHTS = st.tuples(
    st.integers(0, 3),  # the member of the formation
    st.lists(st.integers(0, 199), max_size=6).map(lambda some: cells(*some)),
    st.lists(st.integers(0, 199), max_size=3).map(lambda some: cells(*some)),
)


@settings(max_examples=60)
@given(st.lists(st.one_of(SIGHTS, st.integers(0, 2**30)), max_size=40))
def test_after_any_loss_repetition_and_disorder_all_maps_become_the_same(
    schedule: list[tuple[int, np.ndarray, np.ndarray] | int],
) -> None:
    """UAVs observe cells, and messages to some UAVs are late, repeated or lost."""
    shape = (20, 20)
    team = [SharedMap(f"uav{k}", shape) for k in range(4)]
    under_way: list[MapMessage] = []
    at_us = 0
    for event in schedule:
        at_us += TICK_US
        if isinstance(event, tuple):
            member, burning, unburned = event
            team[member].add_view(burning, unburned, at_us)
        under_way += [message for shared in team for message in shared.messages(at_us)]
        if isinstance(event, int) and under_way:
            for bit in range(12):
                if event >> bit & 1:
                    team[bit % 4].on_message(under_way[(event >> 12) * (bit + 1) % len(under_way)])
            if event % 5 == 0:
                under_way.clear()
    assert exchange(team, at_us + TICK_US, 40.0) <= 15.0
    for shared in team:
        assert np.array_equal(shared.fire, shared.stamps % 2 == 1)


def flown(loss: float, lossy_until_s: int, duration_s: int = 150) -> np.ndarray:
    """Fly eight UAVs around a growing fire, which they observe once a second.

    Returns the mean number of wrong cells in each second (duration_s).
    """
    rng = np.random.default_rng(7)
    grid = MapGrid(160, 160, 10.0, 0.0, 1600.0)
    x, y = grid.xy_of(*np.indices(grid.shape))
    noise_s = 190.0 * np.random.default_rng(5).random(grid.shape)
    arrival_s = (np.hypot(x - 800.0, y - 800.0) - 290.0) / 0.08 + noise_s
    team = [SharedMap(f"uav{k}", grid.shape) for k in range(8)]
    for shared in team:
        shared.set_initial(np.flatnonzero(arrival_s <= 0.0), 0)
    under_way: list[tuple[int, MapMessage]] = []
    wrong = []
    for tick in range(4 * duration_s):
        at_s, at_us = tick / 4, tick * TICK_US
        for receiver, message in under_way:
            team[receiver].on_message(message)
        under_way.clear()
        for k, shared in enumerate(team):
            if (tick + k) % 4 == 0:
                way = 0.12 * at_s + k
                east, north = 460.0 * math.cos(k * math.pi / 4), 460.0 * math.sin(k * math.pi / 4)
                x_m, y_m = 800.0 + east + 150 * math.cos(way), 800.0 + north + 150 * math.sin(way)
                view = (x_m, y_m, way + math.pi / 2, 152.0, 130.0)
                shared.add_view(*changed_cells(grid, view, arrival_s, at_s, shared.fire), at_us)
            for message in shared.messages(at_us):
                lost = rng.random(8) < (loss if at_s < lossy_until_s else 0.0)
                under_way += [(i, message) for i in range(8) if i != k and not lost[i]]
        if tick % 4 == 3:
            fires = [shared.fire for shared in team]
            wrong.append(inaccuracy_cells(arrival_s <= at_s, fires))
    return np.array(wrong)


def test_with_a_third_of_messages_lost_maps_are_nearly_as_good_and_soon_as_good() -> None:
    without, with_loss = flown(0.0, 0), flown(0.3, 100)
    assert 0.5 < without[20:].mean() < 40.0
    assert with_loss[20:100].mean() <= 1.5 * without[20:100].mean()
    assert with_loss[110:].mean() <= 1.05 * without[110:].mean() + 0.1
    # The test can fail: if all messages are lost, each UAV has only its own observations.
    alone = flown(1.0, 100)
    assert alone[20:100].mean() > 4.0 * without[20:100].mean()
    assert alone[100 + 15 :].mean() <= 1.05 * without[115:].mean() + 0.1


@pytest.mark.parametrize(("count", "max_bytes_s"), [(8, 300), (32, 120)])
def test_a_uav_sends_a_few_hundred_bytes_a_second(count: int, max_bytes_s: int) -> None:
    """The fire is as large as in the paper's experiments, and 30 % of the messages are lost."""
    rng = np.random.default_rng(4)
    rows, cols = np.divmod(np.arange(250_000), 500)
    order = np.argsort(np.hypot(rows - 250, cols - 250) + rng.normal(0.0, 1.0, 250_000))
    team = [SharedMap(f"uav{k}", (500, 500)) for k in range(count)]
    for shared in team:
        shared.set_initial(order[:3000], 0)
    under_way: list[tuple[int, MapMessage]] = []
    sent_bytes, burned = 0, 3000
    for tick in range(240):
        for receiver, message in under_way:
            team[receiver].on_message(message)
        under_way.clear()
        if tick % 3 == 0:
            for k in set(rng.integers(0, count, 2).tolist()):
                team[k].add_view(order[burned : burned + 1], NONE, tick * TICK_US)
            burned += 1
        for k, shared in enumerate(team):
            for message in shared.messages(tick * TICK_US):
                sent_bytes += len(msgspec.json.encode(message))
                receivers = np.flatnonzero(rng.random(count) >= 0.3).tolist()
                under_way += [(i, message) for i in receivers if i != k]
    assert sent_bytes / 60.0 / count < max_bytes_s
    fire = np.zeros(250_000, dtype=np.bool_)
    fire[order[:burned]] = True
    assert inaccuracy_cells(fire.reshape(500, 500), [shared.fire for shared in team]) < 2.0


@pytest.mark.parametrize(
    "message",
    [
        FireUpdate(5, "x", (3, 2000)),
        FireUpdate(5, "x", (), (-1,)),
        Difference(5, "x", ((3, 1, 0, True), (1999, 2, 0, True))),
        Difference(5, "x", ((3, 0, 0, True),)),
        Difference(5, "x", ((3, 2**40 - 1, 0, True),)),
        Difference(5, "x", ((3, 1, 9, True),), (0, 12)),
        Digest(5, "x", ((12, 1),)),
        Digest(5, "x", (), 0, 13),
        Digest(5, "x", (), 7, 6),
    ],
)
def test_an_item_off_the_map_is_an_error_that_names_its_owner(message: MapMessage) -> None:
    shared = SharedMap("one", SHAPE)
    with pytest.raises(MissionServiceError, match=r"x: .* not on the map of 40 x 50 cells"):
        shared.on_message(message)
    assert not shared.stamps.any()


def test_a_cell_seen_off_the_map_is_an_error() -> None:
    with pytest.raises(MissionServiceError, match="camera view: cell 2000 is not on the map"):
        SharedMap("one", SHAPE).add_view(cells(2, 2000), NONE, 0)


@pytest.mark.parametrize(
    "line",
    [
        b'{"type":"FireUpdate","at_us":-1,"sender":"x","burning":[1]}',
        b'{"type":"FireUpdate","at_us":9223372036854775807,"sender":"x","burning":[1]}',
        b'{"type":"FireUpdate","at_us":1,"sender":"x","burning":[-1]}',
        b'{"type":"Digest","at_us":1,"sender":"x","tiles":[[1,18446744073709551615]]}',
        b'{"type":"Difference","at_us":1,"sender":"x","cells":[[1,1,-1,true]]}',
        b'{"type":"Difference","at_us":1,"sender":"x","cells":[[1,1,1,2]]}',
    ],
)
def test_numbers_that_kernels_cannot_reckon_with_are_not_decoded(line: bytes) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(line, type=AnyMessage)
