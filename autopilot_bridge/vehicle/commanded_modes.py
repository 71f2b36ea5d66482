"""Records the commanded flight modes; any other mode is attributed to the autopilot or a pilot.

An autopilot in failsafe can change the mode, and so can a pilot with a remote control. The client
does not override such a mode: it repeats no command, and no transfer changes the mode.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.command_sequence import AnyStep
from autopilot_bridge.vehicle.sent_commands import ANSWERED_WITHIN_US

REPORTED_WITHIN_US = 10_000_000  # time until a heartbeat shows the mode; some heartbeats get lost
DELAYED_US = ANSWERED_WITHIN_US  # a mode may be entered this long after another one was commanded


def modes_of_step(step: AnyStep, stack: Stack) -> tuple[int, ...]:
    """Return the numbers of the modes that a step may enter; empty if it changes no mode."""
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


class CommandedModes:
    """The modes commanded to one vehicle, each with the latest time at which it may be entered."""

    def __init__(self) -> None:
        self._until_us: dict[int, int] = {}

    def expect(self, modes: tuple[int, ...], now_us: int) -> None:
        """Record the modes that are being commanded."""
        if not modes:
            return
        self._until_us = {
            mode: min(until_us, now_us + DELAYED_US)
            for mode, until_us in self._until_us.items()
            if until_us > now_us
        }
        self._until_us |= dict.fromkeys(modes, now_us + REPORTED_WITHIN_US)

    def has(self, mode: int, now_us: int) -> bool:
        """Return whether a change to this mode was commanded."""
        return self._until_us.get(mode, -1) >= now_us
