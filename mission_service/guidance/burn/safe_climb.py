"""Commands a vertical climb to the safe height, repeatedly until the climb is complete."""

import math

from mission_service.commands import AnyCommand, ClimbAndHold
from mission_service.guidance.burn.approved_plan import HIGH_SHARE
from mission_service.guidance.burn.burn_state import BurnState
from mission_service.position_fix import PositionFix

# The interval between climb commands, and the commanded height as a fraction of the safe height.
REPEAT_CLIMB_S, CLIMB_SHARE = 5.0, 1.05


class SafeClimb:
    """The orders for one climb to the safe height."""

    def __init__(self, state: BurnState) -> None:
        self._state = state
        self._ordered_at_s = -math.inf

    @property
    def ordered(self) -> bool:
        """Return whether the climb has been ordered."""
        return self._ordered_at_s > -math.inf

    def restart(self) -> None:
        """Begin a new climb, which is ordered at once."""
        self._ordered_at_s = -math.inf

    def is_high(self, fix: PositionFix) -> bool:
        """Return whether the vehicle is at the safe height."""
        return self._state.height_m(fix) >= HIGH_SHARE * self._state.burn.safe_height_m

    def order(self, name: str, fix: PositionFix) -> list[AnyCommand]:
        """Return the climb command if one is due, otherwise an empty list."""
        if fix.at_s - self._ordered_at_s < REPEAT_CLIMB_S:
            return []
        self._ordered_at_s = fix.at_s
        safe_m = self._state.altitude_m(fix, CLIMB_SHARE * self._state.burn.safe_height_m)
        altitude_m = round(max(safe_m, fix.altitude_m), 1)
        return [ClimbAndHold(name, *self._state.lat_lon(fix.x_m, fix.y_m), altitude_m)]
