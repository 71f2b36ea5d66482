"""Remote ID that the scenario requires: the pre-flight check, and the alarm in flight."""

from pathlib import Path

import pytest

from autopilot_bridge.mock.fault_injection import REMOTE_ID_ERROR
from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, ClearAlarm, RaiseAlarm
from mission_service.config.scenario import load_scenario
from mission_service.events import LinkLost, LinkRestored, RemoteIdChanged
from mission_service.fire.scenario_fire import landscape_of
from tests.api.worlds import scenario_of, world_in
from tests.service.test_preflight import REASON, WAITS, Ground, starts, texts

REQUIRED = "preflight.remote_id=true"
NAME = "Remote ID"


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


def module(ground: Ground, state: str, text: str = "") -> list[AnyCommand]:
    event = RemoteIdChanged(ground.at_us, "hawk", state, text)  # type: ignore[arg-type]
    return ground.handle(event)


def of_alarm(commands: list[AnyCommand]) -> list[str]:
    """Return the texts of raised alarms about Remote ID, and "cleared"."""
    kinds = (RaiseAlarm, ClearAlarm)
    found = [each for each in commands if isinstance(each, kinds) and each.alarm == "remote_id"]
    return [each.text if isinstance(each, RaiseAlarm) else "cleared" for each in found]


def fly(ground: Ground, seconds: float) -> list[AnyCommand]:
    """Report positions in the air; return all commands."""
    begun = len(ground.sent)
    for _ in range(round(seconds)):
        ground.at(100.0)
    return ground.sent[begun:]


@pytest.mark.parametrize(
    ("state", "text", "words"),
    [
        ("", "", "no message was received from a Remote ID module: check its power and its wiring"),
        ("fails", "no GPS lock", "fails: no GPS lock: correct its error"),
        ("lost", "silent for 5 s", "lost: silent for 5 s: check its power and its wiring"),
    ],
)
def test_a_required_module_that_is_not_ready_prevents_the_takeoff(
    land: Landscape, state: str, text: str, words: str
) -> None:
    ground = Ground(land, WAITS, REQUIRED)
    if state:
        module(ground, "ready")
    ground.stands()
    if state:
        assert ground.check(NAME) == ("pass", "ready")
        module(ground, state, text)
    assert ground.check(NAME) == ("fail", words)
    refused = ground.order("takeoff", override=REASON)
    assert not starts(refused)
    assert texts(refused) == (
        f"rejected: hawk: Remote ID: {words}; this check cannot be overridden"
    )
    module(ground, "ready")
    assert starts(ground.order("takeoff"))


def test_an_automatic_start_is_delayed_until_the_module_is_ready(land: Landscape) -> None:
    ground = Ground(land, "vehicles.0.autostart=true", REQUIRED)
    assert not starts(ground.stands())
    module(ground, "ready")
    assert starts(ground.stands())


def test_a_module_that_is_not_required_is_shown_and_prevents_nothing(land: Landscape) -> None:
    ground = Ground(land, WAITS)
    ground.stands()
    assert NAME not in [check.name for check in ground.vehicle.preflight.checks]
    module(ground, "fails", "no GPS lock")
    expected = ("unknown", "fails: no GPS lock; the scenario does not require it")
    assert ground.check(NAME) == expected
    assert starts(ground.order("takeoff"))
    ground.mode("mission")
    assert of_alarm(fly(ground, 30.0)) == []


def test_in_flight_its_failure_raises_an_alarm_with_its_text_until_it_is_ready(
    land: Landscape,
) -> None:
    ground = Ground(land, WAITS, REQUIRED)
    module(ground, "ready")
    ground.stands()
    assert starts(ground.order("takeoff"))
    ground.mode("mission")
    assert of_alarm(fly(ground, 10.0)) == []
    module(ground, "fails", "no GPS lock")
    raised = fly(ground, 10.0)
    assert of_alarm(raised) == ["Remote ID: fails: no GPS lock"]
    (alarm,) = [each for each in raised if isinstance(each, RaiseAlarm)]
    assert alarm.severity == "severe"
    module(ground, "lost", "silent for 5 s")
    assert of_alarm(fly(ground, 10.0)) == ["Remote ID: lost: silent for 5 s"]
    module(ground, "ready")
    assert of_alarm(fly(ground, 2.0)) == ["cleared"]


def test_an_interruption_of_the_link_is_no_failure_of_the_module(land: Landscape) -> None:
    ground = Ground(land, WAITS, REQUIRED)
    module(ground, "ready")
    ground.stands()
    ground.order("takeoff")
    ground.mode("mission")
    fly(ground, 10.0)
    begun = len(ground.sent)
    ground.handle(LinkLost(ground.at_us, "hawk", 3.0))
    module(ground, "lost", "silent for 5 s")
    ground.at_s += 60.0
    ground.handle(LinkRestored(ground.at_us, "hawk"))
    fly(ground, 2.0)
    module(ground, "ready")
    fly(ground, 10.0)
    assert of_alarm(ground.sent[begun:]) == []


def test_the_simulated_vehicle_has_a_module_and_its_fault_is_an_alarm(tmp_path: Path) -> None:
    scenario = scenario_of("demo", ("planner.rule=circling", REQUIRED))
    world = world_in(tmp_path, scenario)
    world.fly(scenario.deploy_at_s + 60.0)
    state_view = world.simulation.service.state_view
    assert state_view.vehicles["hawk"].armed
    assert state_view.vehicles["hawk"].remote_id == "ready"
    world.simulation.rigs[0].mock.telemetry.remote_id_error = REMOTE_ID_ERROR
    world.fly(world.now_s + 10.0)
    alarm = state_view.alarms["remote_id/hawk"]
    assert alarm.severity == "severe"
    assert alarm.text == f"hawk: Remote ID: fails: {REMOTE_ID_ERROR}"
    world.simulation.rigs[0].mock.telemetry.remote_id_error = ""
    world.fly(world.now_s + 10.0)
    assert "remote_id/hawk" not in state_view.alarms
