"""A vehicle through refusals, losses, failsafes, orders and landings; and cores that are broken."""

from collections import Counter

import pytest

from mission_service.commands import AnyCommand, Hold, StartMission
from mission_service.core import Core
from mission_service.events import AnyEvent, ModeChanged, Telemetry, UploadFinished
from tests.service.vehicle_machine import VehicleMachine, run

EXAMPLES, STEPS = 120, 30


def test_no_vehicle_is_started_or_taken_over_without_a_person() -> None:
    class Machine(VehicleMachine):
        met = Counter()

    run(Machine, EXAMPLES, STEPS, seed=20, shrinks=True)
    met = Machine.met
    for each in ("landed", "killed", "commanded: StartMission", "commanded: Return"):
        assert met[each] > 10, f"{each}: {met[each]} times; the machine does not get there"


class StartsAgainAfterALanding(Core):
    """A start that was refused is not forgotten when the vehicle lands."""

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        pending = {name: each.start_again_at_s for name, each in self.vehicles.items()}
        commands = super().handle(event)
        if isinstance(event, ModeChanged) and not event.armed:
            vehicle = self.vehicles[event.vehicle]
            vehicle.start_again_at_s = pending[event.vehicle]
        return commands


class StartsWhateverItUploads(Core):
    """A mission that has arrived is started in any mode."""

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = super().handle(event)
        if isinstance(event, UploadFinished) and event.outcome == "accepted":
            vehicle = self.vehicles[event.vehicle]
            if vehicle.started and StartMission(event.vehicle) not in commands:
                commands.append(StartMission(event.vehicle))
        return commands


class HoldsAgainInAFailsafe(Core):
    """A hold is repeated until it is accepted, whatever the autopilot does meanwhile."""

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = super().handle(event)
        if isinstance(event, Telemetry):
            vehicle = self.vehicles[event.vehicle]
            if vehicle.ordered == "hold" and vehicle.mode == "return":
                commands.append(Hold(event.vehicle))
        return commands


@pytest.mark.parametrize(
    ("broken", "rule"),
    [
        (StartsAgainAfterALanding, "started after"),
        (StartsWhateverItUploads, "StartMission to one that was taken"),
        (HoldsAgainInAFailsafe, "Hold to one that was taken"),
    ],
)
def test_a_broken_core_is_found(broken: type[Core], rule: str) -> None:
    class Machine(VehicleMachine):
        core = broken
        met = Counter()

    with pytest.raises(AssertionError, match=rule):
        run(Machine, EXAMPLES, STEPS, seed=20)
