"""The interlock permits exactly the commands that are allowed."""

import random

import msgspec
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.commands import ClimbAndHold, Drop, ProposePlan, Return, WithdrawPlan
from mission_service.config.sections import BurnSection
from mission_service.events import (
    Aborted,
    Approved,
    BatteryUpdated,
    BurnUnitSet,
    ChecklistAnswered,
    DropFinished,
    GpsFixChanged,
    HostTime,
    LinkLost,
    LinkRestored,
    ModeChanged,
    OperatorEvent,
    OperatorHeartbeat,
    PersonReported,
    Rejected,
    Resumed,
    Telemetry,
    VehicleConnected,
    VehicleRebooted,
    WindSet,
)
from mission_service.guidance.burn.interlock import Interlock
from mission_service.ignition_plan import plan_hash
from tests.service.burn_history import (
    AT_US,
    CORNERS,
    DEG_PER_M,
    DROP,
    GOOD,
    HASH,
    LAT,
    LON,
    NAME,
    PLAN,
    Happening,
    Sent,
    burn,
    fix,
    plan,
)
from tests.service.burn_history import drop as drop_of

BURN = burn()
S = 1_000_000


def after(history: tuple[Happening, ...], section: BurnSection = BURN) -> Interlock:
    lock = Interlock(section)
    for thing in history:
        if isinstance(thing, Sent):
            lock.on_commands(thing.commands)
        else:
            lock.apply(thing)
    return lock


def why(*more: Happening, drop: Drop = DROP, at_us: int = AT_US) -> str | None:
    return after((*GOOD, *more)).refuses(drop, at_us)


def test_a_drop_in_order_goes_out_once() -> None:
    assert why() is None
    assert why(Sent((DROP,))) == f"plan {HASH[:12]}: drop 0 was already ordered"
    assert why(Sent((DROP,)), drop=drop_of(1)) is None


OTHER = plan(2)
AGAIN = (
    ChecklistAnswered(AT_US, "ann", "alpha", "weather", True),
    ChecklistAnswered(AT_US, "ann", "alpha", "payload", True),
)
APPROVED = Approved(AT_US, "ann", "alpha", HASH)
NORTH_DEG = 40.0 * DEG_PER_M


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ((Sent((WithdrawPlan(NAME, HASH, "wind shift"),)),), "withdrawn: wind shift"),
        ((Sent((WithdrawPlan(NAME, HASH, "wind shift"),)), APPROVED), "withdrawn: wind shift"),
        ((Rejected(AT_US, "bob", "bravo", HASH),), "rejected by bob"),
        ((Rejected(AT_US, "bob", "nowhere", HASH),), "rejected by bob"),
        ((Rejected(AT_US, "bob", "bravo", HASH), APPROVED), "rejected by bob"),
        ((Aborted(AT_US, "bob", "nowhere"),), "the burn was aborted by bob;"),
        ((Aborted(AT_US, "bob", "bravo"), APPROVED), "before the GO/NO-GO checklist was complete"),
        ((Aborted(AT_US, "bob", "bravo"), *AGAIN), "approve a plan again"),
        ((Sent((Return(NAME),)),), "the vehicle was sent home"),
        ((Sent((Return(NAME),)), *AGAIN), "approve a plan again"),
        ((Sent((ClimbAndHold(NAME, LAT, LON, 400.0),)),), "the vehicle was stopped in flight"),
        ((ModeChanged(AT_US, NAME, 6, True, "return"),), "recalled (mode return)"),
        (
            (
                ModeChanged(AT_US, NAME, 9, True, "land"),
                ModeChanged(AT_US, NAME, 3, True, "mission"),
            ),
            "recalled (mode land)",
        ),
        ((ModeChanged(AT_US, NAME, 3, False, "mission"),), "the vehicle has landed"),
        ((VehicleRebooted(AT_US, NAME),), "the autopilot was restarted"),
        ((Resumed(AT_US, "service", "", 5.0),), "the service was restarted"),
        (
            (ChecklistAnswered(AT_US, "bob", "bravo", "weather", False),),
            'NO-GO for "weather" by bob',
        ),
        (
            (ChecklistAnswered(AT_US, "bob", "bravo", "weather", False), *AGAIN),
            'NO-GO for "weather" by bob',
        ),
        ((Approved(AT_US, "ann", "nowhere", HASH),), "is not an approval station"),
        ((Approved(AT_US, " ", "alpha", HASH),), "does not name an operator"),
        ((Approved(AT_US, "service", "alpha", HASH),), "does not name an operator"),
        ((LinkLost(AT_US, NAME, 3.0),), "link lost"),
        ((GpsFixChanged(AT_US, NAME, False, "none"),), "no good position fix"),
        ((BatteryUpdated(AT_US, NAME, 24.9),), "battery 24.9 %, at least 25 % required"),
        ((BatteryUpdated(AT_US, NAME, float("nan")),), "battery nan %"),
        ((ModeChanged(AT_US, NAME, 4, True, "guided"),), "in mode guided"),
        ((fix(AT_US, east_m=-40.0),), "from the target of drop 0"),
        ((fix(AT_US, height_m=24.0),), "24 m above the drop's target, not 15 ± 8 m"),
        ((fix(AT_US, height_m=6.0),), "6 m above the drop's target"),
        ((fix(AT_US, height_m=float("nan")),), "nan m above"),
        ((BurnUnitSet(AT_US, "ann", "alpha", CORNERS),), "the burn unit was changed"),
        (
            (
                BurnUnitSet(AT_US, "ann", "alpha", tuple((x + 1.0, y) for x, y in CORNERS)),
                APPROVED,
            ),
            "outside the burn unit",
        ),
        ((PersonReported(AT_US, "cy", "alpha", "cy", LAT, LON, 20.0),), "within 20 m of cy"),
    ],
)
def test_a_drop_is_refused(more: tuple[Happening, ...], words: str) -> None:
    reason = why(*more)
    assert reason is not None
    assert words in reason


