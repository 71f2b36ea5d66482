"""Simulates the mock's battery, which drains in the air."""

from dataclasses import dataclass

from autopilot_bridge.mock.kinematics import STEP_S

LOW_PERCENT = 15.0  # PX4's BAT_LOW_THR
EMERGENCY_PERCENT = 5.0  # BAT_EMERGEN_THR
VOLTS_FULL, VOLTS_EMPTY = 12.6, 10.5  # three cells
CAPACITY_MAH = 5000.0


@dataclass(slots=True)
class Battery:
    """The battery of one vehicle."""

    percent: float | None = None  # None if no battery is reported
    endurance_s: float | None = None  # None if the battery does not drain
    acted: bool = False  # whether the low battery has been reported
    warned: bool = False  # whether the emergency has been reported

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
        """The charge that was used since the battery was full."""
        return 0.0 if self.percent is None else CAPACITY_MAH * (1.0 - self.percent / 100.0)

    def remaining_s(self, airborne: bool) -> float:
        """Return the autopilot's estimate of the time until the battery is empty; 0 without one."""
        if self.endurance_s is None or self.percent is None or not airborne:
            return 0.0
        return self.endurance_s * self.percent / 100.0

    def low_text(self, ardupilot: bool) -> tuple[int, str]:
        """Return the severity and the text that the stack sends when the charge is low."""
        if not ardupilot:
            return 2, "Low battery\t"
        return 4, f"Battery 1 is low {self.volts:.2f}V used {self.consumed_mah:.0f} mAh"
