"""Reports and sets some parameters of each stack as the real autopilots do."""

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.codec import Message
from autopilot_bridge.mock.kinematics import Limits
from autopilot_bridge.stacks.return_flight import ReturnFlight, return_flight_of
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.parameters import REAL32, decoded_value, encoded_value

INT8, INT16, INT32 = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT16,
    mavlink.MAV_PARAM_TYPE_INT32,
)
NO_INDEX = 65535

_ARDUPILOT = {
    "FENCE_ACTION": (1.0, INT8),
    "FENCE_ENABLE": (0.0, INT8),
    "SYSID_MYGCS": (255.0, INT16),
    "SYSID_THISMAV": (1.0, INT16),
}
_PLANE = {
    **_ARDUPILOT,
    "AIRSPEED_CRUISE": (22.0, REAL32),
    "AIRSPEED_MAX": (30.0, INT16),
    "AIRSPEED_MIN": (10.0, INT16),
    "FS_GCS_ENABL": (0.0, INT8),
    "FS_LONG_ACTN": (0.0, INT8),
    "FS_LONG_TIMEOUT": (5.0, REAL32),
    "Q_ENABLE": (0.0, INT8),
    "RTL_ALTITUDE": (100.0, REAL32),
    "RTL_AUTOLAND": (0.0, INT8),
    "SERIAL0_BAUD": (115.0, INT32),
    "TKOFF_ALT": (50.0, REAL32),
    "WP_LOITER_RAD": (80.0, INT16),
}
_COPTER = {
    **_ARDUPILOT,
    "ARMING_CHECK": (1.0, INT32),
    "FS_GCS_ENABLE": (0.0, INT8),
    "FS_GCS_TIMEOUT": (5.0, REAL32),
    "FS_OPTIONS": (16.0, INT32),
    "RTL_ALT": (1500.0, INT32),
    "RTL_SPEED": (0.0, INT16),
    "WPNAV_ACCEL": (250.0, REAL32),
    "WPNAV_SPEED": (1000.0, REAL32),
    "WPNAV_SPEED_UP": (250.0, REAL32),
}
_PX4 = {
    "COM_DL_LOSS_T": (10.0, INT32),
    "COM_DLL_EXCEPT": (0.0, INT32),
    "COM_FAIL_ACT_T": (5.0, REAL32),
    "COM_RC_IN_MODE": (1.0, INT32),
    "FW_AIRSPD_TRIM": (15.0, REAL32),
    "FW_R_LIM": (50.0, REAL32),
    "FW_T_CLMB_R_SP": (3.0, REAL32),
    "MIS_TAKEOFF_ALT": (20.0, REAL32),
    "MIS_TKO_LAND_REQ": (0.0, INT32),
    "MAV_SYS_ID": (1.0, INT32),
    "GF_ACTION": (2.0, INT32),
    "MPC_ACC_HOR": (3.0, REAL32),
    "MPC_XY_CRUISE": (5.0, REAL32),
    "MPC_Z_V_AUTO_UP": (3.0, REAL32),
    "NAV_DLL_ACT": (0.0, INT32),
    "NAV_LOITER_RAD": (80.0, REAL32),
    "RTL_CONE_ANG": (45.0, INT32),
    "RTL_RETURN_ALT": (60.0, REAL32),
    "RTL_TYPE": (0.0, INT32),
}


@dataclass(slots=True)
class _Held:
    value: float
    kind: int


