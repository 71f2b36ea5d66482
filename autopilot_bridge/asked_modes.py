"""Which flight modes were asked for, so that a mode that was not is known for somebody else's.

An autopilot in failsafe, and a pilot by radio, change the mode too. What they chose is left alone:
no command is repeated, and no transfer flies on, against it.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.command import AnyStep
from autopilot_bridge.stacks import Stack, Step

SEEN_WITHIN_US = 10_000_000  # a mode that was asked for, by heartbeats of which some get lost
ON_ITS_WAY_US = 2_000_000  # a mode asked for before another may still come


def modes_asked(step: AnyStep, stack: Stack) -> tuple[int, ...]:
    """The modes that a step of an order leads to, by numbers; () if it leaves the mode."""
    if not isinstance(step, Step):
        return ()
    px4, plane = stack.name == "px4", stack.vehicle == "plane"
    match step.command:
        case mavlink.MAV_CMD_DO_SET_MODE if px4:
            return (int(step.params[1]) << 16 | int(step.params[2]) << 24,)
        case mavlink.MAV_CMD_DO_SET_MODE:
            return (int(step.params[1]),)
        case mavlink.MAV_CMD_DO_REPOSITION:
            return (stack.mode_number("guided"),)
        case mavlink.MAV_CMD_DO_ORBIT:
            return (stack.mode_number("hold" if plane else "orbit"),)
        case mavlink.MAV_CMD_NAV_TAKEOFF if px4:
            return (stack.mode_number("takeoff"), stack.hold_mode)
        case mavlink.MAV_CMD_MISSION_START | mavlink.MAV_CMD_DO_LAND_START:
            return (stack.mission_mode,)
        case _:
            return ()


class AskedModes:
    """The modes asked for of one vehicle, and until when each may come."""

    def __init__(self) -> None:
        self._until_us: dict[int, int] = {}

    def ask(self, modes: tuple[int, ...], now_us: int) -> None:
        """These were asked for now."""
        if not modes:
            return
        self._until_us = {
            mode: min(until_us, now_us + ON_ITS_WAY_US)
            for mode, until_us in self._until_us.items()
            if until_us > now_us
        }
        self._until_us |= dict.fromkeys(modes, now_us + SEEN_WITHIN_US)

    def has(self, mode: int, now_us: int) -> bool:
        """Whether a change to this mode was asked for."""
        return self._until_us.get(mode, -1) >= now_us