@pytest.mark.parametrize(
    ("drop", "at_us", "words"),
    [
        (drop_of(0, plan_hash=plan_hash(OTHER)), AT_US, "was never proposed"),
        (drop_of(3), AT_US, "has no drop 3"),
        (drop_of(0, "crane"), AT_US, "is for ignis, not for crane"),
        (DROP, 400 * S + 1, "was valid until 400 s"),
        (drop_of(0, off_m=4.1), AT_US, "would fall 4.1 m off its target"),
        (DROP, 101_500_000, "no position in the last 1.5 s"),
        (DROP, 105_000_001, "no input from an approver at alpha for 15 s"),
    ],
)
def test_a_wrong_drop_or_a_late_one_is_refused(drop: Drop, at_us: int, words: str) -> None:
    reason = why(drop=drop, at_us=at_us)
    assert reason is not None
    assert words in reason


def test_an_approval_runs_out_while_the_operators_are_present() -> None:
    later = (
        OperatorHeartbeat(189 * S, "ann", "alpha"),
        fix(190 * S),
    )
    long, short = burn(approval_s=100.0), burn(approval_s=99.9)
    assert after((*GOOD, *later), long).refuses(DROP, 190 * S) is None
    assert "older than 99.9 s" in str(after((*GOOD, *later), short).refuses(DROP, 190 * S))


def test_only_an_approver_at_the_approvals_station_counts_as_there() -> None:
    later = fix(120 * S)
    for event, is_there in (
        (OperatorHeartbeat(119 * S, "ann", "alpha"), True),
        (OperatorHeartbeat(119 * S, "ann", "bravo"), False),
        (OperatorHeartbeat(119 * S, "bob", "alpha", may_approve=True), True),
        (OperatorHeartbeat(119 * S, "bob", "bravo", may_approve=True), False),
        (OperatorHeartbeat(119 * S, "bob", "alpha"), False),
        (WindSet(119 * S, "feed", "alpha", 3.0, 270.0), False),
        (WindSet(119 * S, "bob", "alpha", 3.0, 270.0, may_approve=True), True),
        (Resumed(119 * S, "ann", "alpha", 1.0, may_approve=True), False),
    ):
        assert (why(event, later, at_us=120 * S) is None) is is_there, event


@pytest.mark.parametrize(
    ("host_s", "section", "words"),
    [
        (15.0, BURN, None),
        (15.1, BURN, "no input from an approver at alpha for 15 s"),
        (15.0, burn(approval_s=14.9), "older than 14.9 s"),
        (400.1, burn(approver_timeout_s=1000.0, approval_s=1000.0), "was valid until 400 s"),
    ],
)
def test_limits_run_on_the_hosts_clock_too(
    host_s: float, section: BurnSection, words: str | None
) -> None:
    """No approval remains valid because a mission clock is slow or stopped."""
    lock = after((*GOOD, HostTime(AT_US, NAME, round(host_s * S))), section)
    refused = lock.refuses(DROP, AT_US)
    assert refused is None if words is None else words in str(refused)


