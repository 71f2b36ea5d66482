"""An order to hold or return just before the service ends, and the modes reported after its start.

The service may end before the vehicle has reported the mode that was ordered.
"""

from pathlib import Path

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    Hold,
    RaiseAlarm,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    SERVICE,
    Aborted,
    AnyEvent,
    CommandFinished,
    LandedStateChanged,
    MissionReadBack,
    ModeChanged,
    Order,
    OrderGiven,
    Resumed,
    SystemStateChanged,
    UploadFinished,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.vehicles.availability import VehicleAvailability
from tests.service.test_core import airborne, kinds
from tests.service.test_read_back_missions import Flight, alone

PAUSES_S = (1.0, 70.0, 86_400.0)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


class Ended:
    """A vehicle in its mission that is ordered to hold or return while the service ends."""

    def __init__(self, land: Landscape, order: Order = "hold", accepted: bool = True) -> None:
        self.flight, mission = airborne(land, atomic=True)
        self.mission_id = mission.mission_id
        self.flight.finished(self.mission_id, "accepted")
        self._mode("mission")
        self._order(order, SERVICE)
        if accepted:
            self._accepted(order)

    @property
    def availability(self) -> VehicleAvailability:
        return self.flight.core.vehicles["hawk"].availability

    def _handle(self, event: AnyEvent) -> list[AnyCommand]:
        return self.flight.handle(event)

    def _order(self, order: Order, by: str) -> list[AnyCommand]:
        return self._handle(OrderGiven(self.flight.at_us, by, "", "hawk", order))

    def _accepted(self, order: str, accepted: bool = True) -> None:
        self._handle(CommandFinished(self.flight.at_us, "hawk", order, accepted, ""))

    def _mode(self, mode: str, armed: bool = True) -> list[AnyCommand]:
        return self._handle(ModeChanged(self.flight.at_us, "hawk", 0, armed, mode))

    def restart(self, pause_s: float) -> None:
        self.flight.at_us += round(pause_s * 1e6)
        self._handle(Resumed(self.flight.at_us, "service", "", pause_s))

    def reports(
        self, mode: str, armed: bool = True, system: str = "active", landed: str = "in air"
    ) -> list[AnyCommand]:
        """Report all states after the restart, as a gateway does; return the commands."""
        at_us = self.flight.at_us
        found = self._handle(VehicleConnected(at_us, "hawk", "a stack", True))
        found += self._mode(mode, armed)
        found += self._handle(SystemStateChanged(at_us, "hawk", system))
        found += self._handle(LandedStateChanged(at_us, "hawk", landed))
        height_m = 80.0 if landed == "in air" else 0.0
        found += self.flight.at_height(height_m, later_s=0.1)
        found += self._handle(MissionReadBack(self.flight.at_us, "hawk", self.mission_id, 5))
        return found + self.flight.at_height(height_m, later_s=0.5)


def alarms(commands: list[AnyCommand]) -> list[str]:
    return [each.alarm for each in commands if isinstance(each, RaiseAlarm)]


def acts(commands: list[AnyCommand]) -> list[type]:
    changing = (StartMission, UploadMission, Hold, Return)
    return [type(each) for each in commands if isinstance(each, changing)]


def is_asked(commands: list[AnyCommand]) -> bool:
    return any(isinstance(each, Announce) and each.text[:8] == "confirm:" for each in commands)


@pytest.mark.parametrize("pause_s", PAUSES_S)
@pytest.mark.parametrize("order", ["hold", "return"])
def test_a_mode_ordered_before_the_pause_counts_as_ordered(
    land: Landscape, order: Order, pause_s: float
) -> None:
    ended = Ended(land, order)
    ended.restart(pause_s)
    found = ended.reports(order)
    assert alarms(found) == []
    assert acts(found) == []
    assert not ended.availability.taken_over
    assert not is_asked(ended._order("resume", "ann"))


def test_a_restart_before_the_vehicle_is_connected_changes_nothing(land: Landscape) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    ended.restart(600.0)
    assert alarms(ended.reports("hold")) == []


@pytest.mark.parametrize("mode", ["manual", "position", "guided", "circle", "return", "land"])
def test_another_mode_was_not_ordered(land: Landscape, mode: str) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    found = ended.reports(mode)
    assert alarms(found) == ["mode"]
    assert acts(found) == []
    assert is_asked(ended._order("resume", "ann"))


def test_only_the_first_report_can_be_the_mode_that_was_ordered(land: Landscape) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    ended.reports("manual")
    assert alarms(ended._mode("hold")) == ["mode"]
    assert ended.availability.taken_over


def test_a_vehicle_still_in_its_mission_is_ordered_to_hold_again(land: Landscape) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    assert acts(ended.reports("mission")) == [Hold]
    assert alarms(ended._mode("hold")) == []