def _of_limits(stack: Stack, limits: Limits) -> dict[str, float]:
    """Return the parameters for speeds and acceleration; ArduPilot's multirotors use cm."""
    speed_m_s, climb_m_s = limits.airspeed_m_s, limits.climb_m_s
    if stack.name == "px4" and stack.vehicle == "plane":
        turn = {"FW_AIRSPD_TRIM": speed_m_s, "FW_R_LIM": limits.bank_deg}
        return {**turn, "FW_T_CLMB_R_SP": climb_m_s}
    if stack.name == "px4":
        up = {"MPC_XY_CRUISE": speed_m_s, "MPC_Z_V_AUTO_UP": climb_m_s}
        return {**up, "MPC_ACC_HOR": limits.acceleration_m_s2}
    if stack.vehicle == "plane":
        return {"AIRSPEED_CRUISE": speed_m_s}
    up = {"WPNAV_SPEED": 100.0 * speed_m_s, "WPNAV_SPEED_UP": 100.0 * climb_m_s}
    return {**up, "WPNAV_ACCEL": 100.0 * limits.acceleration_m_s2}


class ParameterServer:
    """The parameters of one mock; requests with unknown names get no reply.

    The return parameters agree with the mock's ``limits``.
    """

    def __init__(self, stack: Stack, limits: Limits) -> None:
        self._stack = stack
        self._bytewise = stack.bytewise
        plane = stack.vehicle == "plane"
        table = _PX4 if self._bytewise else _PLANE if plane else _COPTER
        self._held = {name: _Held(*held) for name, held in sorted(table.items())}
        if self._bytewise and plane:
            self.change("MIS_TKO_LAND_REQ", 2.0)  # the default of PX4 for fixed wings
        if stack.vtol and not self._bytewise:
            self.change("Q_ENABLE", 1.0)
        for name, value in _of_limits(stack, limits).items():
            self.change(name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters."""
        return tuple(self._held)

    @property
    def return_flight(self) -> ReturnFlight:
        """How the vehicle returns."""
        return return_flight_of(
            self._stack, {name: held.value for name, held in self._held.items()}
        )

    def value(self, name: str) -> float:
        """Return a parameter's value."""
        return self._held[name].value

    def change(self, name: str, value: float) -> None:
        """Set a parameter without a message."""
        self._held[name].value = value

    def receive(self, message: Message) -> list[Message]:
        """Return the replies to a PARAM_REQUEST_LIST, a PARAM_REQUEST_READ or a PARAM_SET."""
        names = list(self._held)
        match message.get_type():
            case "PARAM_REQUEST_LIST":
                # PX4 first sends a hash of all parameters, which has no index.
                reported = [self._param_value(name, index) for index, name in enumerate(names)]
                return [*self._hash(), *reported]
            case "PARAM_REQUEST_READ" if 0 <= message.param_index < len(names):
                return [self._param_value(names[message.param_index], message.param_index)]
            case "PARAM_REQUEST_READ" if message.param_index < 0 and message.param_id in names:
                return [self._param_value(message.param_id, self._index(message.param_id))]
            case "PARAM_SET" if message.param_id in names:
                return self._set(message)
        return []

    def _index(self, name: str) -> int:
        # ArduPilot sends an index only in the list.
        return list(self._held).index(name) if self._bytewise else NO_INDEX

    def _hash(self) -> list[Message]:
        if not self._bytewise:
            return []
        kind = mavlink.MAV_PARAM_TYPE_UINT32
        wire = encoded_value(0x12345678, kind, True)
        count = len(self._held)
        return [mavlink.MAVLink_param_value_message(b"_HASH_CHECK", wire, kind, count, NO_INDEX)]

    def _param_value(self, name: str, index: int) -> Message:
        held = self._held[name]
        wire = encoded_value(held.value, held.kind, self._bytewise)
        count = len(self._held)
        return mavlink.MAVLink_param_value_message(name.encode(), wire, held.kind, count, index)

    def _set(self, message: Message) -> list[Message]:
        held = self._held[message.param_id]
        if self._bytewise and message.param_type != held.kind:
            return []  # PX4 requires the exact type
        value = decoded_value(message.param_value, held.kind, self._bytewise)
        try:
            encoded_value(value, held.kind, self._bytewise)
        except BridgeError:
            value = float(int(value))  # ArduPilot casts the value
        held.value = value
        return [self._param_value(message.param_id, self._index(message.param_id))]
