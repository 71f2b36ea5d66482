"""A vehicle with refusals, losses, failsafes, orders and landings; and cores with defects."""

from collections import Counter
from typing import Any, ClassVar

import pytest

from autopilot_bridge.transitions import InvalidTransitionError
from mission_service.commands import AnyCommand, Hold, StartMission
from mission_service.core.core import Core
from mission_service.events import AnyEvent, Telemetry, UploadFinished
from mission_service.vehicles.availability import GOING_HOME
from mission_service.vehicles.vehicle_state import MissionPhase, Vehicle
from tests.service.vehicle_machine import VehicleMachine, run
from tests.service.vehicle_sites import BURNS, SETTINGS, site_of

STEPS, SEED = 30, 21
FRONTS = tuple(SETTINGS)[:-1]


@pytest.mark.parametrize(
    ("flown", "examples"),
    [(FRONTS, 80), (("formation",), 8), (tuple(BURNS), 10)],
    ids=["front", "formation", "burn"],
)
def test_no_vehicle_is_started_or_taken_over_without_a_person(
    flown: tuple[str, ...], examples: int
) -> None:
    class Machine(VehicleMachine):
        sites = flown
        met: ClassVar[Counter[str]] = Counter()

    run(Machine, examples, STEPS, SEED, shrinks=True)
    for each in ("landed", "killed", "commanded: StartMission"):
        assert Machine.met[each] > 0, f"{each}: never; the machine does not get there"


class StartsAgainAfterALanding(Core):
    """A defect: a pending start is not cancelled when the vehicle lands."""

    def _disarmed(self, vehicle: Vehicle, was_airborne: bool) -> list[AnyCommand]:
        again_at_s, waits = vehicle.start_again_at_s, vehicle.waits_for_operator
        commands = super()._disarmed(vehicle, was_airborne)
        vehicle.start_again_at_s, vehicle.waits_for_operator = again_at_s, waits
        return commands


class StartsWhateverItUploads(Core):
    """A defect: an uploaded mission is started in any mode."""

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = super().handle(event)
        if isinstance(event, UploadFinished) and event.outcome == "accepted":
            starts = StartMission(event.vehicle)
            if self.vehicles[event.vehicle].started and starts not in commands:
                commands.append(starts)
        return commands


class HoldsAgainInAFailsafe(Core):
    """A defect: a hold is repeated until it is accepted, regardless of the autopilot's mode."""

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = super().handle(event)
        if isinstance(event, Telemetry):
            vehicle = self.vehicles[event.vehicle]
            if vehicle.ordered == "hold" and vehicle.mode in GOING_HOME:
                commands.append(Hold(event.vehicle))
        return commands


class SeesNoFailsafe(Core):
    """A defect: every mode counts as ordered."""

    def _handle(self, event: AnyEvent) -> list[AnyCommand]:
        for availability in self.decision_engine.availability.values():
            availability.mode_is_ordered = True
        return super()._handle(event)


class StartsAfterARestart(Core):
    """A defect: after its restart on the ground, an autopilot is started without an order."""

    def _rebooted(self, vehicle: Vehicle, at_s: float, was: Any) -> list[AnyCommand]:
        commands = super()._rebooted(vehicle, at_s, was)
        vehicle.waits_for_operator = False
        return commands


@pytest.mark.parametrize(
    ("broken", "rule"),
    [
        pytest.param(StartsAgainAfterALanding, "started after", marks=pytest.mark.long),
        (StartsWhateverItUploads, "started after|StartMission to one that was taken"),
        pytest.param(
            *(HoldsAgainInAFailsafe, "Hold to one that was taken"), marks=pytest.mark.long
        ),
        (SeesNoFailsafe, "to one that was taken|no question: order start"),
        pytest.param(StartsAfterARestart, "started after", marks=pytest.mark.long),
    ],
)
def test_a_core_that_is_broken_on_purpose_is_found(broken: type[Core], rule: str) -> None:
    class Machine(VehicleMachine):
        core = broken
        sites = FRONTS
        met: ClassVar[Counter[str]] = Counter()

    with pytest.raises(AssertionError, match=rule):
        run(Machine, 3000, STEPS, SEED)  # it ends at the first violation


def test_a_mission_that_is_not_uploaded_is_not_accepted() -> None:
    site = site_of(FRONTS[0])
    core = Core(site.scenario, site.landscape)
    vehicle = next(iter(core.vehicles.values()))
    vehicle.drop_upload()  # there is no violation
    core.validate_state()
    with pytest.raises(InvalidTransitionError, match="transition to accepted is not allowed"):
        vehicle.enter(MissionPhase.ACCEPTED)
    vehicle.mission_phases.append(MissionPhase.UPLOADING)
    with pytest.raises(AssertionError, match="UPLOADING"):
        core.validate_state()
