"""The reaction to a lost link: predicted from the parameters, and flown by the mock."""

from collections.abc import Iterator
from itertools import product

import pytest

from autopilot_bridge.clients.native import gcs_heartbeat
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import waypoint
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.flight_model import Mode
from autopilot_bridge.stacks.link_loss import (
    PHASES,
    STATION_ID,
    WANTED,
    Action,
    Phase,
    Wanted,
    changes_for,
    link_loss_of,
    missing,
    parameters_of,
)
from autopilot_bridge.stacks.stacks import Stack, stack_named
from tests.bridge.helpers import HOME, SECOND, flight_of, mock_of
from tests.bridge.mock_exchange import each_stack

PX4, PX4_COPTER = stack_named("px4", "plane"), stack_named("px4", "copter")
PLANE, COPTER = stack_named("ardupilot", "plane"), stack_named("ardupilot", "copter")
PX4_DEFAULTS = {
    "NAV_DLL_ACT": 0.0,
    "COM_DL_LOSS_T": 10.0,
    "COM_DLL_EXCEPT": 0.0,
    "COM_FAIL_ACT_T": 5.0,
}
PLANE_DEFAULTS = {
    "FS_GCS_ENABL": 0.0,
    "FS_LONG_ACTN": 0.0,
    "FS_LONG_TIMEOUT": 5.0,
    "SYSID_MYGCS": 255.0,
}
COPTER_DEFAULTS = {
    "FS_GCS_ENABLE": 0.0,
    "FS_GCS_TIMEOUT": 5.0,
    "FS_OPTIONS": 16.0,
    "SYSID_MYGCS": 255.0,
}
DEFAULTS = {"px4": PX4_DEFAULTS, "plane": PLANE_DEFAULTS, "copter": COPTER_DEFAULTS}
STEP_US = 125_000


def defaults_of(stack: Stack) -> dict[str, float]:
    return DEFAULTS["px4" if stack.name == "px4" else stack.vehicle]


def combinations(stack: Stack) -> Iterator[dict[str, float]]:
    """Yield all combinations of values, with undefined values."""
    ranges: dict[str, tuple[float, ...]]
    if stack.name == "px4":
        ranges = {"NAV_DLL_ACT": tuple(range(8)), "COM_DLL_EXCEPT": tuple(range(4))}
        ranges |= {"COM_FAIL_ACT_T": (0.0, 5.0)}
    elif stack.vehicle == "plane":
        ranges = {"FS_GCS_ENABL": tuple(range(5)), "FS_LONG_ACTN": tuple(range(6))}
        ranges |= {"SYSID_MYGCS": (255.0, 1.0), "FS_LONG_TIMEOUT": (3.0, 20.0)}
    else:
        ranges = {"FS_GCS_ENABLE": tuple(range(9)), "FS_OPTIONS": (0.0, 2.0, 16.0, 18.0)}
        ranges |= {"SYSID_MYGCS": (255.0, 1.0), "FS_GCS_TIMEOUT": (3.0, 20.0)}
    for values in product(*ranges.values()):
        yield {**defaults_of(stack), **dict(zip(ranges, values, strict=True))}


class Flight:
    """A mock in the air in one phase, with a station that sends heartbeats or is silent."""

    def __init__(self, stack: Stack, values: dict[str, float], phase: Phase) -> None:
        self.mock: MockAutopilot = mock_of(stack)
        for name, value in values.items():
            self.mock.parameters.change(name, value)
        self._codec = Codec(STATION_ID, 190)
        self.now_us = 0
        self.mock.handle_timer(0)
        flight = self.mock.flight
        home = (waypoint(*HOME),) if stack.item_0_is_home else ()
        flight.items = (*home, *flight_of())
        flight.armed = True
        flight.set_mode("mission", 0.0)
        self.listen(20.0)
        assert flight.airborne
        mode: Mode = "hold" if phase == "guided" and stack.name == "px4" else phase
        flight.set_mode(mode, self.now_us / 1e6)
        self.listen(2.0)
        self.before = flight.mode

    def listen(self, seconds: float) -> None:
        """Send a heartbeat every second; the last is sent at the end."""
        for _ in range(round(seconds)):
            self.silence(1.0)
            self.mock.receive_data(self._codec.encode(gcs_heartbeat()), self.now_us)

    def silence(self, seconds: float) -> list[tuple[float, str]]:
        """Send nothing; return the changes of mode and other actions, with their times."""
        flight, began_us = self.mock.flight, self.now_us
        seen: list[tuple[float, str]] = []
        for _ in range(round(seconds * SECOND / STEP_US)):
            mode, armed = flight.mode, flight.armed
            self.now_us += STEP_US
            self.mock.handle_timer(self.now_us)
            after_s = (self.now_us - began_us) / SECOND
            if armed and not flight.armed and not flight.crashed:
                seen.append((after_s, "disarm"))
            elif flight.mode != mode:
                seen.append((after_s, flight.mode))
            if "Parachute: Released" in self.texts():
                seen.append((after_s, "parachute"))
        return seen

    def texts(self) -> list[str]:
        """Return the texts that the mock has sent since the last call."""
        messages = [each for data in self.mock.data_to_send() for each in self._codec.decode(data)]
        return [each.text for each in messages if each.get_type() == "STATUSTEXT"]


