"""Contains the commands of a vehicle: the MAV_CMDs of each stack, their arguments and retries.

``ORDERS`` is the table; each row is an *order*, one user command. To add a command, add a row and
the function that returns its steps. The commands were tested on PX4 1.17 and ArduPilot 4.6.2. The
functions raise BridgeError for a command that the stack does not have. Altitudes are above mean sea
level unless their names state another reference.
"""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import speed_type
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import ARM, Place, Stack, Step
from autopilot_bridge.vehicle.command_sequence import AnyStep, SetParameter

NAN = math.nan
CHANGE_MODE = float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
SAME_PLACE = Place(mavlink.MAV_FRAME_GLOBAL, 2**31 - 1, 2**31 - 1, NAN)
PX4_MAX_ORBIT_RADIUS_M = 1000.0  # MC_ORBIT_RAD_MAX of multirotors
PLANE_MAX_RADIUS_M = 32767.0

GO_AROUND_CLIMB_M = 30.0  # height above home up to which ArduPlane keeps its heading

PX4_MAX_ACTUATORS = 6
SERVO_US = (500.0, 2500.0)  # minimum and maximum pulse width of servos
GRIPPER_RELEASE = float(mavlink.GRIPPER_ACTION_RELEASE)
GRIPPER_GRAB = float(mavlink.GRIPPER_ACTION_GRAB)

Steps = tuple[AnyStep, ...]
S = TypeVar("S")


class Dropper(NamedTuple):
    """An output that releases one object when it is set, and must be reset before the next release.

    ``release`` and ``rest`` are the two settings of the output. For a servo, the settings are pulse
    widths in microseconds, for an actuator values from -1 to 1; a gripper has no settings.
    """

    by: Literal["servo", "gripper", "actuator"]
    number: int
    release: float = 0.0
    rest: float = 0.0
    hold_s: float = 0.2  # duration of the release setting


def arm(stack: Stack) -> Steps:
    """Return the step that arms; the autopilot runs its arming checks."""
    return (ARM,)


def disarm(stack: Stack) -> Steps:
    """Return the step that disarms; autopilots reject the step in the air."""
    return (Step(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,)),)


def set_mode(stack: Stack, name: str) -> Steps:
    """Return the step that changes to the mode called ``name`` in ``Stack.modes``."""
    return (stack.set_mode(stack.mode_number(name)),)


def takeoff(stack: Stack, height_m: float, ground_amsl_m: float) -> Steps:
    """Return the steps that arm, take off and hold at ``height_m`` above the ground.

    ArduPlane climbs to the height in its parameter TKOFF_ALT, which the steps change permanently.
    A VTOL climbs vertically; then PX4 hovers, and ArduPlane circles as a plane.
    """
    if not 1.0 <= height_m <= 10_000.0:
        raise BridgeError(
            f"takeoff to {height_m} m: the height must be 1 to 10000 m above the ground"
        )
    if stack.name == "px4":
        climb = Step(
            mavlink.MAV_CMD_NAV_TAKEOFF, (NAN, NAN, NAN, NAN, NAN, NAN, ground_amsl_m + height_m)
        )
        return climb, ARM
    if stack.vehicle == "plane" and not stack.vtol:
        return SetParameter("TKOFF_ALT", height_m), *set_mode(stack, "takeoff"), ARM
    climb = Step(mavlink.MAV_CMD_NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m))
    return *set_mode(stack, "guided"), ARM, climb


def start_mission(stack: Stack, armed: bool) -> tuple[Step, ...]:
    """Return the steps that start the mission on the ground or, if armed, resume it in flight."""
    return resume(stack) if armed else stack.start


def pause(stack: Stack) -> Steps:
    """Return the step that holds at the current position: planes circle, multirotors stop.

    PX4 executes a DO_REPOSITION in its hold mode, so a change to that mode would not stop a vehicle
    that flies to the position of a DO_REPOSITION.
    """
    if stack.name == "px4":
        return (Step(mavlink.MAV_CMD_DO_REPOSITION, (-1.0, CHANGE_MODE, 0.0, NAN), SAME_PLACE),)
    return (stack.set_mode(stack.hold_mode),)


def resume(stack: Stack) -> tuple[Step, ...]:
    """Return the step that continues the mission at its current item."""
    return (stack.set_mode(stack.mission_mode),)


def return_home(stack: Stack) -> tuple[Step, ...]:
    """Return the step that flies to the launch position or the autopilot's return point."""
    return (stack.set_mode(stack.rtl_mode),)