def test_a_restarted_host_clock_is_not_compared_with_the_one_before() -> None:
    lock = after((*GOOD, Resumed(AT_US, "service", "", 5.0)))
    lock.apply(HostTime(AT_US, NAME, -500 * S))
    for event in (*AGAIN, APPROVED, *GOOD[1:4], *GOOD[-2:]):
        assert not isinstance(event, Sent)
        lock.apply(event)
    assert "was valid until" in str(lock.refuses(DROP, AT_US))


def test_a_plan_that_does_not_match_its_hash() -> None:
    forged = Sent((ProposePlan(NAME, plan(valid_until_us=10**12), HASH),))
    assert "does not match the hash in the drop" in str(why(forged, APPROVED))


def test_a_plan_approved_before_it_was_proposed() -> None:
    history = tuple(thing for thing in GOOD if not isinstance(thing, Sent))
    lock = after((*history, Sent((ProposePlan(NAME, PLAN, HASH),))))
    assert "it has no approval" in str(lock.refuses(DROP, AT_US))


def test_every_missing_report_is_a_reason() -> None:
    for thing in GOOD:
        rest = tuple(other for other in GOOD if other is not thing)
        assert after(rest).refuses(DROP, AT_US) is not None, thing
    assert Interlock(BURN).refuses(DROP, AT_US) is not None


def test_after_a_stop_a_new_list_and_a_new_approval_open_it_again() -> None:
    stops: tuple[Happening, ...] = (
        Aborted(AT_US, "bob", "bravo"),
        Sent((Return(NAME),)),
        Resumed(AT_US, "service", "", 5.0),
        VehicleRebooted(AT_US, NAME),
    )
    reports_again: tuple[Happening, ...] = (
        HostTime(AT_US, NAME, 0),
        VehicleConnected(AT_US, NAME, "ardupilot copter", False),
        GpsFixChanged(AT_US, NAME, True, "3D"),
        BatteryUpdated(AT_US, NAME, 90.0),
        ModeChanged(AT_US, NAME, 3, True, "mission"),
        fix(AT_US),
        Sent((ProposePlan(NAME, PLAN, HASH),)),
    )
    for stop in stops:
        assert why(stop, *reports_again, *AGAIN) is not None
        assert why(stop, *reports_again, APPROVED, *AGAIN) is not None
        assert why(stop, *reports_again, *AGAIN, APPROVED) is None
        assert why(Sent((DROP,)), stop, *reports_again, *AGAIN, APPROVED) is not None


def test_spheres_and_their_rate() -> None:
    one, two = (drop_of(number) for number in (0, 1))
    few, slow = burn(spheres=1), burn(max_drops_per_min=1.0, drop_spacing_m=300.0)
    for section, words in ((few, "all 1 spheres"), (slow, "1 drops in a minute")):
        assert after(GOOD, section).refuses(one, AT_US) is None
        ordered = (*GOOD, Sent((one,)))
        assert words in str(after(ordered, section).refuses(two, AT_US))
    refused = DropFinished(AT_US, NAME, HASH, 0, False, True, "denied")
    assert after((*GOOD, Sent((one,)), refused), few).refuses(two, AT_US) is None
    unknown = DropFinished(AT_US, NAME, HASH, 0, False, False, "no answer")
    assert after((*GOOD, Sent((one,)), unknown), few).refuses(two, AT_US) is not None
    later = (Sent((one,)), fix(159 * S + 950_000), OperatorHeartbeat(159 * S, "ann", "alpha"))
    assert after((*GOOD, *later), slow).refuses(two, 159 * S + 800_000) is not None
    assert after((*GOOD, *later), slow).refuses(two, 159 * S + 900_000) is None


def changed(old: type, **changes: object) -> tuple[Happening, ...]:
    """Return the valid history with each event of a type changed."""
    return tuple(
        thing
        if isinstance(thing, Sent) or not isinstance(thing, old)
        else msgspec.structs.replace(thing, **changes)
        for thing in GOOD
    )


def test_a_vehicle_that_was_never_armed() -> None:
    lock = after(changed(ModeChanged, armed=False))
    assert lock.refuses(DROP, AT_US) == f"{NAME}: not armed"


def test_a_go_from_elsewhere_is_none() -> None:
    assert after(changed(ChecklistAnswered, station="nowhere")).open_items == ("weather", "payload")


