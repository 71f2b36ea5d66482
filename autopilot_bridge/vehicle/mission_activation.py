"""Activates an uploaded mission: starts it, and waits for proof that it is being flown.

PX4 starts a new list without a command, at the item that was sent with ``current`` set.
MISSION_CURRENT, sent once a second, contains the id of the list, and whether the list is *fit* (PX4
accepts it for flight). The sequence number of MISSION_CURRENT is weak evidence: a plane in the air
skips its takeoff item at once, and a waypoint may be reached before the first message arrives. If
the same list (the same id) was on board before, PX4 keeps its current item, and the first item to
fly must be commanded.

ArduPilot flies on to its old target, and keeps its current item, until an item is commanded.
ArduPilot acknowledges that command. If the acknowledgement is lost, a sequence number before the
old current item also proves the start. A later one does not: the vehicle may have reached it in the
old list, just before the new list arrived.

sent --acknowledgement, or report of the new item--> ended
sent --timeout after a report of the old item--> repeated; without a report: wait
watching --the list's id, and the list is fit--> ended
either --the list's id, and the list remains unfit--> ended, rejected
either --the id of another list several times--> ended, failed

The command is repeated only after a report that does not prove the start. If the vehicle has
already advanced in the new list, the repeated command leads it back to the first item.
"""

from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import (
    Address,
    Exchange,
    TransferResult,
    TransferTiming,
    is_for,
)
from autopilot_bridge.stacks.stacks import Step
from autopilot_bridge.vehicle.command_sequence import command_message, result_words

SETTLED_US = 300_000  # PX4 checks a mission after its acknowledgement (observed: 60 ms later)
UNFIT_FOR_US = 1_000_000
ANSWERED_US = 700_000  # messages this soon after a command may have been sent before the command
OTHERS = 5  # consecutive messages with the id of another list
TRIES = 12
SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT


class Onboard(NamedTuple):
    """The mission and the current item before an upload, as in MISSION_CURRENT."""

    seq: int | None
    plan_id: int | None
    unfit: bool


class MissionActivation(Exchange):
    """An exchange that starts a new mission and waits for proof that it is flown.

    ``count`` items are transmitted; ``seq`` is the item to start with. ``shown`` is the number of
    the item that the autopilot then reports as current; ``shown`` differs from ``seq`` if ArduPilot
    skips DO items. ``plan_id`` is the id of the list; None on ArduPilot.
    """

    def __init__(
        self,
        address: Address,
        seq: int,
        shown: int,
        count: int,
        plan_id: int | None,
        before: Onboard,
        timing: TransferTiming,
    ) -> None:
        super().__init__(address, timing)
        self.other_list = False  # whether the vehicle reported the id of another list
        self._seq = seq
        self._shown = shown
        self._count = count
        self._plan_id = plan_id
        self._before = before
        same_list = plan_id is not None and before.plan_id == plan_id
        # Whether the vehicle flies the mission only after a command.
        self.needs_command = plan_id is None or (same_list and before.seq != seq)
        # If the start is not at item 0, PX4 does not report again that a list is fit (source: 1.17
        # ``update_mission_state``).
        self._checks_state = plan_id is not None and not (before.unfit and seq > 0)
        self._started_us = self._requested_us = 0
        self._tries = 0
        self._last_seq: int | None = None  # the newest sequence number since the last command
        self._unfit_since_us: int | None = None
        self._others = 0
        self._warning_text = ""

    def start(self, now_us: int) -> list[Message]:
        """Send the command, or wait for MISSION_CURRENT."""
        self._started_us = now_us
        return self._send_request(now_us) if self.needs_command else self._wait(now_us)

    def _send_request(self, now_us: int) -> list[Message]:
        self._requested_us, self._last_seq = now_us, None
        self._wait(now_us)
        target = self._address.target
        if self._plan_id is not None:
            return [mavlink.MAVLink_mission_set_current_message(*target, self._seq)]
        return [command_message(target, Step(SET_CURRENT, (float(self._seq),)), 0)]

    def _wait(self, now_us: int) -> list[Message]:
        self._deadline_us = now_us + self._timing.timeout_us
        return []

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Check a message for proof that the mission has started or is rejected."""
        if not self._is_from_target(message):
            return []
        match message.get_type():
            case "STATUSTEXT" if message.severity <= mavlink.MAV_SEVERITY_WARNING:
                self._warning_text = f": {message.text.strip()}"
            case "COMMAND_ACK" if self.needs_command and self._plan_id is None:
                self._acknowledged(message)
            case "MISSION_CURRENT" if self._shows_list(message):
                self._check(message, now_us)
            case _:
                pass
        return []

    def _acknowledged(self, message: Message) -> None:
        if not is_for(message, self._address.own) or message.command != SET_CURRENT:
            return
        if message.result == mavlink.MAV_RESULT_ACCEPTED:
            self.result = TransferResult("accepted", f"item {self._seq} is current")
        elif message.result != mavlink.MAV_RESULT_IN_PROGRESS:
            words = result_words(message.result)
            self.result = TransferResult(
                "failed", f"the start command: {words}{self._warning_text}"
            )

    def _shows_list(self, message: Message) -> bool:
        """Return whether a MISSION_CURRENT describes the new list."""
        if self._plan_id is None:
            return True
        reported_id = message.mission_id
        if reported_id == self._plan_id or (not reported_id and message.total == self._count):
            self._others = 0
            return True
        self._others += 1
        if self._others >= OTHERS:
            self.other_list = True
            self.result = TransferResult("failed", "the vehicle reports the id of another mission")
        return False

    def _check(self, message: Message, now_us: int) -> None:
        if self._checks_state and message.mission_state == mavlink.MISSION_STATE_NO_MISSION:
            self._unfit(now_us)
            return
        self._unfit_since_us = None
        if not self.needs_command:
            if now_us - self._started_us >= SETTLED_US:
                self.result = TransferResult("accepted", f"item {message.seq} is current")
            return
        if self._has_begun(message.seq):
            self.result = TransferResult("accepted", f"item {message.seq} is current")
        elif now_us - self._requested_us >= ANSWERED_US:
            self._last_seq = message.seq

    def _has_begun(self, seq: int) -> bool:
        """Return whether a sequence number alone proves that the mission has begun."""
        before = self._before.seq
        if self._plan_id is not None:  # the list is the same; another item was commanded
            return seq != before
        # Without the command, the vehicle may only have advanced.
        return before is not None and self._shown <= seq < before

    def _unfit(self, now_us: int) -> None:
        """Reject the mission if it is reported as unfit for ``UNFIT_FOR_US``.

        The first report may concern the old mission.
        """
        if self._unfit_since_us is None:
            self._unfit_since_us = now_us
        elif now_us - self._unfit_since_us >= UNFIT_FOR_US:
            words = "the mission is on board, but the vehicle does not accept it for flight"
            self.result = TransferResult("rejected", f"{words}{self._warning_text}")

    def stop_commands(self, why: str) -> None:
        """End a start that needs a command, because the autopilot or a pilot changed the mode."""
        if self.needs_command and self.result is None:
            self.result = TransferResult("failed", why)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the command after a report without proof, otherwise wait; fail after ``TRIES``."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        self._tries += 1
        if self._tries > TRIES:
            missing = "no MISSION_CURRENT" if self._last_seq is None else "no message"
            self.result = TransferResult("failed", f"{missing} confirmed the start")
            return []
        if self.needs_command and self._last_seq is not None:
            return self._send_request(now_us)
        return self._wait(now_us)