def return_height(stack: Stack, height_m: float) -> Steps:
    """Return the steps that set the minimum height above home at which a multirotor returns.

    The parameters are changed permanently. By default ArduCopter returns at its current height, but
    no lower than 15 m. PX4 returns at a height that decreases near home.
    """
    if stack.vehicle != "copter":
        raise BridgeError("the return height can be set only for multirotors")
    if not 1.0 <= height_m <= 3000.0:
        raise BridgeError(f"return at {height_m:g} m: the height must be 1 to 3000 m above home")
    if stack.name == "px4":
        return SetParameter("RTL_RETURN_ALT", height_m), SetParameter("RTL_CONE_ANG", 0.0)
    return (SetParameter("RTL_ALT", round(height_m * 100.0)),)


def land(stack: Stack) -> Steps:
    """Return the step that lands: ArduPilot planes by DO_LAND_START, others at their position."""
    if stack.name == "ardupilot" and stack.vtol:
        return set_mode(stack, "qland")
    if stack.name == "ardupilot" and stack.vehicle == "plane":
        return (Step(mavlink.MAV_CMD_DO_LAND_START),)
    return set_mode(stack, "land")


def go_around(stack: Stack, lat_deg: float, lon_deg: float, altitude_amsl_m: float) -> Steps:
    """Return the step that aborts a landing on its final leg.

    ArduPlane climbs straight ahead, and continues with the item after the landing; a mission with a
    landing therefore contains the go-around position. Other vehicles fly to the position and hold
    there.
    """
    if stack.name == "ardupilot" and stack.vehicle == "plane":
        return (Step(mavlink.MAV_CMD_DO_GO_AROUND, (GO_AROUND_CLIMB_M,)),)
    return reposition(stack, lat_deg, lon_deg, altitude_amsl_m)


def reposition(stack: Stack, lat_deg: float, lon_deg: float, altitude_amsl_m: float) -> Steps:
    """Return the step that flies to a position and holds there; planes keep the loiter radius."""
    place = _place(lat_deg, lon_deg, altitude_amsl_m)
    # For ArduPilot, radius 0 means the current radius. For PX4, yaw NaN means its default.
    params = (-1.0, CHANGE_MODE, 0.0, NAN if stack.name == "px4" else 0.0)
    return (Step(mavlink.MAV_CMD_DO_REPOSITION, params, place),)


def orbit(
    stack: Stack,
    lat_deg: float,
    lon_deg: float,
    altitude_amsl_m: float,
    radius_m: float,
    speed_m_s: float | None = None,
) -> Steps:
    """Return the steps that circle a position, clockwise if the radius is positive.

    A further orbit command moves or changes the circle. If ``speed_m_s`` is given, the steps
    command that speed too; otherwise PX4 multirotors circle at 1 m/s at first.
    """
    place = _place(lat_deg, lon_deg, altitude_amsl_m)
    if stack.name == "ardupilot" and stack.vehicle == "copter":
        raise BridgeError(
            "ArduCopter 4.6 has no orbit command; use LOITER_TURNS items or repeated repositions"
        )
    px4_copter = stack.name == "px4" and stack.vehicle == "copter"
    max_m = PX4_MAX_ORBIT_RADIUS_M if px4_copter else PLANE_MAX_RADIUS_M
    if not 1.0 <= abs(radius_m) <= max_m:
        raise BridgeError(
            f"orbit of radius {radius_m} m: the radius must be 1 to {max_m:.0f} m (negative: "
            "anticlockwise)"
        )
    change = () if speed_m_s is None or px4_copter else change_speed(stack, speed_m_s)
    if stack.name == "ardupilot":
        anticlockwise = 1.0 if radius_m < 0.0 else 0.0
        params = (-1.0, CHANGE_MODE, abs(radius_m), anticlockwise)
        return Step(mavlink.MAV_CMD_DO_REPOSITION, params, place), *change
    if px4_copter and speed_m_s is not None:
        _checked_speed(speed_m_s)
    velocity = speed_m_s if px4_copter and speed_m_s is not None else NAN
    return Step(mavlink.MAV_CMD_DO_ORBIT, (radius_m, velocity, NAN, NAN), place), *change


