"""An autopilot and the link to it, as small as the core's tests need them: independent of the mock.

It has the modes, arming, landings, failsafes and refusals that decide what may be commanded. What
it does not have: aerodynamics, messages, items. Pure: time and choices are arguments.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

from mission_service.commands import (
    AnyCommand,
    ChangeSpeed,
    ClimbAndHold,
    Hold,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)

Source = Literal["start-up", "service", "transfer", "pilot", "failsafe"]
ModeCommand = StartMission | Hold | Return | Orbit | ClimbAndHold
Ordered = ModeCommand | ChangeSpeed

NAMES: dict[type[AnyCommand], str] = {
    StartMission: "start mission",
    Hold: "hold",
    Return: "return",
    Orbit: "orbit",
    ClimbAndHold: "climb and hold",
    ChangeSpeed: "change speed",
}
URGENT = (Hold, Return, ClimbAndHold)  # they take the place of all that has not ended
CRUISE_M, CLIMB_M_S, DESCENT_M_S = 120.0, 8.0, 4.0
# What a failsafe does; the same failsafe differs with parameters.
FAILSAFES = {
    "battery low": "return",
    "battery emergency": "land",
    "fence: hold": "hold",
    "fence: return": "return",
    "radio lost": "return",
    "position lost": "altitude",
    "position lost, landing": "land",
    "engine": "land",
}
PILOT_MODES = ("manual", "altitude", "position", "hold", "return", "land", "mission")


@dataclass
class Autopilot:
    """One vehicle. Places are metres east and north in the landscape's projection."""

    stack: Literal["px4", "ardupilot"]
    home_m: tuple[float, float]
    watches_m: tuple[float, float]  # a mission leads to a circle about this place
    speed_m_s: float
    circle_m: float = 250.0
    x_m: float = 0.0
    y_m: float = 0.0
    height_m: float = 0.0
    mode: str = "hold"
    armed: bool = False
    chosen_by: Source = "start-up"
    mission: int = 0  # the one on board, by its number; 0: none that can be flown
    seq: int = 0
    trouble: str = ""  # the failsafe that stands
    climbs_to_m: float = 0.0  # ordered, with a hold

    def __post_init__(self) -> None:
        self.x_m, self.y_m = self.home_m

    @property
    def in_air(self) -> bool:
        """Above the ground."""
        return self.height_m > 0.0

    @property
    def states(self) -> dict[str, str]:
        """What it reports of itself besides mode and place."""
        landed = "landing" if self.mode == "land" else "in air"
        return {
            "system": "critical" if self.trouble else "active" if self.armed else "standby",
            "landed": landed if self.in_air else "on ground",
            "fence": "boundary" if "fence" in self.trouble else "",
            "estimator": "position lost" if "position" in self.trouble else "",
            "fix": "no fix" if "position" in self.trouble else "3d",
            "battery": "12" if "battery" in self.trouble else "80",
        }

    def fail(self, kind: str) -> None:
        """A failsafe of ``FAILSAFES``."""
        self.trouble = kind
        self.change(FAILSAFES[kind], "failsafe")

    def change(self, mode: str, chosen_by: Source) -> None:
        """Fly in another mode; ``chosen_by`` for the same one too."""
        self.mode, self.chosen_by = mode, chosen_by

    def mode_of(self, command: ModeCommand) -> str:
        """What a command leads to on this stack."""
        match command:
            case StartMission():
                return "mission"
            case Hold():
                return "hold"
            case Return():
                return "return"
            case _:
                return "guided" if self.stack == "ardupilot" else "hold"

    def obey(self, command: Ordered) -> str:
        """Carry a command out; returns why not, or nothing."""
        if isinstance(command, ChangeSpeed):
            return ""
        if isinstance(command, StartMission):
            if not self.mission:
                return "no valid mission"
            self.armed = True
        elif not self.armed and isinstance(command, Orbit | ClimbAndHold):
            return "not armed"
        self.change(self.mode_of(command), "service")
        self.climbs_to_m = CRUISE_M if isinstance(command, ClimbAndHold) else 0.0
        return ""

    def fly(self, seconds: float) -> None:
        """Go on for a while; a vehicle that lands is disarmed."""
        if not self.armed:
            return
        match self.mode:
            case "mission":
                self._toward(self._on_circle(), seconds)
                self._climb(CRUISE_M, seconds)
                if self.height_m > CRUISE_M / 2.0:
                    self.seq = max(self.seq, 1)
            case "return":
                if self._toward(self.home_m, seconds):
                    self._climb(0.0, seconds)
            case "land":
                self._climb(0.0, seconds)
            case _ if self.chosen_by == "service" and self.in_air:
                self._climb(max(self.height_m, self.climbs_to_m), seconds)
            case _:
                pass
        if self.mode in ("return", "land") and not self.in_air:
            self.land()

    def _on_circle(self) -> tuple[float, float]:
        x_m, y_m = self.watches_m
        ahead_rad = math.atan2(self.y_m - y_m, self.x_m - x_m) - 0.5
        return x_m + self.circle_m * math.cos(ahead_rad), y_m + self.circle_m * math.sin(ahead_rad)

    def _toward(self, place_m: tuple[float, float], seconds: float) -> bool:
        """Whether it is there."""
        if not self.in_air and self.mode != "mission":
            return True
        away_m = math.dist((self.x_m, self.y_m), place_m)
        share = min(self.speed_m_s * seconds / max(away_m, 1e-9), 1.0)
        self.x_m += share * (place_m[0] - self.x_m)
        self.y_m += share * (place_m[1] - self.y_m)
        return share == 1.0

    def _climb(self, height_m: float, seconds: float) -> None:
        up_m, down_m = CLIMB_M_S * seconds, DESCENT_M_S * seconds
        self.height_m += min(max(height_m - self.height_m, -down_m), up_m)

    def land(self) -> None:
        """Be on the ground, disarmed, wherever it was and whatever it did."""
        self.height_m, self.armed, self.trouble = 0.0, False, ""

    def reboot(self, keeps_flying: bool) -> None:
        """Start again: armed and in its mode after a watchdog's reset, else as from the factory."""
        self.seq = 0
        if not keeps_flying:
            self.land()
            self.change("hold" if self.stack == "px4" else "manual", "start-up")


