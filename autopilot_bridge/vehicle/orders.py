"""The commands of a vehicle: the MAV_CMDs of each stack, their arguments and retries.

``ORDERS`` is the table. To add a command, add a row and the function of its steps. Read and flown:
PX4 1.17, ArduPilot 4.6.2. A command that a stack does not have raises BridgeError. Altitudes are
above mean sea level unless the name differs.
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

PX4_MAX_ACTUATORS = 6
SERVO_US = (500.0, 2500.0)  # pulses that servos take
GRIPPER_RELEASE = float(mavlink.GRIPPER_ACTION_RELEASE)
GRIPPER_GRAB = float(mavlink.GRIPPER_ACTION_GRAB)

Steps = tuple[AnyStep, ...]
S = TypeVar("S")


class Dropper(NamedTuple):
    """An output that releases one object each time it is set, and must be set back in between.

    ``release`` and ``rest`` are a servo's PWM in us or an actuator's -1 to 1; a gripper has none.
    """

    by: Literal["servo", "gripper", "actuator"]
    number: int
    release: float = 0.0
    rest: float = 0.0
    hold_s: float = 0.2  # duration of the release setting


def arm(stack: Stack) -> Steps:
    """Arm, with the autopilot's checks."""
    return (ARM,)


def disarm(stack: Stack) -> Steps:
    """Disarm; autopilots refuse it in the air."""
    return (Step(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,)),)


def set_mode(stack: Stack, name: str) -> Steps:
    """Change to a mode by its name in ``Stack.modes``."""
    return (stack.set_mode(stack.mode_number(name)),)


def takeoff(stack: Stack, height_m: float, ground_amsl_m: float) -> Steps:
    """Arm, take off from the ground and hold ``height_m`` above it.

    ArduPlane climbs to its parameter TKOFF_ALT, which is set for that and stays set.
    """
    if not 1.0 <= height_m <= 10_000.0:
        raise BridgeError(f"takeoff to {height_m} m: take 1 to 10000 m above the ground")
    if stack.name == "px4":
        climb = Step(
            mavlink.MAV_CMD_NAV_TAKEOFF, (NAN, NAN, NAN, NAN, NAN, NAN, ground_amsl_m + height_m)
        )
        return climb, ARM
    if stack.vehicle == "plane":
        return SetParameter("TKOFF_ALT", height_m), *set_mode(stack, "takeoff"), ARM
    climb = Step(mavlink.MAV_CMD_NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m))
    return *set_mode(stack, "guided"), ARM, climb


def start_mission(stack: Stack, armed: bool) -> tuple[Step, ...]:
    """Fly the mission: from the ground with arming, or go on with it in flight."""
    return resume(stack) if armed else stack.start


def pause(stack: Stack) -> Steps:
    """Hold here: planes circle, multirotors stop.

    PX4 repositions in its hold mode, so changing to that mode would not end a reposition.
    """
    if stack.name == "px4":
        return (Step(mavlink.MAV_CMD_DO_REPOSITION, (-1.0, CHANGE_MODE, 0.0, NAN), SAME_PLACE),)
    return (stack.set_mode(stack.hold_mode),)


def resume(stack: Stack) -> tuple[Step, ...]:
    """Go on with the mission at the item where it was left."""
    return (stack.set_mode(stack.mission_mode),)


def return_home(stack: Stack) -> tuple[Step, ...]:
    """Return to the launch place, or to the autopilot's configured return point."""
    return (stack.set_mode(stack.rtl_mode),)


def return_height(stack: Stack, height_m: float) -> Steps:
    """Set the minimum height of returns above home, permanently; multirotors only.

    As delivered ArduCopter returns at 15 m or as low as it flies, and PX4 lower the nearer it is to
    home.
    """
    if stack.vehicle != "copter":
        raise BridgeError("the height of returns is set for multirotors only")
    if not 1.0 <= height_m <= 3000.0:
        raise BridgeError(f"return at {height_m:g} m: take 1 to 3000 m above home")
    if stack.name == "px4":
        return SetParameter("RTL_RETURN_ALT", height_m), SetParameter("RTL_CONE_ANG", 0.0)
    return (SetParameter("RTL_ALT", round(height_m * 100.0)),)


