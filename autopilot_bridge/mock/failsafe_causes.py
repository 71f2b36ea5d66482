"""Simulates two causes of failsafes: a battery that drains, and the loss of the ground station."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from autopilot_bridge.mock.kinematics import STEP_S
from autopilot_bridge.stacks.stacks import Stack

LOW_PERCENT = 15.0  # PX4's BAT_LOW_THR
EMERGENCY_PERCENT = 5.0  # BAT_EMERGEN_THR
VOLTS_FULL, VOLTS_EMPTY = 12.6, 10.5  # three cells
CAPACITY_MAH = 5000.0


@dataclass(slots=True)
class Battery:
    """The battery of one vehicle."""

    percent: float | None = None  # None if no battery is reported
    endurance_s: float | None = None  # None if the battery does not drain
    acted: bool = False  # whether the low charge has been reported
    warned: bool = False  # whether the emergency charge has been reported

    def replace(self) -> None:
        """Replace the battery with a full one of the same kind."""
        self.percent, self.acted, self.warned = 100.0, False, False

    def drain(self) -> bool:
        """Drain the battery for one step in the air; return True once, when it is low."""
        if self.percent is None:
            return False
        if self.endurance_s is not None:
            self.percent = max(self.percent - 100.0 * STEP_S / self.endurance_s, 0.0)
        if self.percent > LOW_PERCENT or self.acted:
            return False
        self.acted = True
        return True

    def emergency(self) -> bool:
        """Return True once, when the charge has fallen to the emergency threshold."""
        if self.warned or self.percent is None or self.percent > EMERGENCY_PERCENT:
            return False
        self.warned = True
        return True

    @property
    def empty(self) -> bool:
        """Whether the battery is empty."""
        return self.percent == 0.0

    @property
    def volts(self) -> float:
        """The voltage, linear in the charge; the full voltage if no battery is reported."""
        share = 1.0 if self.percent is None else self.percent / 100.0
        return VOLTS_EMPTY + (VOLTS_FULL - VOLTS_EMPTY) * share

    def current_a(self, airborne: bool) -> float | None:
        """Return the mean current in flight; None if the battery does not drain."""
        if self.endurance_s is None:
            return None
        return CAPACITY_MAH * 3.6 / self.endurance_s if airborne else 0.0

    @property
    def consumed_mah(self) -> float:
        """The charge used since the battery was full."""
        return 0.0 if self.percent is None else CAPACITY_MAH * (1.0 - self.percent / 100.0)

    def remaining_s(self, airborne: bool) -> float:
        """Return the autopilot's estimate of the time until the battery is empty; 0 if none."""
        if self.endurance_s is None or self.percent is None or not airborne:
            return 0.0
        return self.endurance_s * self.percent / 100.0

    def low_text(self, ardupilot: bool) -> tuple[int, str]:
        """Return the severity and the text that the stack sends when the charge is low."""
        if not ardupilot:
            return 2, "Low battery\t"
        return 4, f"Battery 1 is low {self.volts:.2f}V used {self.consumed_mah:.0f} mAh"


# "glide" is ArduPlane's FBWA without throttle.
FailsafeMode = Literal["hold", "rtl", "land", "mission", "glide", "termination"]
_PX4_ACTIONS: dict[int, FailsafeMode | Literal["disarm"]] = {
    1: "hold",
    2: "rtl",
    3: "land",
    5: "termination",
    6: "disarm",
}
_COPTER_MODES: dict[int, FailsafeMode] = {4: "land", 5: "land", 7: "hold"}


class FailsafeReaction(NamedTuple):
    """The mode (None: unchanged), the severity and text, and whether a failsafe is active."""

    mode: FailsafeMode | Literal["disarm"] | None
    text: tuple[int, str]
    active: bool = True