@dataclass
class Sent:
    """A command on its way: first it reaches the autopilot, then its answer comes back."""

    command: Ordered
    answer: str | None = None  # None: has not arrived; empty: accepted


@dataclass
class Bridge:
    """What the bridge has under way for one vehicle, and what it reported last."""

    autopilot: Autopilot
    linked: bool = True
    connected: bool = False  # and reported
    lost: bool = False  # and reported
    commands: list[Sent] = field(default_factory=list)
    uploads: list[UploadMission] = field(default_factory=list)
    mode: tuple[bool, str] = (False, "")  # reported last
    seq: int = 0
    states: dict[str, str] = field(default_factory=dict)  # reported last
    reads_back: bool = False
    pauses: bool = False  # holds for an upload, and flies on after it

    def send(self, command: AnyCommand) -> list[Sent]:
        """Take a command of the core; returns those that an urgent one takes the place of."""
        if isinstance(command, UploadMission):
            self.uploads.append(command)
            return []
        if type(command) not in NAMES:
            return []
        replaced: list[Sent] = []
        if isinstance(command, URGENT):
            replaced, self.commands = self.commands, []
            self.pauses = False
        self.commands.append(Sent(command))  # type: ignore[arg-type]
        return replaced

    def deliver(self, refused: str = "") -> Sent | None:
        """The next command reaches the autopilot, which may refuse it; in the order of sending."""
        sent = next((each for each in self.commands if each.answer is None), None)
        if sent is not None:
            sent.answer = refused or self.autopilot.obey(sent.command)
        return sent

    def pause(self) -> None:
        """An upload that would be flown half overwritten begins: ArduPilot holds meanwhile."""
        flown = self.autopilot
        if self.uploads and flown.stack == "ardupilot" and flown.armed and flown.mode == "mission":
            flown.change("hold", "transfer")
            self.pauses = True

    def finish(self, outcome: str, on_board: bool) -> UploadMission | None:
        """The oldest upload ends; ``on_board``: the vehicle has it whatever is reported."""
        if not self.uploads:
            return None
        upload, flown = self.uploads.pop(0), self.autopilot
        if outcome == "accepted" or on_board:
            flown.mission, flown.seq = upload.mission_id, 0
        elif flown.stack == "ardupilot" and outcome != "superseded":
            flown.mission = 0
        if outcome == "accepted" and self.pauses and flown.mode == "hold":
            flown.change("mission", "transfer")
        elif outcome == "rejected" and flown.stack == "px4" and flown.mode == "mission":
            flown.change("hold", "transfer")  # it flies nothing that is unfit
        self.pauses = False
        return upload

    def restart(self, killed: bool) -> None:
        """The service starts again; what was under way for one that was killed is forgotten."""
        self.reads_back = True
        if killed:
            self.commands, self.uploads, self.pauses = [], [], False
            self.mode, self.seq, self.states = (False, ""), 0, {}
            self.connected = self.lost = False
        else:  # what it reported meanwhile was not handled
            self.mode, self.seq = (self.autopilot.armed, self.autopilot.mode), self.autopilot.seq