@pytest.mark.parametrize("reported", [False, True], ids=["not reported", "reported"])
@pytest.mark.parametrize("order", ["hold", "return"])
def test_a_failsafe_in_the_same_mode_was_not_ordered(
    land: Landscape, order: Order, reported: bool
) -> None:
    ended = Ended(land, order)
    if reported:
        ended._mode(order)
    ended.restart(600.0)
    found = ended.reports(order, system="critical")
    assert sorted(alarms(found)) == ["mode", "state"]
    assert acts(found) == []
    assert is_asked(ended._order("resume", "ann"))
    ended._handle(SystemStateChanged(ended.flight.at_us, "hawk", "active"))
    assert is_asked(ended._order("resume", "ann"))  # the cause of the hold has not changed


def test_a_vehicle_on_the_ground_and_armed_is_not_in_the_hold_that_was_ordered(
    land: Landscape,
) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    found = ended.reports("hold", landed="on ground")
    assert sorted(alarms(found)) == ["landed", "mode"]
    assert acts(found) == []
    assert is_asked(ended._order("resume", "ann"))


def test_a_vehicle_that_has_landed_is_not_started(land: Landscape) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    found = ended.reports("hold", armed=False, landed="on ground")
    assert StartMission not in acts(found)
    # Armed again by its pilot, in the same mode: not the hold that was ordered in flight.
    again = ended._mode("hold") + ended.flight.at_height(0.0) + ended.flight.at_height(20.0)
    assert set(alarms(again)) == {"mode"}
    assert StartMission not in acts(again)


@pytest.mark.parametrize("refused", [False, True], ids=["no answer", "refused"])
def test_a_hold_that_was_not_accepted_was_not_ordered(land: Landscape, refused: bool) -> None:
    ended = Ended(land, accepted=False)
    if refused:
        ended._accepted("hold", accepted=False)
    ended.restart(600.0)
    assert alarms(ended.reports("hold")) == ["mode"]


def test_a_hold_accepted_long_before_the_end_and_never_reported_was_not_ordered(
    land: Landscape,
) -> None:
    ended = Ended(land)
    ended.flight.at_height(80.0, later_s=30.0)
    ended.restart(600.0)
    assert alarms(ended.reports("hold")) == ["mode"]


def test_a_hold_of_the_service_itself_was_not_ordered(land: Landscape) -> None:
    """The service ends such a hold by itself, so a pilot's hold must not be mistaken for it."""
    flight, mission = airborne(land, atomic=False)
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, True, "mission"))
    failed = UploadFinished(flight.at_us, "hawk", mission.mission_id, "failed", "because")
    assert Hold in kinds(flight.handle(failed))
    ended = Ended.__new__(Ended)
    ended.flight, ended.mission_id = flight, mission.mission_id
    ended._accepted("hold")
    ended.restart(600.0)
    found = ended.reports("hold")
    assert alarms(found) == ["mode"]
    assert acts(found) == []


def test_after_an_abort_the_hold_counts_as_ordered(land: Landscape) -> None:
    ended = Ended(land, "resume")
    ended._handle(Aborted(ended.flight.at_us, "ann", ""))
    ended._accepted("hold")
    ended.restart(600.0)
    assert alarms(ended.reports("hold")) == []


def test_a_failsafe_after_a_new_order_leaves_the_order_valid(land: Landscape) -> None:
    ended = Ended(land)
    ended.restart(600.0)
    ended.reports("hold")
    ended._order("hold", "ann")
    ended._accepted("hold")
    ended._handle(SystemStateChanged(ended.flight.at_us, "hawk", "critical"))
    assert not ended.availability.taken_over


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_vehicle_held_at_the_end_is_resumed_after_a_quarter_of_an_hour(
    tmp_path: Path, stack: str
) -> None:
    flight = Flight(tmp_path, alone(stack))
    flight.fly(60.0)
    simulation = flight.simulation
    order = OrderGiven(simulation.clock.now_us, SERVICE, "", "", "hold")
    simulation.service.submit(order, simulation.link_us)
    while not simulation.service.acknowledged_by("hold", order.at_us):
        simulation.step()
    assert flight.modes == ["mission"]  # the heartbeat with the new mode has not arrived
    flight.begin_again(down_us=900_000_000)
    flight.fly(15.0)
    entries = flight.after_resumed()
    assert alarms(entries) == []
    read_at = next(at for at, each in enumerate(entries) if isinstance(each, MissionReadBack))
    modes = [each.mode for each in entries[:read_at] if isinstance(each, ModeChanged)]
    assert modes == ["hold"]
    flight.give_order("resume")
    flight.fly(30.0)
    assert flight.modes == ["mission"]


def test_a_mode_that_was_not_ordered_is_announced_once_after_a_restart(tmp_path: Path) -> None:
    flight = Flight(tmp_path, alone("px4"))
    flight.fly(60.0)
    (rig,) = flight.simulation.rigs
    rig.mock.flight.set_mode("orbit", flight.simulation.link_us / 1e6)
    flight.begin_again()
    flight.fly(15.0)
    entries = flight.after_resumed()
    assert alarms(entries) == ["mode"]
