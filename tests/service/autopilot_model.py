"""A minimal model of an autopilot and its link for tests of the core, independent of the mock.

It contains the modes, arming, landings, failsafes and refusals that determine which commands are
allowed. It contains no aerodynamics, messages or items. The code is pure: time and random choices
are arguments.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

from mission_service.commands import (
    AnyCommand,
    ChangeSpeed,
    ClimbAndHold,
    GoAround,
    Hold,
    Land,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)

Source = Literal["start-up", "service", "transfer", "pilot", "failsafe"]
ModeCommand = StartMission | Hold | Return | Land | GoAround | Orbit | ClimbAndHold
Ordered = ModeCommand | ChangeSpeed

NAMES: dict[type[AnyCommand], str] = {
    StartMission: "start mission",
    Hold: "hold",
    Return: "return",
    Land: "fly landing",
    GoAround: "go around",
    Orbit: "orbit",
    ClimbAndHold: "climb and hold",
    ChangeSpeed: "change speed",
}
URGENT = (Hold, Return, GoAround, ClimbAndHold)  # they replace all commands that have not ended
CRUISE_M, CLIMB_M_S, DESCENT_M_S = 120.0, 8.0, 4.0
# The mode that each failsafe selects; it depends on the vehicle's parameters.
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
    """One vehicle. Positions are metres east and north in the landscape's projection."""

    stack: Literal["px4", "ardupilot"]
    home_m: tuple[float, float]
    watches_m: tuple[float, float]  # a mission leads to a circle around this place
    speed_m_s: float
    circle_m: float = 250.0
    x_m: float = 0.0
    y_m: float = 0.0
    height_m: float = 0.0
    mode: str = "hold"
    armed: bool = False
    chosen_by: Source = "start-up"
    mission: int = 0  # number of the mission on board; 0 if no mission can be flown
    lands: bool = False  # whether that mission only lands
    climbs_away: bool = False  # whether it goes around, and then circles at CRUISE_M
    seq: int = 0
    trouble: str = ""  # the active failsafe
    climbs_to_m: float = 0.0  # ordered altitude of a climb and hold

    def __post_init__(self) -> None:
        self.x_m, self.y_m = self.home_m

    @property
    def in_air(self) -> bool:
        """Whether the vehicle is above the ground."""
        return self.height_m > 0.0

    @property
    def states(self) -> dict[str, str]:
        """Return the states that it reports in addition to mode and position."""
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
        """Start a failsafe of ``FAILSAFES``."""
        self.trouble = kind
        self.change(FAILSAFES[kind], "failsafe")

    def change(self, mode: str, chosen_by: Source) -> None:
        """Change the mode; ``chosen_by`` is also updated if the mode stays the same."""
        self.mode, self.chosen_by, self.climbs_away = mode, chosen_by, False

    def mode_of(self, command: ModeCommand) -> str:
        """Return the mode to which a command leads on this stack."""
        match command:
            case StartMission() | Land():
                return "mission"
            case GoAround() if self.stack == "ardupilot":
                return "mission"
            case Hold():
                return "hold"
            case Return():
                return "return"
            case _:
                return "guided" if self.stack == "ardupilot" else "hold"

    def obey(self, command: Ordered) -> str:
        """Execute a command; return the reason for a refusal, or an empty text."""
        if isinstance(command, ChangeSpeed):
            return ""
        if isinstance(command, StartMission):
            if not self.mission:
                return "no valid mission"
            self.armed = True
        elif not self.armed and isinstance(command, Orbit | ClimbAndHold):
            return "not armed"
        if isinstance(command, Land) and not self.mission:
            return "no valid mission"
        in_landing = self.mode == "mission" and self.lands and self.in_air
        if isinstance(command, GoAround) and self.stack == "ardupilot" and not in_landing:
            return "it is not landing"
        self.change(self.mode_of(command), "service")
        self.climbs_away = isinstance(command, GoAround)
        self.climbs_to_m = CRUISE_M if isinstance(command, ClimbAndHold | GoAround) else 0.0
        return ""

    def fly(self, seconds: float) -> None:
        """Advance the flight; a vehicle that lands is disarmed."""
        if not self.armed:
            return
        match self.mode:
            case "mission" if self.lands and not self.climbs_away:
                if self._toward(self.home_m, seconds):
                    self._climb(0.0, seconds)
                    self.seq = 99
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
        landing = self.mode in ("return", "land") or (self.mode == "mission" and self.lands)
        if landing and not self.in_air:
            self.land()

    def _on_circle(self) -> tuple[float, float]:
        x_m, y_m = self.watches_m
        ahead_rad = math.atan2(self.y_m - y_m, self.x_m - x_m) - 0.5
        return x_m + self.circle_m * math.cos(ahead_rad), y_m + self.circle_m * math.sin(ahead_rad)

    def _toward(self, place_m: tuple[float, float], seconds: float) -> bool:
        """Move towards a place; return True when it is reached."""
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
        """Put the vehicle on the ground, disarmed."""
        self.height_m, self.armed, self.trouble = 0.0, False, ""

    def reboot(self, keeps_flying: bool) -> None:
        """Restart: after a watchdog reset it is armed in its mode, otherwise disarmed."""
        self.seq = 0
        if not keeps_flying:
            self.land()
            self.change("hold" if self.stack == "px4" else "manual", "start-up")