class GroundStationLink:
    """The autopilot's monitor of the heartbeats of ground stations.

    ``value`` returns the value of a parameter. SmartRTL never has a path, and no parachute is
    fitted. The sources are named in ``stacks/link_loss.py``.
    """

    def __init__(self, stack: Stack, value: Callable[[str], float]) -> None:
        self._stack = stack
        self._value = value
        self._heartbeat_s: float | None = None  # time of the last heartbeat
        self._lost = False
        self._acted = False  # whether PX4 has executed its action since the loss
        self._then: tuple[float, FailsafeMode] | None = None  # PX4's action after its hold

    def receive_heartbeat(self, system_id: int, now_s: float) -> None:
        """Store the time of a heartbeat; ArduPilot monitors the heartbeats of one system id."""
        if self._stack.name == "px4" or system_id == int(self._value("SYSID_MYGCS")):
            self._heartbeat_s = now_s

    def reaction(
        self, mode: str, armed: bool, airborne: bool, lands: bool, failsafe: bool, now_s: float
    ) -> FailsafeReaction | None:
        """Return the reaction that is due, or None.

        ``lands`` states whether the mission is in its landing, and ``failsafe`` whether the last
        failsafe is still active, that is, no command has ended it.
        """
        if self._heartbeat_s is None:
            return None
        silent_s = now_s - self._heartbeat_s
        if self._stack.name == "px4":
            return self._px4(mode, armed, failsafe, silent_s, now_s)
        if self._stack.vehicle == "plane":
            return self._arduplane(mode, lands, silent_s)
        return self._arducopter(mode, armed, airborne, silent_s)

    def _px4(
        self, mode: str, armed: bool, failsafe: bool, silent_s: float, now_s: float
    ) -> FailsafeReaction | None:
        if silent_s <= self._value("COM_DL_LOSS_T"):
            if self._lost:
                self._lost = self._acted = False
                return FailsafeReaction(None, (6, "GCS connection regained\t"), failsafe)
        elif not self._lost:
            self._lost = True
            return FailsafeReaction(None, (6, "Connection to ground station lost\t"), failsafe)
        if self._then is not None:  # also after the link is restored
            at_s, action = self._then
            if not failsafe:
                self._then = None
            elif now_s >= at_s:
                self._then = None
                return FailsafeReaction(action, (2, "Failsafe activated\t"))
        if not self._lost or self._acted or not armed or self._px4_excepts(mode):
            return None
        self._acted = True
        return self._px4_action(mode, now_s)

    def _px4_excepts(self, mode: str) -> bool:
        excepted = int(self._value("COM_DLL_EXCEPT"))
        of_mode = {"mission": 1, "hold": 2, "guided": 2, "takeoff": 2}
        return mode == "land" or bool(excepted & of_mode.get(mode, 0))

    def _px4_action(self, mode: str, now_s: float) -> FailsafeReaction | None:
        action = _PX4_ACTIONS.get(int(self._value("NAV_DLL_ACT")))
        if action is None or action == mode == "rtl":
            return None
        delay_s = self._value("COM_FAIL_ACT_T")
        if action in ("rtl", "land") and delay_s > 0.1:
            self._then = (now_s + delay_s, "rtl" if action == "rtl" else "land")
            words = f"Failsafe activated: entering Hold for {round(delay_s)} seconds\t"
            return FailsafeReaction("hold", (2, words))
        return FailsafeReaction(action, (2, "Failsafe activated\t"))

    def _arduplane(self, mode: str, lands: bool, silent_s: float) -> FailsafeReaction | None:
        enabled = int(self._value("FS_GCS_ENABL"))
        silent = silent_s > self._value("FS_LONG_TIMEOUT")
        if self._lost:
            if silent:
                return None
            self._lost = False
            return FailsafeReaction(None, (4, "GCS Failsafe Off"), active=False)
        monitors = enabled in (1, 2) or (enabled == 3 and mode == "mission")
        if not (silent and monitors):
            return None
        self._lost = True
        to_mode = self._long_action(mode, lands)
        shown = {"rtl": "RTL", "glide": "FBWA", "mission": "AUTO"}.get(to_mode or "", mode.upper())
        if int(self._value("FS_LONG_ACTN")) == 3 and mode not in ("rtl", "idle") and not lands:
            return FailsafeReaction(None, (2, "Parachute: Released"))
        return FailsafeReaction(to_mode, (4, f"GCS Failsafe On: {shown}"))

    def _long_action(self, mode: str, lands: bool) -> FailsafeMode | None:
        """Return the mode of ``failsafe_long_on_event``; None if the mode does not change."""
        action = int(self._value("FS_LONG_ACTN"))
        if action == 3 or lands or mode == "idle":
            return None
        if mode == "rtl":
            return "mission" if action == 4 else None
        if action == 2:
            return "glide"
        if action == 4:
            return "mission"
        if mode in ("mission", "guided"):
            return "rtl" if action == 1 else None
        return "rtl"

    def _arducopter(
        self, mode: str, armed: bool, airborne: bool, silent_s: float
    ) -> FailsafeReaction | None:
        enabled = int(self._value("FS_GCS_ENABLE"))
        if enabled == 0:
            return None
        silent = silent_s > self._value("FS_GCS_TIMEOUT")
        if silent == self._lost:
            return None
        self._lost = silent
        if not silent:
            return FailsafeReaction(None, (4, "GCS Failsafe Cleared"), active=False)
        options = int(self._value("FS_OPTIONS"))
        if not armed:
            return FailsafeReaction(None, (4, "GCS Failsafe"))
        if not airborne:
            return FailsafeReaction("disarm", (4, "GCS Failsafe - Disarming"))
        if mode == "land" and options & 8:
            return FailsafeReaction(None, (4, "GCS Failsafe - Continuing Landing"))
        if mode == "mission" and options & 2:
            return FailsafeReaction(None, (4, "GCS Failsafe - Continuing Auto Mode"))
        if mode == "hold" and options & 16:  # BRAKE is not a mode of the autopilot
            return FailsafeReaction(None, (4, "GCS Failsafe - Continuing Pilot Control"))
        return FailsafeReaction(_COPTER_MODES.get(enabled, "rtl"), (4, "GCS Failsafe"))