FLOWN: dict[Action, tuple[str, ...]] = {
    "return or land": ("land",),  # SmartRTL is not available
    "return": ("rtl",),
    "terminate": ("termination",),
}


def expected(stack: Stack, values: dict[str, float], phase: Phase, before: str) -> list[str]:
    """Return the predicted changes; an action in its own mode changes nothing."""
    changes = []
    for _, action in link_loss_of(stack, values).reactions[phase]:
        flown = FLOWN.get(action, (action,))[0]
        if flown != before:
            changes.append(flown)
        before = before if flown in ("parachute", "disarm") else flown
    return changes


@each_stack
@pytest.mark.parametrize("phase", PHASES)
def test_the_mock_flies_what_is_predicted(stack: Stack, phase: Phase) -> None:
    flown_actions = set()
    for values in combinations(stack):
        flight = Flight(stack, values, phase)
        reaction = link_loss_of(stack, values).reactions[phase]
        seen = flight.silence(25.0)
        wanted = expected(stack, values, phase, flight.before)
        assert [action for _, action in seen] == wanted, (values, reaction)
        times = {FLOWN.get(action, (action,))[0]: after_s for after_s, action in reaction}
        for after_s, action in seen:
            assert times[action] < after_s < times[action] + 0.5, (values, seen)
            flown_actions.add(action)
    assert len(flown_actions) >= 2


@each_stack
def test_every_wanted_reaction_is_reached_by_its_changes(stack: Stack) -> None:
    reachable: tuple[Wanted, ...] = ("continue", "return") if stack.same_vehicle(PLANE) else WANTED
    for values, wanted in product(combinations(stack), reachable):
        changes = changes_for(stack, wanted, values)
        after = {**values, **{change.name: change.after for change in changes}}
        assert link_loss_of(stack, after).satisfies(wanted), (values, wanted, changes)
        assert bool(changes) is not link_loss_of(stack, values).satisfies(wanted)
        assert all(change.before == values[change.name] != change.after for change in changes)


@pytest.mark.parametrize("wanted", ["hold", "land"])
def test_arduplane_has_no_hold_and_no_landing_after_a_lost_link(wanted: Wanted) -> None:
    with pytest.raises(BridgeError, match="supported: continue, return"):
        changes_for(PLANE, wanted, PLANE_DEFAULTS)


def test_only_exceptions_that_matter_are_cleared() -> None:
    values = {**COPTER_DEFAULTS, "FS_OPTIONS": 16.0 + 8.0 + 2.0}
    assert [str(each) for each in changes_for(COPTER, "hold", values)] == [
        "FS_GCS_ENABLE 0 -> 7",
        "FS_OPTIONS 26 -> 24",
    ]
    assert [str(each) for each in changes_for(COPTER, "return", values)] == [
        "FS_GCS_ENABLE 0 -> 1",
        "FS_OPTIONS 26 -> 8",
    ]


@pytest.mark.parametrize(
    ("stack", "values", "words"),
    [
        (PX4, {}, "continues"),
        (PX4, {"NAV_DLL_ACT": 2.0}, "holds after 10 s, returns after 15 s"),
        (PX4, {"NAV_DLL_ACT": 2.0, "COM_FAIL_ACT_T": 0.0}, "returns after 10 s"),
        (PX4, {"NAV_DLL_ACT": 1.0}, "holds after 10 s"),
        (
            PX4_COPTER,
            {"NAV_DLL_ACT": 3.0, "COM_DLL_EXCEPT": 1.0, "COM_DL_LOSS_T": 20.0},
            "in mission: continues; "
            "in guided and hold: holds after 20 s, lands where it is after 25 s",
        ),
        (
            PLANE,
            {"FS_GCS_ENABL": 1.0},
            "in mission and guided: continues; in hold: returns after 5 s",
        ),
        (PLANE, {"FS_GCS_ENABL": 1.0, "FS_LONG_ACTN": 1.0}, "returns after 5 s"),
        (PLANE, {"FS_GCS_ENABL": 1.0, "FS_LONG_ACTN": 1.0, "SYSID_MYGCS": 1.0}, "continues"),
        (
            COPTER,
            {"FS_GCS_ENABLE": 1.0},
            "in mission and guided: returns after 5 s; in hold: continues",
        ),
    ],
)
def test_a_reaction_in_words(stack: Stack, values: dict[str, float], words: str) -> None:
    assert str(link_loss_of(stack, {**defaults_of(stack), **values})) == words