@dataclass
class Sent:
    """A command in transit: it first reaches the autopilot, then its reply returns."""

    command: Ordered
    answer: str | None = None  # None: the command has not arrived; empty: accepted


@dataclass
class Bridge:
    """The commands and uploads in progress for one vehicle, and its last reports."""

    autopilot: Autopilot
    linked: bool = True
    connected: bool = False  # whether the connection was reported
    lost: bool = False  # whether the loss was reported
    commands: list[Sent] = field(default_factory=list)
    uploads: list[UploadMission] = field(default_factory=list)
    mode: tuple[bool, str] = (False, "")  # reported last
    seq: int = 0
    states: dict[str, str] = field(default_factory=dict)  # reported last
    reads_back: bool = False
    pauses: bool = False  # whether it holds for an upload, and then flies on

    def send(self, command: AnyCommand) -> list[Sent]:
        """Send a command of the core; return the commands that an urgent one replaces."""
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
        """Deliver the next command in the order of sending; the autopilot may refuse it."""
        sent = next((each for each in self.commands if each.answer is None), None)
        if sent is not None:
            sent.answer = refused or self.autopilot.obey(sent.command)
        return sent

    def pause(self) -> None:
        """Begin an upload during which ArduPilot holds, because its list is overwritten."""
        flown = self.autopilot
        if self.uploads and flown.stack == "ardupilot" and flown.armed and flown.mode == "mission":
            flown.change("hold", "transfer")
            self.pauses = True

    def finish(self, outcome: str, on_board: bool) -> UploadMission | None:
        """End the oldest upload; with ``on_board`` the vehicle has the mission anyway."""
        if not self.uploads:
            return None
        upload, flown = self.uploads.pop(0), self.autopilot
        if outcome == "accepted" or on_board:
            flown.mission, flown.seq, flown.lands = upload.mission_id, 0, upload.lands
            flown.climbs_away = False
        elif flown.stack == "ardupilot" and outcome != "superseded":
            flown.mission = 0
        if outcome == "accepted" and self.pauses and flown.mode == "hold":
            flown.change("mission", "transfer")
        elif outcome == "rejected" and flown.stack == "px4" and flown.mode == "mission":
            flown.change("hold", "transfer")  # PX4 does not fly a mission that it rejected
        self.pauses = False
        return upload

    def restart(self, killed: bool) -> None:
        """Restart the service; a killed service loses its commands in progress."""
        self.reads_back = True
        if killed:
            self.commands, self.uploads, self.pauses = [], [], False
            self.mode, self.seq, self.states = (False, ""), 0, {}
            self.connected = self.lost = False
        else:  # reports in the meantime were not processed
            self.mode, self.seq = (self.autopilot.armed, self.autopilot.mode), self.autopilot.seq