def climb_and_hold(stack: Stack, lat_deg: float, lon_deg: float, altitude_amsl_m: float) -> Steps:
    """Return the step with which a multirotor climbs at a position and holds there."""
    if stack.vehicle != "copter":
        raise BridgeError("only a multirotor can climb and hold; a plane cannot climb in place")
    return reposition(stack, lat_deg, lon_deg, altitude_amsl_m)


def drop(stack: Stack, dropper: Dropper) -> tuple[Step, Step]:
    """Return the step that releases an object, and the step that resets the dropper.

    The first step must be sent only once, because sending it again may release another object. PX4
    has no servo command, and it accepts actuator commands even if no output is configured.
    """
    match dropper.by:
        case "servo" if stack.name == "px4":
            raise BridgeError(
                "PX4 has no DO_SET_SERVO; configure the dropper as a gripper or as an actuator"
            )
        case "actuator" if stack.name == "ardupilot":
            raise BridgeError(
                "ArduPilot has no DO_SET_ACTUATOR; configure the dropper as a servo or a gripper"
            )
        case "gripper":
            _check_output(dropper, 1, 6, None)
            number = float(dropper.number)
            return (
                Step(mavlink.MAV_CMD_DO_GRIPPER, (number, GRIPPER_RELEASE)),
                Step(mavlink.MAV_CMD_DO_GRIPPER, (number, GRIPPER_GRAB)),
            )
        case "servo":
            first = 5 if stack.vehicle == "copter" else 1  # outputs 1 to 4 control motors
            _check_output(dropper, first, 16, SERVO_US)
            number = float(dropper.number)
            return (
                Step(mavlink.MAV_CMD_DO_SET_SERVO, (number, dropper.release)),
                Step(mavlink.MAV_CMD_DO_SET_SERVO, (number, dropper.rest)),
            )
        case "actuator":
            _check_output(dropper, 1, PX4_MAX_ACTUATORS, (-1.0, 1.0))
            return (
                Step(mavlink.MAV_CMD_DO_SET_ACTUATOR, _actuators(dropper.number, dropper.release)),
                Step(mavlink.MAV_CMD_DO_SET_ACTUATOR, _actuators(dropper.number, dropper.rest)),
            )


def _check_output(
    dropper: Dropper, first: int, last: int, values: tuple[float, float] | None
) -> None:
    """Raise BridgeError unless the output is valid and its two values differ."""
    subject = f"dropper by {dropper.by}"
    if not first <= dropper.number <= last:
        raise BridgeError(f"{subject}: number {dropper.number} must be {first} to {last}")
    if not 0.0 < dropper.hold_s <= 5.0:
        raise BridgeError(
            f"{subject}: hold of {dropper.hold_s} s must be more than 0 s and at most 5 s"
        )
    if values is None:
        return
    minimum, maximum = values
    for name, value in (("release", dropper.release), ("rest", dropper.rest)):
        if not minimum <= value <= maximum:
            raise BridgeError(f"{subject}: {name} {value:g} must be {minimum:g} to {maximum:g}")
    if dropper.release == dropper.rest:
        raise BridgeError(
            f"{subject}: release and rest are both {dropper.rest:g}; they must differ"
        )


def _actuators(number: int, value: float) -> tuple[float, ...]:
    """Return params 1 to 7 of the command that sets one actuator (1 to 6) and no other."""
    values = [NAN] * PX4_MAX_ACTUATORS
    values[number - 1] = value
    return (*values, 0.0)


def change_speed(stack: Stack, speed_m_s: float, orbiting: bool = False) -> Steps:
    """Return the step that sets the airspeed of a plane or the ground speed of a multirotor.

    The speed applies until the next change of speed or mode. A PX4 multirotor in an orbit accepts
    this command but ignores it; with ``orbiting`` the step therefore commands the speed of the
    orbit.
    """
    _checked_speed(speed_m_s)
    if orbiting and stack.name == "px4" and stack.vehicle == "copter":
        return (Step(mavlink.MAV_CMD_DO_ORBIT, (NAN, speed_m_s, NAN, NAN), SAME_PLACE),)
    kind = float(speed_type(stack.vehicle))
    return (Step(mavlink.MAV_CMD_DO_CHANGE_SPEED, (kind, speed_m_s, -1.0)),)


def _checked_speed(speed_m_s: float) -> None:
    if not 0.0 < speed_m_s <= 200.0:
        raise BridgeError(f"speed of {speed_m_s} m/s: must be more than 0 and at most 200 m/s")


