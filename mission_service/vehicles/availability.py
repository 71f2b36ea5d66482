"""Determines a vehicle's availability to planners from link, mode, failsafe and position. Pure."""

import math
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from mission_service.commands import (
    ORDER_NAMES,
    AnyCommand,
    ClimbAndHold,
    GoAround,
    Hold,
    HoldAt,
    Land,
    LandingPhaseName,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.events import Order
from mission_service.position_fix import PositionFix
from mission_service.vehicles.ground_altitude import GroundAltitude
from mission_service.vehicles.landing_state import LIMITS_S, LandingPhase

AIRBORNE_M = 15.0
GOING_HOME = ("return", "land", "qrtl", "qland")  # modes, by the bridge's names
MISSION = "mission"
# The modes (by the bridge's names) that each of the service's commands causes. Any other mode was
# selected by the autopilot or the pilot. During an upload ArduPilot is commanded to hold, and PX4
# holds if it rejects the new mission.
LEADS_TO: dict[type[AnyCommand], tuple[str, ...]] = {
    StartMission: (MISSION, "guided", "takeoff", "ready"),
    UploadMission: (MISSION, "hold"),
    Hold: ("hold", "guided"),
    Return: ("return", "qrtl"),  # a quadplane with Q_RTL_MODE ends its return in QRTL
    Land: (MISSION,),
    GoAround: ("hold", "guided", MISSION),
    Orbit: ("guided", "orbit", "hold"),
    ClimbAndHold: ("guided", "hold"),
    HoldAt: ("guided", "hold"),
}
# The modes that last until the next order. The service may end before the vehicle reports the mode.
LASTING: dict[type[AnyCommand], str] = {Hold: "hold", Return: "return"}
ANSWERS = {name: kind for kind, name in ORDER_NAMES.items() if kind in LEADS_TO}
HAS_LANDED = "it has landed, but is not disarmed yet"
UNANSWERED_S = 60.0  # time in which an unacknowledged command may change the mode
TAKES_EFFECT_S = 5.0  # time in which an acknowledged command may change the mode
FAILSAFE_STATES = ("critical", "emergency", "flight termination")  # HEARTBEAT.system_status


def named_mode(mode: str) -> str:
    """Return a mode with the word "mode"; the bridge's name may be only a number (``mode 0``)."""
    return f"mode {mode.removeprefix('mode ')}" if mode else "an unknown mode"


WIND_IS_FRESH_S = 120.0  # an older measured wind is not used


class MeasuredWind(NamedTuple):
    """The wind measured by a vehicle, and the direction from which it blows."""

    at_s: float
    speed_m_s: float
    from_deg: float


class VehicleAirData(NamedTuple):
    """The true airspeed and the wind derived from a plane's flight on several headings.

    ``airspeed_factor`` is the ratio of the true airspeed to the true airspeed computed from the
    measured airspeed in the standard atmosphere.
    """

    airspeed_factor: float
    wind: MeasuredWind


@dataclass(slots=True)
class VehicleAvailability:
    """The state that determines whether planners may use a vehicle."""

    online: bool = False
    airborne: bool = False
    recalled: bool = False  # whether the vehicle flies home, or is ordered home
    recalled_on_ground: bool = False  # whether the vehicle was ordered home before takeoff
    took_off_at_s: float = np.inf
    measured_wind: MeasuredWind | None = None
    height_m: float = 0.0  # last reported height above home
    landing: LandingPhaseName = "none"  # phase of a landing that the service controls
    off_task: bool = False  # whether another vehicle flies the task, so that no decisions are made
    mode: str = ""  # mode in the last report
    armed: bool = False
    mode_is_ordered: bool = True  # False if the autopilot or the pilot selected the mode
    restarted_in_air: bool = False  # the autopilot was restarted, and has not reported a position
    on_ground: bool = False  # as EXTENDED_SYS_STATE reports; a crashed vehicle may remain armed
    held_by_upload: bool = False  # the vehicle holds, and only an upload can be the reason
    hold_is_ordered: bool = False  # by an operator, or when the service shuts down
    accepted_mode: str = ""  # the mode of an accepted order, until the vehicle reports a mode
    # The mode was ordered before the service was restarted; no command has been sent since.
    ordered_before_restart: bool = False
    system_state: str = ""  # HEARTBEAT.system_status
    fence_breached: bool = False
    fix_good: bool = True
    estimator_healthy: bool = True
    fix: PositionFix | None = None
    ground: GroundAltitude = field(default_factory=GroundAltitude)
    expected_until_s: dict[type[AnyCommand], float] = field(default_factory=dict)
    unacknowledged: dict[type[AnyCommand], int] = field(default_factory=dict)  # number by kind

    @property
    def position_good(self) -> bool:
        """Whether the vehicle's position is reliable: a 3-D fix and a healthy estimator."""
        return self.fix_good and self.estimator_healthy

    @property
    def in_failsafe(self) -> bool:
        """Whether the autopilot reports a failsafe or a breached fence."""
        return self.system_state in FAILSAFE_STATES or self.fence_breached

    @property
    def taken_over(self) -> bool:
        """Whether the autopilot or pilot selected the mode; only operators may then change it."""
        return self.armed and not self.mode_is_ordered

    @property
    def landed(self) -> bool:
        """Whether the vehicle has landed in a return or a mission, but is not yet disarmed."""
        return self.airborne and self.on_ground and self.mode in (*GOING_HOME, MISSION)

    @property
    def touched_down(self) -> bool:
        """Whether the vehicle has landed near the height of home: a hold would make it take off."""
        return self.landed and self.height_m <= AIRBORNE_M

    @property
    def flies(self) -> bool:
        """Whether planners may use the vehicle: online, airborne, under control, position good."""
        counted_on = self.online and self.airborne and not self.recalled
        counted_on &= self.landing == "none"
        return counted_on and self.position_good and not self.taken_over

    def may_still_land(self, at_s: float) -> bool:
        """Return whether a landing is under way, and its phase may last since the last report.

        The link may be lost during a landing, so that its end is not reported.
        """
        limit_s = LIMITS_S.get(LandingPhase(self.landing), -math.inf)
        return self.fix is not None and at_s - self.fix.at_s <= limit_s

    def recent_wind(self, at_s: float) -> MeasuredWind | None:
        """Return the measured wind; None if there is none, or if it is too old."""
        wind = self.measured_wind
        return None if wind is None or at_s - wind.at_s > WIND_IS_FRESH_S else wind

    def leading_to(self, mode: str, at_s: float) -> set[type[AnyCommand]]:
        """Return the kinds of commands under way that would cause this mode."""
        kinds = [kind for kind in self.expected_until_s if self.is_expected(kind, at_s)]
        return {kind for kind in kinds if mode in LEADS_TO[kind]}

    def is_expected(self, kind: type[AnyCommand], at_s: float) -> bool:
        """Return whether a command of this kind may still take effect."""
        return at_s <= self.expected_until_s.get(kind, -math.inf)

    @property
    def may_be_overridden(self) -> bool:
        """Whether a mode that counts as commanded may be due to a failsafe or a pilot."""
        flies = self.armed and self.airborne and self.mode != MISSION
        return self.held_by_upload or (self.ordered_before_restart and flies)

    def on_sent(self, kind: type[AnyCommand], at_s: float) -> None:
        """Record a command of ``LEADS_TO`` that is sent."""
        self.expected_until_s[kind] = at_s + UNANSWERED_S
        self.unacknowledged[kind] = self.unacknowledged.get(kind, 0) + 1
        if kind is not UploadMission:
            self.accepted_mode, self.ordered_before_restart = "", False

    def on_acknowledged(self, kind: type[AnyCommand], accepted: bool, at_s: float) -> None:
        """Record an acknowledged command, which may change the mode for ``TAKES_EFFECT_S``.

        If another command of this kind is still unacknowledged, for example the one that replaced
        this one, the time until which it may change the mode remains.
        """
        if kind in self.expected_until_s:
            self.unacknowledged[kind] = max(self.unacknowledged.get(kind, 0) - 1, 0)
            if not self.unacknowledged[kind]:
                self.expected_until_s[kind] = at_s + TAKES_EFFECT_S
            if accepted and (kind is Return or (kind is Hold and self.hold_is_ordered)):
                self.accepted_mode = LASTING[kind]

    def on_service_restart(self, ended_s: float) -> None:
        """Reset the link after a restart of the service, which had ended at ``ended_s``.

        If the vehicle had accepted an order to hold or return, but had not reported the commanded
        mode by ``ended_s``, this mode counts as commanded if the next report contains it.
        """
        self.online = False
        self.unacknowledged.clear()
        expected = (mode for kind, mode in LASTING.items() if self.is_expected(kind, ended_s))
        restarted_again = self.ordered_before_restart
        if self.accepted_mode not in expected and not restarted_again:
            self.accepted_mode = ""
        self.ordered_before_restart = self.mode_is_ordered

    def restart(self) -> None:
        """Reset after a restart of the autopilot; in flight the mode then counts as not commanded.

        The last mode remains valid until the next report. An order to return remains valid while
        the vehicle is armed. A watchdog may restart an autopilot in flight; the vehicle is airborne
        again at its next position report, whatever its height above home.
        """
        ordered = self.mode_is_ordered and not self.airborne
        fresh = VehicleAvailability(self.online, measured_wind=self.measured_wind, fix=self.fix)
        fresh.off_task = self.off_task
        fresh.mode, fresh.armed, fresh.mode_is_ordered = self.mode, self.armed, ordered
        fresh.restarted_in_air = (self.airborne or self.restarted_in_air) and self.armed
        if fresh.restarted_in_air:
            fresh.took_off_at_s = self.took_off_at_s
        fresh.recalled = self.recalled and self.armed
        fresh.recalled_on_ground = fresh.recalled and self.recalled_on_ground
        for each in fields(self):
            setattr(self, each.name, getattr(fresh, each.name))

    def refuses(self, order: Order) -> str:
        """Return why an order is not possible in this phase of a landing; "" if it is."""
        if self.landed and order in ("start", "resume", "takeoff"):
            return f"{HAS_LANDED}: repeat the order when it is disarmed"
        if self.touched_down and order != "hold":
            return HAS_LANDED
        if order == "go-around":
            return "it is not landing" if self.landing == "none" else ""
        if order == "land":
            return "" if self.landing == "none" else f"it is already landing ({self.landing})"
        if order != "hold" and self.landing in ("final", "going around"):
            last_leg = "it is on its last leg: order go-around first"
            return (
                last_leg
                if self.landing == "final"
                else "it is going around: repeat the order when it holds"
            )
        return ""

    def needs_confirmation(self, order: Order) -> bool:
        """Return whether an order would end a mode that the autopilot or pilot selected."""
        if not (self.armed and self.airborne):
            return False
        chosen = self.taken_over or (self.in_failsafe and self.mode in GOING_HOME)
        return chosen and (order != "return" or self.mode == "land")
