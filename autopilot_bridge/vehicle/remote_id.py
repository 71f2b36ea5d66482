"""Determines the state of a vehicle's Remote ID module from its messages. Sans-IO.

The module sends OPEN_DRONE_ID_ARM_STATUS and HEARTBEAT once a second, with the system id of the
vehicle and a component id of its own. Sources of the rules:

- ArduPilot 4.6 (``AP_OpenDroneID.cpp``): forwards both messages of a MAVLink module, and sends the
  ARM_STATUS of a DroneCAN module itself.
- PX4 1.17 (``OPEN_DRONE_ID_ARM_STATUS.hpp``, ``mavlink_receiver.cpp``): sends the ARM_STATUS of a
  DroneCAN module. The messages of a MAVLink module arrive only if the port forwards them
  (``MAV_x_FORWARD``). As in PX4, a HEARTBEAT without ARM_STATUS counts as ready if its state is
  standby or active.

A module is lost if it has sent a message before and has been silent for ``SILENT_US``.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.vehicle.client_events import RemoteIdState, RemoteIdStatus

ARM_STATUS = "OPEN_DRONE_ID_ARM_STATUS"
COMPONENTS = (
    mavlink.MAV_COMP_ID_ODID_TXRX_1,
    mavlink.MAV_COMP_ID_ODID_TXRX_2,
    mavlink.MAV_COMP_ID_ODID_TXRX_3,
)
SILENT_US = 5_000_000  # ArduPilot reports a lost transmitter after the same time
HEALTHY = (mavlink.MAV_STATE_STANDBY, mavlink.MAV_STATE_ACTIVE)
BY_HEARTBEAT = "healthy according to its HEARTBEAT, no arm status received"


def is_of_remote_id(message: Message) -> bool:
    """Return whether a message is an ARM_STATUS, or the HEARTBEAT of a Remote ID module."""
    kind = message.get_type()
    return kind == ARM_STATUS or (
        kind == "HEARTBEAT"
        and (message.get_srcComponent() in COMPONENTS or message.type == mavlink.MAV_TYPE_ODID)
    )


class RemoteIdMonitor:
    """The state of one vehicle's Remote ID module, reported on change."""

    def __init__(self) -> None:
        self._received_us: int | None = None  # None before the first message, and after the loss
        self._arm_status_us: int | None = None
        self._reported: tuple[RemoteIdState, str] | None = None

    def receive(self, message: Message, now_us: int) -> list[RemoteIdStatus]:
        """Process a message for which ``is_of_remote_id`` is true; return a changed state."""
        self._received_us = now_us
        if message.get_type() == ARM_STATUS:
            self._arm_status_us = now_us
            if message.status == mavlink.MAV_ODID_ARM_STATUS_GOOD_TO_ARM:
                return self._changed("ready", "", now_us)
            text = _text_of(message.error) or "no reason reported"
            return self._changed("fails", text, now_us)
        last_us = self._arm_status_us
        if last_us is not None and now_us - last_us < SILENT_US:
            return []
        self._arm_status_us = None
        if message.system_status in HEALTHY:
            return self._changed("ready", BY_HEARTBEAT, now_us)
        return self._changed("fails", f"MAV_STATE {message.system_status}", now_us)

    def next_timer(self) -> int | None:
        """Return the time at which the module counts as lost; None before its first message."""
        return None if self._received_us is None else self._received_us + SILENT_US

    def handle_timer(self, now_us: int) -> list[RemoteIdStatus]:
        """Return the changed state of a module that has become silent."""
        due_us = self.next_timer()
        if due_us is None or now_us < due_us:
            return []
        self._received_us = self._arm_status_us = None
        return self._changed("lost", f"silent for {SILENT_US // 1_000_000} s", now_us)

    def _changed(self, state: RemoteIdState, text: str, now_us: int) -> list[RemoteIdStatus]:
        if (state, text) == self._reported:
            return []
        self._reported = (state, text)
        return [RemoteIdStatus(now_us, state, text)]


def _text_of(value: str | bytes) -> str:
    """Return a text field up to its first zero; bytes that are not ASCII are replaced."""
    text = value if isinstance(value, str) else value.decode("ascii", "replace")
    return text.split("\0", 1)[0].strip()