def land(stack: Stack) -> Steps:
    """Land: here, but ArduPlane only by the landing of its mission (after its DO_LAND_START)."""
    if stack.name == "ardupilot" and stack.vehicle == "plane":
        return (Step(mavlink.MAV_CMD_DO_LAND_START),)
    return set_mode(stack, "land")


def reposition(stack: Stack, lat_deg: float, lon_deg: float, altitude_amsl_m: float) -> Steps:
    """Fly to a place and hold there; planes circle it as they did before or by their default."""
    place = _place(lat_deg, lon_deg, altitude_amsl_m)
    # Zero radius on ArduPilot: keep the one there is. NaN yaw on PX4: its own choice.
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
    """Circle a place, clockwise with a positive radius; again to move or change the circle.

    A given speed is commanded too; without one PX4 multirotors circle at 1 m/s at first.
    """
    place = _place(lat_deg, lon_deg, altitude_amsl_m)
    if stack.name == "ardupilot" and stack.vehicle == "copter":
        raise BridgeError(
            "ArduCopter 4.6 has no orbit command; fly LOITER_TURNS items or reposition around"
        )
    px4_copter = stack.name == "px4" and stack.vehicle == "copter"
    max_m = PX4_MAX_ORBIT_RADIUS_M if px4_copter else PLANE_MAX_RADIUS_M
    if not 1.0 <= abs(radius_m) <= max_m:
        raise BridgeError(f"orbit of radius {radius_m} m: take 1 to {max_m:.0f} m, with its sign")
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
    """Stop the present flight, climb at a place and hold there; multirotors only."""
    if stack.vehicle != "copter":
        raise BridgeError("climb and hold is for multirotors; a plane cannot climb in place")
    return reposition(stack, lat_deg, lon_deg, altitude_amsl_m)


def drop(stack: Stack, dropper: Dropper) -> tuple[Step, Step]:
    """Return the step that releases, and the step that sets the dropper back.

    The first must be sent once only: a second one may release another object. PX4 has no servo
    command, and accepts actuator commands for which no output is configured.
    """
    match dropper.by:
        case "servo" if stack.name == "px4":
            raise BridgeError(
                "PX4 has no DO_SET_SERVO; set the dropper up as a gripper or as an actuator"
            )
        case "actuator" if stack.name == "ardupilot":
            raise BridgeError(
                "ArduPilot has no DO_SET_ACTUATOR; set the dropper up as a servo or as a gripper"
            )
        case "gripper":
            _check_output(dropper, 1, 6, None)
            number = float(dropper.number)
            return (
                Step(mavlink.MAV_CMD_DO_GRIPPER, (number, GRIPPER_RELEASE)),
                Step(mavlink.MAV_CMD_DO_GRIPPER, (number, GRIPPER_GRAB)),
            )
        case "servo":
            first = 5 if stack.vehicle == "copter" else 1  # the others turn the motors
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
    """Raise BridgeError unless there is such an output and its two values differ."""
    what = f"dropper by {dropper.by}"
    if not first <= dropper.number <= last:
        raise BridgeError(f"{what}: number {dropper.number}, take {first} to {last}")
    if not 0.0 < dropper.hold_s <= 5.0:
        raise BridgeError(f"{what}: hold of {dropper.hold_s} s, take more than 0 and at most 5")
    if values is None:
        return
    least, most = values
    for name, value in (("release", dropper.release), ("rest", dropper.rest)):
        if not least <= value <= most:
            raise BridgeError(f"{what}: {name} {value:g}, take {least:g} to {most:g}")
    if dropper.release == dropper.rest:
        raise BridgeError(f"{what}: release and rest are both {dropper.rest:g}: nothing would fall")


def _actuators(number: int, value: float) -> tuple[float, ...]:
    """Params 1 to 7 that set one of the actuators 1 to 6 and leave the others unchanged."""
    values = [NAN] * PX4_MAX_ACTUATORS
    values[number - 1] = value
    return (*values, 0.0)


