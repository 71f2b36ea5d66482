"""Defines the core's state of one vehicle, for all ways of flying."""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from autopilot_bridge.stacks.return_flight import UNREAD, ReturnFlight
from autopilot_bridge.transitions import enter
from mission_service.commands import Announce
from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import Landing
from mission_service.vehicles.availability import VehicleAirData, VehicleAvailability
from mission_service.vehicles.battery_reports import BatteryReports
from mission_service.vehicles.energy import EnergyState
from mission_service.vehicles.landing_state import LandingState
from mission_service.vehicles.preflight_state import PreflightState, SignOff
from mission_service.vehicles.remote_id_state import RemoteIdReport

Floats = NDArray[np.float64]
HISTORY_LENGTH = 20  # number of phases listed in the error about an invalid transition


class MissionPhase(Enum):
    """The phases of a vehicle's next mission, up to its outcome."""

    NONE = "none"
    PROPOSED = "proposed"  # proposed to the operators
    UPLOADING = "uploading"
    ACCEPTED = "accepted"  # accepted by the autopilot
    FAILED = "failed"
    REFUSED = "refused"  # refused by an operator, or similar to a refused mission
    WITHDRAWN = "withdrawn"
    # Dropped during its upload, by a restart or because it is no longer needed.
    DROPPED = "dropped"


_NEXT = (MissionPhase.UPLOADING,)
MISSION_TRANSITIONS: dict[MissionPhase, tuple[MissionPhase, ...]] = {
    **dict.fromkeys(MissionPhase, _NEXT),
    MissionPhase.PROPOSED: (*_NEXT, MissionPhase.REFUSED, MissionPhase.WITHDRAWN),
    MissionPhase.UPLOADING: (
        *(*_NEXT, MissionPhase.PROPOSED, MissionPhase.ACCEPTED),
        *(MissionPhase.FAILED, MissionPhase.REFUSED, MissionPhase.DROPPED),
    ),
}
UNDECIDED = (MissionPhase.PROPOSED, MissionPhase.UPLOADING)


@dataclass
class Pending:
    """A mission that is proposed or being uploaded."""

    mission_id: int
    line: shapely.LineString
    takes_off: bool = False  # whether the first item is a takeoff
    due: str = ""  # the reason why the mission was due at once
    evades: bool = False  # whether the mission leaves or avoids closed airspace
    lands: bool = False  # whether the mission only lands


@dataclass(frozen=True)
class Refusal:
    """A proposed mission that an operator refused; similar missions are not proposed again."""

    by: str
    due: str  # the reason why the mission was due at once; else empty
    line: shapely.LineString


@dataclass
class UnconfirmedState:
    """The state at the end of the last run, which the vehicle has not yet confirmed."""

    pending: Pending | None
    recalled: bool  # whether the vehicle was ordered home
    starting: bool
    resumed: bool = False  # an operator has ordered "resume"; the start follows the read-back