def test_a_load_begins_with_a_landing() -> None:
    one, two = (drop_of(number) for number in (0, 1))
    landed = ModeChanged(AT_US, NAME, 3, False, "mission")
    flies = ModeChanged(AT_US, NAME, 3, True, "mission")
    for more, gets_out in (((), False), ((landed, flies, *AGAIN, APPROVED), True)):
        lock = after((*GOOD, Sent((one,)), *more), burn(spheres=1))
        assert (lock.refuses(two, AT_US) is None) == gets_out


def test_its_status_can_be_encoded_as_json() -> None:
    status = msgspec.json.decode(msgspec.json.encode(after(GOOD).status()))
    (proposed,) = status["plans"]
    assert proposed["approved"]["by"] == "ann"
    assert proposed["plan_hash"] == HASH
    assert status["vehicles"][NAME]["mode"] == "mission"


# An oracle without memory, which searches all events for each question ------------------------


def permitted(history: list[Happening], drop: Drop, at_us: int, section: BurnSection) -> bool:
    flat: list[object] = []
    for happened in history:
        flat += happened.commands if isinstance(happened, Sent) else (happened,)
    stations = [station.name for station in section.stations]

    proposed = [
        place
        for place, thing in enumerate(flat)
        if isinstance(thing, ProposePlan) and thing.plan_hash == drop.plan_hash
    ]
    if not proposed:
        return False
    made = flat[proposed[-1]]
    assert isinstance(made, ProposePlan)
    approvals = [
        place
        for place, thing in enumerate(flat)
        if isinstance(thing, Approved) and thing.plan_hash == drop.plan_hash
    ]
    if plan_hash(made.plan) != drop.plan_hash or made.plan.vehicle != drop.vehicle:
        return False
    if not approvals or approvals[-1] < proposed[-1]:
        return False
    since = flat[approvals[-1] :]
    approved = since[0]
    assert isinstance(approved, Approved)
    if approved.station not in stations or approved.by in ("", "service"):
        return False
    for place, thing in enumerate(flat):
        if place < proposed[-1]:
            continue
        if isinstance(thing, WithdrawPlan | Rejected) and thing.plan_hash == drop.plan_hash:
            return False
        if place < approvals[-1]:
            continue
        if isinstance(thing, Return | ClimbAndHold | Aborted | Resumed | BurnUnitSet):
            return False
        if isinstance(thing, VehicleRebooted) or (
            isinstance(thing, ChecklistAnswered) and not thing.go
        ):
            return False
    # The checklist at the approval; no item was opened later (checked above and below).
    if not all(is_go(flat[: approvals[-1]], item, stations) for item in section.go_items):
        return False
    if any(recalls(flat[: place + 1]) for place in range(approvals[-1], len(flat))):
        return False

    if not at_us <= made.plan.valid_until_us:
        return False
    if not at_us - approved.at_us <= section.approval_s * 1e6:
        return False
    attended = [
        (place, thing.at_us)
        for place, thing in enumerate(since)
        if isinstance(thing, OperatorEvent)
        and not isinstance(thing, Resumed)
        and thing.station == approved.station
        and (thing.by == approved.by or thing.may_approve)
    ]
    place, attended_us = attended[-1]
    if not at_us - attended_us <= section.approver_timeout_s * 1e6:
        return False
    if not host_allows(flat, proposed[-1], approvals[-1], approvals[-1] + place, section):
        return False

    last_restart = max(
        [0]
        + [
            place + 1
            for place, thing in enumerate(flat)
            if isinstance(thing, VehicleRebooted | Resumed)
        ]
    )
    since_restart = flat[last_restart:]
    links = [t for t in flat if isinstance(t, VehicleConnected | LinkRestored | LinkLost | Resumed
                                           | VehicleRebooted)]  # fmt: skip
    if not links or isinstance(links[-1], LinkLost | Resumed):
        return False
    fixes = [thing for thing in since_restart if isinstance(thing, GpsFixChanged)]
    batteries = [thing for thing in since_restart if isinstance(thing, BatteryUpdated)]
    modes = [thing for thing in since_restart if isinstance(thing, ModeChanged)]
    places = [thing for thing in since_restart if isinstance(thing, Telemetry)]
    if not (fixes and batteries and modes and places):
        return False
    percent = batteries[-1].percent
    if percent is None or not (fixes[-1].good and percent >= section.min_battery_pct):
        return False
    if not (modes[-1].armed and modes[-1].mode == "mission"):
        return False
    position = places[-1]
    if abs(at_us - position.at_us) > 1_500_000:
        return False

    numbers = {planned.number: planned for planned in made.plan.drops}
    ordered = [thing for thing in flat if isinstance(thing, Drop)]
    if drop.number not in numbers or any(
        (drop.plan_hash, drop.number) == (other.plan_hash, other.number) for other in ordered
    ):
        return False
    target = shapely.Point(
        (numbers[drop.number].lon_deg - LON) / DEG_PER_M * 0.8049,
        (numbers[drop.number].lat_deg - LAT) / DEG_PER_M,
    )
    falls = shapely.Point(
        (drop.lon_deg - LON) / DEG_PER_M * 0.8049, (drop.lat_deg - LAT) / DEG_PER_M
    )
    if target.distance(falls) > 4.0:
        return False
    flown = shapely.Point(
        (position.lon_deg - LON) / DEG_PER_M * 0.8049, (position.lat_deg - LAT) / DEG_PER_M
    )
    if target.distance(flown) > 5.0 * (0.2 + 1.7487 + 1.0) + 4.0 + 5.0:
        return False
    if not 7.5 <= position.altitude_amsl_m - 300.0 <= 22.5:
        return False
    units = [thing for thing in flat if isinstance(thing, BurnUnitSet)]
    if units and units[-1].points != CORNERS:
        return False
    for person in {t.name: t for t in flat if isinstance(t, PersonReported)}.values():
        east_m = (person.lon_deg - LON) / DEG_PER_M * 0.8049
        north_m = (person.lat_deg - LAT) / DEG_PER_M
        if person.radius_m and shapely.Point(east_m, north_m).distance(target) <= person.radius_m:
            return False
    return spheres_left(history, section, at_us)