def change_speed(stack: Stack, speed_m_s: float, orbiting: bool = False) -> Steps:
    """Airspeed of planes, ground speed of multirotors, until changed or another mode.

    A PX4 multirotor accepts it without effect while ``orbiting``; there the orbit is changed.
    """
    _checked_speed(speed_m_s)
    if orbiting and stack.name == "px4" and stack.vehicle == "copter":
        return (Step(mavlink.MAV_CMD_DO_ORBIT, (NAN, speed_m_s, NAN, NAN), SAME_PLACE),)
    kind = float(speed_type(stack.vehicle))
    return (Step(mavlink.MAV_CMD_DO_CHANGE_SPEED, (kind, speed_m_s, -1.0)),)


def _checked_speed(speed_m_s: float) -> None:
    if not 0.0 < speed_m_s <= 200.0:
        raise BridgeError(f"speed of {speed_m_s} m/s: take more than 0 and at most 200 m/s")


def _place(lat_deg: float, lon_deg: float, altitude_amsl_m: float) -> Place:
    # PX4 accepts all of these values, also invalid ones.
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise BridgeError(f"latitude {lat_deg}, longitude {lon_deg} is no place on Earth")
    if lat_deg == 0.0 and lon_deg == 0.0:
        raise BridgeError("latitude 0, longitude 0 means 'here' to autopilots; give the place")
    if not -1000.0 <= altitude_amsl_m <= 20_000.0:
        raise BridgeError(f"altitude {altitude_amsl_m} m AMSL: take -1000 to 20000 m")
    return Place(
        mavlink.MAV_FRAME_GLOBAL, round(lat_deg * 1e7), round(lon_deg * 1e7), altitude_amsl_m
    )


AT_ONCE = TransferTiming(timeout_us=400_000, retries=40)  # for commands that need fast retries


class OrderContext(NamedTuple):
    """The vehicle's state that decides which steps an order takes."""

    stack: Stack
    armed: bool = False
    mode: str = ""
    altitude_amsl_m: float | None = None  # None: no position has arrived


class Order(NamedTuple):
    """One row of ``ORDERS``.

    Attributes:
        steps: The commands, from the context and the arguments of the order.
        urgent: It replaces all orders that have not ended, and is repeated without heartbeats.
        timing: How it is repeated until it is acknowledged; None: as the client's other messages.
        through_mavsdk: The steps through MAVSDK, which carries no NaN; None: not available there.
    """

    steps: Callable[..., Steps]
    urgent: bool = False
    timing: TransferTiming | None = None
    through_mavsdk: Callable[..., tuple[Step, ...]] | None = None


def _takeoff(now: OrderContext, height_m: float) -> Steps:
    if now.altitude_amsl_m is None:
        raise BridgeError("the vehicle has reported no position yet; wait for Position")
    return takeoff(now.stack, height_m, now.altitude_amsl_m)


def _of_stack(steps: Callable[..., S]) -> Callable[..., S]:
    return lambda now, *arguments: steps(now.stack, *arguments)


def _start_mission(now: OrderContext) -> tuple[Step, ...]:
    return start_mission(now.stack, now.armed)


def _hold_mode(now: OrderContext) -> tuple[Step, ...]:
    return (now.stack.set_mode(now.stack.hold_mode),)


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
    "reposition": Order(_of_stack(reposition)),  # lat_deg, lon_deg, altitude_amsl_m
    # lat_deg, lon_deg, altitude_amsl_m
    "climb and hold": Order(_of_stack(climb_and_hold), urgent=True, timing=AT_ONCE),
    "orbit": Order(_of_stack(orbit)),  # lat_deg, lon_deg, altitude_amsl_m, radius_m[, speed_m_s]
    "change speed": Order(
        lambda now, speed_m_s: change_speed(now.stack, speed_m_s, now.mode == "orbit")
    ),
    "mode": Order(_of_stack(set_mode)),  # a name of Stack.modes
}


def order_named(name: str) -> Order:
    """Return the row of a command.

    Raises:
        BridgeError: There is no such command; the text lists those there are.
    """
    if name not in ORDERS:
        raise BridgeError(f"no vehicle command {name!r}; there are {', '.join(ORDERS)}")
    return ORDERS[name]
