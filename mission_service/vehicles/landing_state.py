"""Defines the phases of a vehicle's landing, as a state machine with a table of transitions.

none --order, free field--> sending --mission accepted and flown--> approach --final leg--> final
none --order, another lands--> waiting --free field--> sending; multirotors: approach (a return)
final --go-around--> going around --at the height of the approach--> none, holding any --landed,
another order, a mode that was not ordered, failure--> none
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum

from autopilot_bridge.transitions import enter
from mission_service.commands import LandingPhaseName
from mission_service.missions.landing_mission import LandingMission

HISTORY_LENGTH = 20  # number of phases listed in the error about an invalid transition


class LandingPhase(Enum):
    """The phases of a landing."""

    NONE = "none"
    WAITING = "waiting"  # until another vehicle has landed at the same field
    SENDING = "sending"  # the landing mission is sent and started
    APPROACH = "approach"  # on the way to the final leg
    FINAL = "final"  # on the final leg, or on the ground and not yet disarmed
    GOING_AROUND = "going around"


LANDING_TRANSITIONS: dict[LandingPhase, tuple[LandingPhase, ...]] = {
    LandingPhase.NONE: (LandingPhase.WAITING, LandingPhase.SENDING, LandingPhase.APPROACH),
    LandingPhase.WAITING: (LandingPhase.SENDING, LandingPhase.APPROACH, LandingPhase.NONE),
    LandingPhase.SENDING: (LandingPhase.APPROACH, LandingPhase.NONE),
    LandingPhase.APPROACH: (LandingPhase.FINAL, LandingPhase.NONE),
    LandingPhase.FINAL: (LandingPhase.GOING_AROUND, LandingPhase.NONE),
    # A refused go-around leaves the vehicle on its final leg.
    LandingPhase.GOING_AROUND: (LandingPhase.FINAL, LandingPhase.NONE),
}
# Time in seconds after which a phase that has not ended raises an alarm.
LIMITS_S = {
    LandingPhase.WAITING: 300.0,
    LandingPhase.SENDING: 120.0,
    LandingPhase.APPROACH: 900.0,
    LandingPhase.FINAL: 240.0,
    LandingPhase.GOING_AROUND: 120.0,
}


@dataclass
class LandingState:
    """The landing of one vehicle."""

    phases: deque[LandingPhase] = field(
        default_factory=lambda: deque([LandingPhase.NONE], HISTORY_LENGTH)
    )
    since_s: float = 0.0  # time of the last phase change
    rank: int = 0  # order among vehicles that begin to wait at the same time
    mission: LandingMission | None = None  # the landing mission sent last
    seq: int = 0  # current item as reported since that mission was accepted
    failures: int = 0  # uploads and starts of landing missions that failed in this landing
    again_at_s: float | None = None  # time of the next attempt after a failure
    held: bool = False  # whether a hold was sent after a failure, until the next attempt
    start_again_at_s: float = 0.0  # time of the next start of the mission on board, if one is due
    alarm: bool = False  # whether the alarm about the landing is raised

    @property
    def landing_phase(self) -> LandingPhase:
        """The current phase."""
        return self.phases[-1]

    @property
    def shown(self) -> LandingPhaseName:
        """The name of the phase in commands and interfaces."""
        return self.landing_phase.value

    @property
    def active(self) -> bool:
        """Whether the vehicle is landing or waiting to land."""
        return self.landing_phase is not LandingPhase.NONE

    @property
    def uses_field(self) -> bool:
        """Whether other vehicles must wait before they land."""
        return self.landing_phase not in (LandingPhase.NONE, LandingPhase.WAITING)

    def turn(self, vehicle: str) -> tuple[float, int, str]:
        """Return the sort key of the vehicles that are waiting to land."""
        return self.since_s, self.rank, vehicle

    def enter(self, phase: LandingPhase, at_s: float, vehicle: str) -> None:
        """Change the phase. Raises InvalidTransitionError."""
        enter(self.phases, phase, LANDING_TRANSITIONS, f"landing of {vehicle}")
        self.since_s = at_s
        self.again_at_s, self.held = None, False