def host_allows(
    flat: list[object], proposed: int, approved: int, attended: int, section: BurnSection
) -> bool:
    """Check limits on the host's clock; times before a restart are not comparable."""
    began = max([0, *(p for p, thing in enumerate(flat) if isinstance(thing, Resumed))])

    def passed_us(since: int) -> float:
        read = [t.monotonic_us for t in flat[began:] if isinstance(t, HostTime)]
        then = [t.monotonic_us for t in flat[began : since + 1] if isinstance(t, HostTime)]
        return read[-1] - then[-1] if read and then else float("inf")

    made = flat[proposed]
    assert isinstance(made, ProposePlan)
    return (
        passed_us(proposed) <= made.plan.valid_until_us - made.plan.made_at_us
        and passed_us(approved) <= section.approval_s * 1e6
        and passed_us(attended) <= section.approver_timeout_s * 1e6
    )


def spheres_left(history: list[Happening], section: BurnSection, at_us: int) -> bool:
    used, recent, latest = 0, 0, 0
    armed = False
    for thing in history:
        if isinstance(thing, Sent):
            for _ in (command for command in thing.commands if isinstance(command, Drop)):
                used += 1
                recent += at_us - latest < 60 * S
            continue
        latest = max(latest, thing.at_us)
        if isinstance(thing, DropFinished) and thing.refused:
            used = max(0, used - 1)
        if isinstance(thing, ModeChanged):
            used = 0 if armed and not thing.armed else used
            armed = thing.armed
        if isinstance(thing, VehicleRebooted | Resumed):
            armed = False
    return used < section.spheres and recent < section.max_drops_per_min


def recalls(flat: list[object]) -> bool:
    """Return whether the last of these events is a landing, or a return in flight."""
    *before, last = flat
    if not isinstance(last, ModeChanged):
        return False
    armed, height_m = False, 0.0
    for thing in before:
        if isinstance(thing, ModeChanged):
            armed = thing.armed
        elif isinstance(thing, Telemetry):
            height_m = thing.altitude_relative_m
        elif isinstance(thing, VehicleRebooted | Resumed):
            armed, height_m = False, 0.0
    landed = armed and not last.armed
    return landed or (last.armed and height_m > 2.0 and last.mode in ("return", "land"))


def is_go(flat: list[object], item: str, stations: list[str]) -> bool:
    for place in reversed(range(len(flat))):
        thing = flat[place]
        if isinstance(thing, Aborted | Resumed | Return | VehicleRebooted) or recalls(
            flat[: place + 1]
        ):
            return False
        if isinstance(thing, ChecklistAnswered) and thing.item == item:
            if not thing.go:
                return False
            if thing.station in stations:
                return True
    return False


