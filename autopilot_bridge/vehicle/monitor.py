"""Computes the state of one vehicle from the messages of its autopilot."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.field_limits import out_of_bounds
from autopilot_bridge.stacks.stacks import Stack, as_vtol, stack_of
from autopilot_bridge.vehicle.client_events import (
    AlarmEnded,
    AlarmKind,
    ClientEvent,
    ClockChanged,
    Connected,
    EstimatorStatus,
    Implausible,
    ItemReached,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Position,
    Rebooted,
    Text,
)
from autopilot_bridge.vehicle.failure_states import system_state
from autopilot_bridge.vehicle.position_plausibility import BootClock, Reach, TimeVerdict
from autopilot_bridge.vehicle.telemetry import Telemetry, boot_time_us

AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
FAILSAFES = (
    *(mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY),
    mavlink.MAV_STATE_FLIGHT_TERMINATION,
)
ALARM_ENDS_US = 10_000_000  # the alarm ends this long after the last message that caused it
# After the time since boot has jumped back, a restart is suspected for this long. A restart is
# detected within half this time.
UNDECIDED_US = 2_000_000
NOT_USED = "the message is ignored"


class VehicleMonitor:
    """The state of a vehicle; ``current`` and ``total`` are from MISSION_CURRENT (or None)."""

    def __init__(
        self, heartbeat_timeout_us: int = 3_000_000, max_speed_m_s: float | None = None
    ) -> None:
        """Create the state; positions that imply a speed above ``max_speed_m_s`` are discarded."""
        self.stack: Stack | None = None
        self.armed = False
        self.custom_mode = 0
        self._restarted = False  # True if the autopilot has restarted since the last ModeChanged
        self.current: int | None = None
        self.total: int | None = None
        self.plan_id: int | None = None  # id of the mission on board; ArduPilot has none
        self.unfit = False  # True if the mission on board is missing or cannot be flown
        self.critical = False  # True if the heartbeat reports a failsafe
        self._heartbeat_timeout_us = heartbeat_timeout_us
        self._received_us: int | None = None
        self._lost = False
        self.position: Position | None = None
        self._telemetry = Telemetry()
        self._reached: int | None = None
        self._clock = BootClock()
        self._reach = Reach(max_speed_m_s)
        # Whether the position estimate has been healthy since the autopilot's start; None before
        # the first report about the estimate.
        self._settled: bool | None = None
        self._estimate_healthy = True  # whether the last report had no problem
        self._alarms: dict[AlarmKind, int] = {}  # active alarms with their end times
        self._backward_jump_us = 0  # 0 if the time since boot did not jump back
        self.undecided_until_us = 0  # a restart is suspected until this time
        self.used = True  # whether the last message was used, at least partly

    @property
    def hidden_items(self) -> int:
        """The number of transmitted items that are not the user's (1 on ArduPilot: home)."""
        return 1 if self.stack is not None and self.stack.item_0_is_home else 0

    @property
    def in_mission(self) -> bool:
        """Whether the vehicle is flying its mission."""
        flies = self.stack is not None and self.custom_mode == self.stack.mission_mode
        return self.armed and flies

    def next_timer(self) -> int | None:
        """Return the time at which the link counts as lost if no HEARTBEAT arrives."""
        if self._received_us is None or self._lost:
            return None
        return self._received_us + self._heartbeat_timeout_us

    def handle_timer(self, now_us: int) -> list[ClientEvent]:
        """Report a lost link."""
        due_us = self.next_timer()
        if due_us is None or self._received_us is None or now_us < due_us:
            return []
        self._lost = True
        return [LinkLost(now_us, now_us - self._received_us)]

    def keep_alive(self, now_us: int) -> None:
        """Record a HEARTBEAT that is otherwise ignored: it also arrived over another link."""
        if self._received_us is not None and not self._lost:
            self._received_us = now_us

    def alarm_timer(self) -> int | None:
        """Return the time of the next ``end_alarms`` call."""
        return min(self._alarms.values()) if self._alarms else None

    def end_alarms(self, now_us: int) -> list[ClientEvent]:
        """End each alarm ``ALARM_ENDS_US`` after the last message that caused it."""
        if not self._alarms:
            return []
        ended = [kind for kind, ends_us in self._alarms.items() if now_us >= ends_us]
        for kind in ended:
            del self._alarms[kind]
        return [AlarmEnded(now_us, kind) for kind in ended]

    def receive(self, message: Message, now_us: int) -> list[ClientEvent]:
        """Process a message from this vehicle's autopilot; set ``used`` and return events."""
        fault = out_of_bounds(message)
        self.used = fault is None
        if fault is not None:
            return self._alarm("value", f"{fault}; {NOT_USED}", now_us)
        events: list[ClientEvent] = []
        boot_us = boot_time_us(message)
        if boot_us is not None:
            ahead_us = self._clock.ahead_us(boot_us, now_us)
            verdict = self._clock.judge(boot_us, now_us)
            events += self._time_judged(verdict, ahead_us, now_us)
            self.used = verdict not in ("ahead", "back")
            if not self.used:
                return events
        for event in self._telemetry.events(message, now_us):
            if isinstance(event, Position):
                events += self._position(event)
                continue
            if isinstance(event, EstimatorStatus):
                self._estimate_healthy = event.healthy
                self._settled = event.healthy or bool(self._settled)
            events.append(event)
        return [*events, *self._state(message, now_us)]

    def _time_judged(self, verdict: TimeVerdict, ahead_us: int, now_us: int) -> list[ClientEvent]:
        if verdict == "back":  # a restart, unless later messages continue from the old time
            self._backward_jump_us = ahead_us
            self.undecided_until_us = now_us + UNDECIDED_US
            return []
        self.undecided_until_us = 0
        if verdict == "kept":
            ahead_us, self._backward_jump_us = self._backward_jump_us, 0
            if not ahead_us:
                return []
        self._backward_jump_us = 0
        jump = f"{'ahead' if ahead_us > 0 else 'back'} by {abs(ahead_us) / 1e6:.0f} s"
        if verdict in ("kept", "ahead"):
            words = f"its time since boot jumped {jump}; {NOT_USED}"
            return self._alarm("clock", words, now_us)
        self._telemetry.reset()
        self._reach.forget_times()
        if verdict == "rebooted":
            self.current = self._reached = None
            self._restarted = True
            self._settled = None if self._estimate_healthy else False
            return [Rebooted(now_us)]
        words = (
            f"its time since boot jumped {jump} and continues from there; the new time is now "
            "accepted"
        )
        return [ClockChanged(now_us), *self._alarm("clock", words, now_us, again=True)]

    def _position(self, position: Position) -> list[ClientEvent]:
        if self._settled is False:  # ArduPlane reports 0 m AMSL until its estimator has an origin
            self._reach.forget_positions()
        beyond_m = self._reach.beyond_m(position)
        verdict = self._reach.judge(position, self._clock.rate)
        if verdict == "beyond":
            self._telemetry.retract("GLOBAL_POSITION_INT")
            words = f"its position jumped by {beyond_m:.0f} m, which is implausible; {NOT_USED}"
            return self._alarm("jump", words, position.at_us)
        self.position = position
        if verdict == "kept":
            return [position]
        words = (
            f"its position jumped by {beyond_m:.0f} m and remains there; the new position is now "
            "accepted"
        )
        return [*self._alarm("jump", words, position.at_us, again=True), position]

    def _alarm(
        self, kind: AlarmKind, words: str, now_us: int, again: bool = False
    ) -> list[ClientEvent]:
        """Return a new alarm; an active alarm is repeated only if ``again`` is set."""
        raised = kind in self._alarms
        self._alarms[kind] = now_us + ALARM_ENDS_US
        return [] if raised and not again else [Implausible(now_us, kind, words)]

    def _state(self, message: Message, now_us: int) -> list[ClientEvent]:
        match message.get_type():
            case "HEARTBEAT":
                return self._heartbeat(message, now_us)
            case "MISSION_CURRENT":
                self.total = message.total
                self.plan_id = getattr(message, "mission_id", 0) or None
                self.unfit = message.mission_state == mavlink.MISSION_STATE_NO_MISSION
                if message.seq != self.current:
                    self.current = message.seq
                    if message.seq < self.hidden_items:  # ArduPilot's home: not yet in the mission
                        return []
                    return [MissionProgress(now_us, message.seq - self.hidden_items)]
            case "MISSION_ITEM_REACHED":
                # ArduPlane reports item 0 (home) when the vehicle reaches its target in GUIDED.
                if message.seq != self._reached and message.seq >= self.hidden_items:
                    self._reached = message.seq
                    return [ItemReached(now_us, message.seq - self.hidden_items)]
            case "STATUSTEXT":
                return [Text(now_us, message.severity, message.text.strip())]  # PX4 appends a tab
            case "EXTENDED_SYS_STATE" if self.stack is not None and message.vtol_state:
                self.stack = as_vtol(self.stack)  # ArduPlane's heartbeat may not report a VTOL
            case _:
                pass
        return []

    def _heartbeat(self, message: Message, now_us: int) -> list[ClientEvent]:
        stack = stack_of(message.autopilot, message.type)
        same = self.stack is None or (stack is not None and stack.same_vehicle(self.stack))
        if stack is None or not same:
            kind = f"autopilot {message.autopilot}, type {message.type}"
            words = f"a HEARTBEAT from another kind of vehicle ({kind}); {NOT_USED}"
            return [] if self.stack is None else self._alarm("value", words, now_us)
        self._received_us = now_us
        events: list[ClientEvent] = []
        if self.stack is None:
            self.stack = stack
            events.append(Connected(now_us, stack))
        if self._lost:
            self._lost = False
            events.append(LinkRestored(now_us))
        self.critical = message.system_status in FAILSAFES
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        changed = (armed, message.custom_mode) != (self.armed, self.custom_mode)
        if changed or self._restarted:  # after a restart the mode is reported again
            self._restarted = False
            self.armed, self.custom_mode = armed, message.custom_mode
            name = self.stack.mode_name(message.custom_mode)
            events.append(ModeChanged(now_us, message.custom_mode, armed, name))
        return [*events, *self._telemetry.if_changed(system_state(message, now_us))]