@pytest.mark.parametrize(
    ("stack", "values", "warning"),
    [
        (PX4, {"NAV_DLL_ACT": 4.0}, "NAV_DLL_ACT = 4 is not defined: PX4 does not react"),
        (PX4, {"NAV_DLL_ACT": 6.0}, "NAV_DLL_ACT = 6: it disarms in the air"),
        (PLANE, {"FS_GCS_ENABL": 4.0}, "FS_GCS_ENABL = 4 is not defined"),
        (PLANE, {"FS_GCS_ENABL": 1.0, "FS_LONG_ACTN": 2.0}, "it glides without throttle"),
        (PLANE, {"FS_GCS_ENABL": 1.0, "FS_LONG_ACTN": 9.0}, "returns from LOITER"),
        (COPTER, {"FS_GCS_ENABLE": 9.0}, "FS_GCS_ENABLE = 9 is not defined: ArduCopter returns"),
        (COPTER, {"FS_GCS_ENABLE": 5.0, "SYSID_MYGCS": 252.0}, "SYSID_MYGCS = 252"),
    ],
)
def test_undefined_and_dangerous_values_are_named(
    stack: Stack, values: dict[str, float], warning: str
) -> None:
    assert link_loss_of(stack, defaults_of(stack)).warnings == ()
    (line,) = link_loss_of(stack, {**defaults_of(stack), **values}).warnings
    assert warning in line


def test_return_height_and_fence() -> None:
    px4 = link_loss_of(PX4, {**PX4_DEFAULTS, "RTL_RETURN_ALT": 60.0, "GF_ACTION": 3.0})
    assert (px4.return_height_m, px4.fence) == (60.0, "return")
    copter = {**COPTER_DEFAULTS, "RTL_ALT": 1500.0, "FENCE_ENABLE": 1.0, "FENCE_ACTION": 4.0}
    loss = link_loss_of(COPTER, copter)
    assert (loss.return_height_m, loss.fence) == (15.0, "brake or land")
    plane = {**PLANE_DEFAULTS, "RTL_ALTITUDE": -1.0, "FENCE_ENABLE": 0.0, "FENCE_ACTION": 1.0}
    loss = link_loss_of(PLANE, plane)
    assert (loss.return_height_m, loss.fence) == (None, "no fence")
    loss = link_loss_of(PLANE, {**plane, "FENCE_ENABLE": 1.0, "FENCE_ACTION": 5.0})
    assert loss.fence == "undefined (5)"
    assert link_loss_of(PLANE, PLANE_DEFAULTS).fence == "unknown"


@each_stack
def test_without_a_value_the_reaction_is_unknown(stack: Stack) -> None:
    for name, _ in sorted(defaults_of(stack).items()):
        values = {each: value for each, value in defaults_of(stack).items() if each != name}
        assert missing(stack, values) == (name,)
        with pytest.raises(BridgeError, match=name):
            link_loss_of(stack, values)


@each_stack
def test_the_mock_has_all_parameters_that_are_read(stack: Stack) -> None:
    assert set(parameters_of(stack)) <= set(mock_of(stack).parameters.names)


@each_stack
def test_a_vehicle_that_has_had_no_station_does_not_react(stack: Stack) -> None:
    mock = mock_of(stack)
    change = changes_for(stack, "return", defaults_of(stack))
    for name, _, value in change:
        mock.parameters.change(name, value)
    mock.flight.armed = True
    mock.flight.set_mode("guided", 0.0)
    mock.handle_timer(0)
    mock.handle_timer(60 * SECOND)
    assert mock.flight.mode == "guided"


def test_a_restored_link_ends_ardupilots_failsafe_but_not_its_return() -> None:
    values = {**PLANE_DEFAULTS, "FS_GCS_ENABL": 1.0, "FS_LONG_ACTN": 1.0}
    flight = Flight(PLANE, values, "mission")
    flight.silence(6.0)
    assert (flight.mock.flight.mode, flight.mock.flight.failsafe) == ("rtl", True)
    flight.listen(2.0)
    assert (flight.mock.flight.mode, flight.mock.flight.failsafe) == ("rtl", False)


def test_a_restored_link_does_not_stop_px4s_return() -> None:
    flight = Flight(PX4, {**PX4_DEFAULTS, "NAV_DLL_ACT": 2.0}, "mission")
    flight.silence(12.0)
    assert flight.mock.flight.mode == "hold"
    flight.listen(5.0)
    assert (flight.mock.flight.mode, flight.mock.flight.failsafe) == ("rtl", True)


@pytest.mark.parametrize("value", [5.0, 6.0])
def test_a_terminated_vehicle_falls(value: float) -> None:
    flight = Flight(PX4_COPTER, {**PX4_DEFAULTS, "NAV_DLL_ACT": value}, "mission")
    flight.silence(30.0)
    assert flight.mock.flight.crashed
    assert not flight.mock.flight.armed