def happenings(chance: random.Random) -> list[Happening]:
    """Return the valid history with some entries removed and others inserted at their times."""
    things: list[Happening] = []
    at_us, begin = 0, 0
    for _ in range(chance.choice([1, 1, 2])):
        for thing in GOOD[begin:]:
            if not isinstance(thing, Sent):
                at_us = max(at_us, thing.at_us)
            if chance.random() > 0.03:
                things.append(_at(thing, at_us))
            if chance.random() < 0.1:
                at_us += chance.choice([0, 0, 100_000, 2 * S, 20 * S])
                things.append(_at(any_thing(chance), at_us))
        begin = chance.randrange(len(GOOD))
    return things


def _at(thing: Happening, at_us: int) -> Happening:
    return thing if isinstance(thing, Sent) else msgspec.structs.replace(thing, at_us=at_us)


def any_thing(chance: random.Random) -> Happening:
    any_of = chance.choice
    source = (0, *any_of([("ann", "alpha"), ("bob", "bravo"), ("eve", "nowhere"), ("", "alpha")]))
    watch = any_of([source, (0, "bob", "alpha")])
    name, yes = any_of(HASHES), any_of([True, False])
    operator_events: list[Happening] = [
        ChecklistAnswered(*source, any_of(["weather", "payload", "else"]), yes),
        Approved(*source, name),
        Rejected(*source, name),
        Aborted(*source),
        OperatorHeartbeat(*watch, may_approve=yes),
        WindSet(*watch, 3.0, 270.0, may_approve=yes),
        Resumed(0, "service", "", 1.0),
        BurnUnitSet(*source, any_of([CORNERS, CORNERS, ELSEWHERE])),
        PersonReported(*source, "cy", LAT, LON, any_of([0.0, 5.0, 30.0])),
    ]
    mode = any_of(["mission", "mission", "return", "land", "hold"])
    flown: list[Happening] = [
        VehicleConnected(0, NAME, "x", True),
        HostTime(0, NAME, any_of([1, 5, 20, 1000]) * S),
        LinkLost(0, NAME, 3.0),
        LinkRestored(0, NAME),
        VehicleRebooted(0, NAME),
        GpsFixChanged(0, NAME, yes, ""),
        BatteryUpdated(0, NAME, any_of([10.0, 80.0])),
        ModeChanged(0, NAME, 0, yes, mode),
        fix(0, any_of([-5.0, 5.0, -60.0, 60.0]), any_of([15.0, 15.0, 1.0, 60.0])),
        DropFinished(0, NAME, HASH, chance.randrange(4), False, yes, ""),
    ]
    sent: list[Happening] = [
        Sent((ProposePlan(NAME, any_of([PLAN, OTHER]), name),)),
        Sent((WithdrawPlan(NAME, name, "x"),)),
        Sent((Return(NAME),)),
        Sent((ClimbAndHold(NAME, LAT, LON, 400.0),)),
        Sent((drop_of(chance.randrange(4), NAME, name),)),
    ]
    return any_of([*operator_events, *flown, *sent])


HASHES = [HASH, HASH, HASH, plan_hash(OTHER)]
ELSEWHERE = tuple((lat_deg + 1.0, lon_deg) for lat_deg, lon_deg in CORNERS)
SECTIONS = (BURN, burn(spheres=1), burn(max_drops_per_min=1.0, drop_spacing_m=300.0))


@settings(max_examples=300)
@given(st.integers(0, 2**32))
def test_nothing_goes_out_that_a_look_at_all_that_happened_does_not_allow(seed: int) -> None:
    for number in range(10):
        chance = random.Random(seed + number)
        history, section = happenings(chance), chance.choice(SECTIONS)
        vehicle = chance.choice([NAME, NAME, NAME, NAME, "crane"])
        off_m = chance.choice([0.0, 0.0, 3.9, 4.1])
        drop = drop_of(chance.randrange(4), vehicle, chance.choice(HASHES), off_m)
        times = [AT_US, *(thing.at_us for thing in history if not isinstance(thing, Sent))]
        at_us = max(times) + chance.choice([0, 0, 0, 0, 100_000, 1_600_000, 16 * S, 700 * S])
        refused = after(tuple(history), section).refuses(drop, at_us)
        allowed = permitted(history, drop, at_us, section)
        assert (refused is None) == allowed, (seed + number, refused)