def _place(lat_deg: float, lon_deg: float, altitude_amsl_m: float) -> Place:
    # PX4 also accepts invalid values.
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise BridgeError(f"latitude {lat_deg}, longitude {lon_deg} is not a valid position")
    if lat_deg == 0.0 and lon_deg == 0.0:
        raise BridgeError(
            "autopilots interpret latitude 0, longitude 0 as their current position; specify "
            "another position"
        )
    if not -1000.0 <= altitude_amsl_m <= 20_000.0:
        raise BridgeError(f"altitude {altitude_amsl_m} m AMSL: must be -1000 to 20000 m")
    return Place(
        mavlink.MAV_FRAME_GLOBAL, round(lat_deg * 1e7), round(lon_deg * 1e7), altitude_amsl_m
    )


# Timing of commands that need fast retries.
AT_ONCE = TransferTiming(timeout_us=400_000, retries=40)


class OrderContext(NamedTuple):
    """The part of the vehicle's state that determines the steps of an order."""

    stack: Stack
    armed: bool = False
    mode: str = ""
    altitude_amsl_m: float | None = None  # None before the first position


class Order(NamedTuple):
    """One row of ``ORDERS``.

    Attributes:
        steps: Returns the commands for the context and the arguments of the order.
        urgent: Whether the order replaces all orders that have not ended, and is repeated even if
            no heartbeats arrive.
        timing: Timeout and retries until the order is acknowledged; None means the client's
            defaults.
        through_mavsdk: Returns the steps for MAVSDK, which cannot send NaN; None if MAVSDK cannot
            send the order.
    """

    steps: Callable[..., Steps]
    urgent: bool = False
    timing: TransferTiming | None = None
    through_mavsdk: Callable[..., tuple[Step, ...]] | None = None


def _takeoff(context: OrderContext, height_m: float) -> Steps:
    if context.altitude_amsl_m is None:
        raise BridgeError("the vehicle has not reported a position; wait for the event Position")
    return takeoff(context.stack, height_m, context.altitude_amsl_m)


def _of_stack(steps: Callable[..., S]) -> Callable[..., S]:
    return lambda context, *arguments: steps(context.stack, *arguments)


def _start_mission(context: OrderContext) -> tuple[Step, ...]:
    return start_mission(context.stack, context.armed)


def _hold_mode(context: OrderContext) -> tuple[Step, ...]:
    return (context.stack.set_mode(context.stack.hold_mode),)


ORDERS = {
    "arm": Order(_of_stack(arm)),
    "disarm": Order(_of_stack(disarm), urgent=True),
    "takeoff": Order(_takeoff),  # height_m above the ground
    "start mission": Order(_start_mission, through_mavsdk=_start_mission),
    "hold": Order(_of_stack(pause), urgent=True, through_mavsdk=_hold_mode),
    "resume": Order(_of_stack(resume)),
    "return": Order(_of_stack(return_home), urgent=True, through_mavsdk=_of_stack(return_home)),
    "return height": Order(_of_stack(return_height)),  # height_m above home
    "land": Order(_of_stack(land), urgent=True),
    "fly landing": Order(_of_stack(resume), through_mavsdk=_of_stack(resume)),
    # lat_deg, lon_deg, altitude_amsl_m
    "go around": Order(_of_stack(go_around), urgent=True, timing=AT_ONCE),
    "reposition": Order(_of_stack(reposition)),  # lat_deg, lon_deg, altitude_amsl_m
    # Like "reposition", but before all other commands: lat_deg, lon_deg, altitude_amsl_m
    "hold at another height": Order(_of_stack(reposition), urgent=True),
    # lat_deg, lon_deg, altitude_amsl_m
    "climb and hold": Order(_of_stack(climb_and_hold), urgent=True, timing=AT_ONCE),
    "orbit": Order(_of_stack(orbit)),  # lat_deg, lon_deg, altitude_amsl_m, radius_m[, speed_m_s]
    "change speed": Order(
        lambda context, speed_m_s: change_speed(context.stack, speed_m_s, context.mode == "orbit")
    ),
    "mode": Order(_of_stack(set_mode)),  # a name of Stack.modes
}


def order_named(name: str) -> Order:
    """Return the row of a command.

    Raises:
        BridgeError: The command does not exist; the text lists all commands.
    """
    if name not in ORDERS:
        raise BridgeError(f"unknown vehicle command {name!r}; the commands are {', '.join(ORDERS)}")
    return ORDERS[name]
