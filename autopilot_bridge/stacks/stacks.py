"""Lists the differences between PX4 1.17 and ArduPilot 4.6.2, as observed on both."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.stacks.modes import ARDUCOPTER, ARDUPLANE, PX4, Modes


class Place(NamedTuple):
    """The position in a COMMAND_INT, with x and y in 1e-7 degrees."""

    frame: int
    x: int
    y: int
    z: float


class Step(NamedTuple):
    """A command and its first parameters, sent as a COMMAND_INT if it has a position."""

    command: int
    params: tuple[float, ...] = ()
    place: Place | None = None


COPTER_TYPES = (
    *(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_TYPE_COAXIAL, mavlink.MAV_TYPE_HELICOPTER),
    *(mavlink.MAV_TYPE_HEXAROTOR, mavlink.MAV_TYPE_OCTOROTOR, mavlink.MAV_TYPE_TRICOPTER),
    *(mavlink.MAV_TYPE_DODECAROTOR, mavlink.MAV_TYPE_DECAROTOR),
)
MAV_TYPE_VTOL_FIXEDROTOR = 22  # pymavlink has an older name for it
VTOL_TYPES = tuple(range(19, 26))  # VTOLs fly missions like planes
PLANE_TYPES = (mavlink.MAV_TYPE_FIXED_WING, *VTOL_TYPES)
ARM = Step(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))


@dataclass(frozen=True, slots=True)
class Stack:
    """One autopilot on one kind of vehicle: its modes, limits and procedures, as data.

    ``stack_named`` returns a stack. Comments describe the fields.
    """

    name: str
    vehicle: str
    autopilot: int
    mav_type: int
    request_message: str  # the message with which the autopilot requests an item
    item_0_is_home: bool
    atomic_upload: bool  # a failed upload leaves the old mission unchanged
    mission_files: bool  # whether the autopilot transfers whole missions by MAVFTP
    keeps_target: bool  # after an upload, flies to the old target until an item is commanded
    items_ahead: int  # number of items that may be sent before they are requested
    rerequest_us: int  # an unanswered request for an item is repeated after this delay
    # The autopilot sends the MISSION_ACK OPERATION_CANCELLED after this time without messages. 0
    # means that the autopilot aborts the transfer without a message.
    cancels_after_us: int
    max_items: int
    mission_mode: int
    hold_mode: int
    rtl_mode: int
    start: tuple[Step, ...]  # steps from disarmed on the ground to flying the mission
    modes: Modes
    # Whether the plane takes off and lands vertically; ``vehicle`` is then "plane".
    vtol: bool = False

    @property
    def kind(self) -> str:
        """The kind of vehicle, as for ``stack_named``: ``plane``, ``vtol`` or ``copter``."""
        return "vtol" if self.vtol else self.vehicle

    def same_vehicle(self, other: "Stack") -> bool:
        """Return whether both may be stacks of one vehicle; a VTOL may report itself as a plane."""
        return (self.name, self.vehicle) == (other.name, other.vehicle)

    def mode_name(self, custom_mode: int) -> str:
        """Return the name of a mode number, or the number itself if it has no name."""
        names = (name for name, number in self.modes if number == custom_mode)
        return next(names, f"mode {custom_mode}")

    def mode_number(self, name: str) -> int:
        """Return the number of a mode.

        Raises BridgeError for an unknown name; the message lists all modes.
        """
        numbers = dict(self.modes)
        if name not in numbers:
            names = ", ".join(numbers)
            raise BridgeError(f"{self.name} {self.kind} has no mode {name!r}; it has {names}")
        return numbers[name]

    @property
    def bytewise(self) -> bool:
        """Whether the bytes of an integer parameter are sent in the float of a PARAM_SET."""
        return self.name == "px4"

    def acks_of(self, command: int) -> int:
        """Return the number of COMMAND_ACKs with which the autopilot answers one command.

        PX4 1.17 acknowledges a change of the mode on receipt, with the result ACCEPTED, and again
        with the result of the execution.
        """
        return 2 if self.name == "px4" and command == mavlink.MAV_CMD_DO_SET_MODE else 1

    def set_mode(self, custom_mode: int) -> Step:
        """Return the MAV_CMD_DO_SET_MODE command for a mode number of this stack."""
        if self.name == "px4":
            main_and_sub = (float(custom_mode >> 16 & 0xFF), float(custom_mode >> 24))
            return Step(mavlink.MAV_CMD_DO_SET_MODE, (1.0, *main_and_sub))
        return Step(mavlink.MAV_CMD_DO_SET_MODE, (1.0, float(custom_mode)))


_AUTO = 4 << 16  # PX4's main mode AUTO; sub modes: 3 loiter, 4 mission, 5 return
_PX4_PLANE = Stack(
    name="px4",
    vehicle="plane",
    autopilot=mavlink.MAV_AUTOPILOT_PX4,
    mav_type=mavlink.MAV_TYPE_FIXED_WING,
    request_message="MISSION_REQUEST_INT",
    item_0_is_home=False,
    atomic_upload=True,
    mission_files=False,
    keeps_target=False,
    items_ahead=8,
    rerequest_us=280_000,
    cancels_after_us=0,
    max_items=5000,
    mission_mode=_AUTO | 4 << 24,
    hold_mode=_AUTO | 3 << 24,
    rtl_mode=_AUTO | 5 << 24,
    start=(Step(mavlink.MAV_CMD_DO_SET_MODE, (1.0, 4.0, 4.0)), ARM),
    modes=PX4,
)
_ARDUPLANE = Stack(
    name="ardupilot",
    vehicle="plane",
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    mav_type=mavlink.MAV_TYPE_FIXED_WING,
    request_message="MISSION_REQUEST",
    item_0_is_home=True,
    atomic_upload=False,
    mission_files=True,
    keeps_target=True,
    items_ahead=0,
    rerequest_us=1_000_000,
    cancels_after_us=8_000_000,
    max_items=655,
    mission_mode=10,
    hold_mode=12,
    rtl_mode=11,
    # ArduPlane does not arm in RTL, its mode after a return, so the first step selects AUTO.
    start=(Step(mavlink.MAV_CMD_DO_SET_MODE, (1.0, 10.0)), ARM),
    modes=ARDUPLANE,
)
STACKS = (
    _PX4_PLANE,
    replace(_PX4_PLANE, vtol=True, mav_type=MAV_TYPE_VTOL_FIXEDROTOR),
    replace(_PX4_PLANE, vehicle="copter", mav_type=mavlink.MAV_TYPE_QUADROTOR),
    _ARDUPLANE,
    replace(_ARDUPLANE, vtol=True),  # Q_MAV_TYPE = 0 means MAV_TYPE_FIXED_WING
    replace(
        _ARDUPLANE,
        vehicle="copter",
        mav_type=mavlink.MAV_TYPE_QUADROTOR,
        max_items=650,
        mission_mode=3,
        hold_mode=17,  # BRAKE, because LOITER sinks without a pilot
        rtl_mode=6,
        start=(
            # ArduCopter does not arm in AUTO, so the first step selects GUIDED.
            Step(mavlink.MAV_CMD_DO_SET_MODE, (1.0, 4.0)),
            ARM,
            Step(mavlink.MAV_CMD_DO_SET_MODE, (1.0, 3.0)),
            Step(mavlink.MAV_CMD_MISSION_START),
        ),
        modes=ARDUCOPTER,
    ),
)


def stack_named(name: str, vehicle: str) -> Stack:
    """Return the stack for an autopilot and a kind of vehicle.

    Args:
        name: ``px4`` or ``ardupilot``.
        vehicle: ``plane``, ``vtol`` or ``copter``.

    Returns:
        The stack: its modes, limits and procedures as data.

    Raises:
        BridgeError: The name or the vehicle is unknown.
    """
    for stack in STACKS:
        if (stack.name, stack.kind) == (name, vehicle):
            return stack
    raise BridgeError(
        f"unknown stack {name} {vehicle}; use px4 or ardupilot, and plane, vtol or copter"
    )


def stack_of(autopilot: int, mav_type: int) -> Stack | None:
    """Return the stack for the autopilot and type of a HEARTBEAT; None if no stack fits."""
    if mav_type not in (*PLANE_TYPES, *COPTER_TYPES):
        return None
    winged = "vtol" if mav_type in VTOL_TYPES else "plane"
    kind = (autopilot, winged if mav_type in PLANE_TYPES else "copter")
    return next((stack for stack in STACKS if (stack.autopilot, stack.kind) == kind), None)


def as_vtol(stack: Stack) -> Stack:
    """Return the stack of a plane that has turned out to be a VTOL."""
    return stack_named(stack.name, "vtol") if stack.vehicle == "plane" else stack


def kind_parameters(stack: Stack) -> tuple[str, ...]:
    """Return the names of the parameters that ``kind_of`` uses."""
    return ("Q_ENABLE",) if (stack.name, stack.vehicle) == ("ardupilot", "plane") else ()


def kind_of(stack: Stack, values: Mapping[str, float]) -> str:
    """Return the kind of a vehicle from its parameters; ArduPlane's heartbeat may hide it.

    ``values`` are those of ``kind_parameters(stack)`` by name; without them, the kind is that of
    the stack.
    """
    enabled = values.get("Q_ENABLE") if kind_parameters(stack) else None
    if enabled is None:
        return stack.kind
    return "vtol" if enabled > 0.0 else "plane"