@dataclass
class Vehicle:
    """The core's state of one vehicle."""

    section: VehicleSection
    availability: VehicleAvailability
    home_m: tuple[float, float]
    landing: Landing  # the landing of the vehicle's missions
    atomic_upload: bool = False
    deployed: bool = False
    started: bool = False
    holding: bool = False
    ordered: Literal["", "hold"] = ""  # an operator's order
    hold_under_way_s: float | None = None  # time at which a hold without acknowledgement was sent
    hold_again_at_s: float | None = None  # time of the next hold, until the autopilot accepts it
    # Latitude, longitude and altitude (m AMSL) of a hold that is not at the current position.
    hold_at: tuple[float, float, float] | None = None
    # The vehicle has flown, or the scenario requires it; the next start requires an operator's
    # order, which signs off the pre-flight checks.
    waits_for_operator: bool = False
    signed_off: SignOff | None = None  # until the takeoff, or until the sign-off ends
    preflight: PreflightState = field(default_factory=PreflightState)
    start_again_at_s: float | None = None
    takeoff_waits: str = ""  # why a takeoff that is due waits, as last announced
    return_again_at_s: float | None = None
    going_home: bool = False  # whether the remaining energy is needed for the flight home
    sent_home: bool = False
    lands_after_return: bool = False  # a relieved plane lands instead of circling at home
    next_mission: Pending | None = None  # the mission that is proposed or being uploaded
    mission_phases: deque[MissionPhase] = field(
        default_factory=lambda: deque([MissionPhase.NONE], HISTORY_LENGTH)
    )
    refusal: Refusal | None = None
    landing_state: LandingState = field(default_factory=LandingState)
    airspeed_m_s: float | None = None  # mean of the measured airspeeds
    # Time since which the measured airspeed differs from the commanded airspeed.
    airspeed_differs_since_s: float | None = None
    airspeed_alarm: bool = False
    air_data: VehicleAirData | None = None  # as measured in flight
    battery: BatteryReports = field(default_factory=BatteryReports)
    energy: EnergyState = field(default_factory=EnergyState)
    text_at_s: float | None = None  # time of the last text that raised an alarm
    flown_line: shapely.LineString | None = None  # path of the confirmed mission on board
    remote_id: RemoteIdReport = field(default_factory=RemoteIdReport)
    silent_links: tuple[str, ...] = ()  # those of several links that are silent
    lost_link: str = ""  # its lost-link reaction in words; empty if unknown
    lost_link_problem: str = ""  # what is wrong with this reaction, and the remedy
    reported_kind: str = ""  # from its autopilot's parameters; empty if unknown
    reported_stack: str = ""  # from its heartbeat; empty if unknown
    return_flight: ReturnFlight = UNREAD  # from its parameters, as far as they were read
    current_seq: int = 0  # index of the current mission item, as last reported
    takes_off: bool = False  # whether the vehicle is flying its mission's takeoff item
    uploaded_at_s: float = -1e9
    upload_ended_at_s: float = -1e9
    not_before_s: float = -1e9
    due: str = ""  # the reason why a new mission is due at once
    mode: str = ""  # mode in the last report
    accepted: Pending | None = None  # the last mission that the autopilot accepted
    start_under_way: bool = False
    start_confirmed: bool = False  # the mission was started, and has not ended since
    unconfirmed: UnconfirmedState | None = None  # set by a restart until the mission is read back
    read_back: Literal["", "same", "new", "unknown"] = ""

    @property
    def name(self) -> str:
        """The vehicle's name in the scenario."""
        return self.section.name

    @property
    def awaits_mission(self) -> bool:
        """Whether a mission is being uploaded or is awaiting an operator's approval."""
        return self.next_mission is not None

    @property
    def pending(self) -> Pending | None:
        """The mission that is being uploaded."""
        return self.next_mission if self.mission_phases[-1] is MissionPhase.UPLOADING else None

    @property
    def proposed(self) -> Pending | None:
        """The mission that is awaiting an operator's approval."""
        return self.next_mission if self.mission_phases[-1] is MissionPhase.PROPOSED else None

    @property
    def start_is_pending(self) -> bool:
        """Whether a start is under way, is to be repeated, or is to follow an upload."""
        was_starting = self.unconfirmed is not None and self.unconfirmed.starting
        pending = self.start_under_way or self.holding or was_starting
        return pending or self.start_again_at_s is not None

    def enter(self, phase: MissionPhase, mission: Pending | None = None) -> None:
        """Change the phase of the next mission. Raises InvalidTransitionError."""
        enter(self.mission_phases, phase, MISSION_TRANSITIONS, f"next mission of {self.name}")
        self.next_mission = mission

    def drop_upload(self) -> None:
        """Drop the mission that is being uploaded, if any; its outcome is then ignored."""
        if self.pending is not None:
            self.enter(MissionPhase.DROPPED)

    def validate_state(self) -> None:
        """Check the invariants between two events; raises AssertionError. For tests."""
        phase, line = self.mission_phases[-1], self.flown_line
        assert (self.next_mission is not None) == (phase in UNDECIDED), f"{self.name}: {phase}"
        is_accepted = self.accepted is not None and line is self.accepted.line
        assert line is None or is_accepted, f"{self.name}: flies a line that was not accepted"
        landing = self.landing_state.shown
        assert landing == self.availability.landing, f"{self.name}: landing {landing}"
        assert self.ordered or self.hold_again_at_s is None, f"{self.name}: holds without an order"
        signed = self.signed_off is not None
        flies = self.availability.airborne or self.waits_for_operator
        assert not (signed and flies), f"{self.name}: signed off in the air, or although it waits"

    def end_intentions(self) -> None:
        """Cancel commands that are due to be repeated or to follow another command."""
        self.start_again_at_s = self.return_again_at_s = None
        self.holding = self.start_under_way = False
        self.end_sign_off()

    def end_sign_off(self) -> None:
        """End the sign-off of a takeoff that has not begun: the vehicle waits for another one."""
        if self.signed_off is not None:
            self.signed_off, self.waits_for_operator = None, True


def announce(vehicle: Vehicle, text: str, warning: bool = False) -> Announce:
    """Return an announcement for the operator."""
    return Announce(vehicle.name, text, "warning" if warning else "info")
