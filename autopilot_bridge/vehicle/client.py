"""The ground-station side of one vehicle on one link, sans-IO.

Bytes in (``receive_data``), datagrams out (``data_to_send``), one timer (``next_timer``,
``handle_timer``), events (``next_event``). Time is an argument, in microseconds of any clock.
Where vehicles share a link, ``fleet.py`` decodes for all (``receive_message``).
"""

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.missions.transfer import Kind, TransferResult, TransferTiming
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle import orders
from autopilot_bridge.vehicle.asked_modes import AskedModes
from autopilot_bridge.vehicle.client_events import (
    ClientEvent,
    Connected,
    LinkRestored,
    ModeChanged,
    Position,
    Rebooted,
    TransferFinished,
)
from autopilot_bridge.vehicle.drops import Drops
from autopilot_bridge.vehicle.jobs import Begin, Job, Jobs, Seen
from autopilot_bridge.vehicle.mode import changed_meanwhile
from autopilot_bridge.vehicle.queues import Commands, ParameterRequests
from autopilot_bridge.vehicle.rates import RATES_HZ, Rates, RatesHz
from autopilot_bridge.vehicle.texts import Texts
from autopilot_bridge.vehicle.watch import AUTOPILOT, Watch

HEARTBEAT_EVERY_US = 1_000_000
NEVER_US = 1 << 62
AT_ONCE = TransferTiming(timeout_us=400_000, retries=40)  # what must not wait for a slow retry


class VehicleClient:
    """One vehicle. ``target_system`` None takes the first autopilot heard."""

    def __init__(
        self,
        system_id: int = 255,
        component_id: int = 190,
        target_system: int | None = 1,
        heartbeat_timeout_us: int = 3_000_000,
        timing: TransferTiming | None = None,
        rates_hz: RatesHz = RATES_HZ,
        shared: list[Message] | None = None,
        most_speed_m_s: float | None = None,
    ) -> None:
        """``rates_hz`` (by message id) is asked for when the vehicle is heard, and heard again.

        Positions that it cannot reach at ``most_speed_m_s`` are not used; None: all are.

        ``shared`` is for clients on one link: its owner sends what is put there, and heartbeats.
        """
        self._own = (system_id, component_id)
        self._target_system = target_system
        self._watch = Watch(heartbeat_timeout_us, most_speed_m_s)
        self._texts = Texts()
        self._timing = timing or TransferTiming()
        self._codec = Codec(system_id, component_id)
        self._outgoing: list[Message] = [] if shared is None else shared
        self._events: deque[ClientEvent] = deque()
        self._heartbeats = shared is None
        self._heartbeat_due_us = 0
        self._rates = Rates(self._own, rates_hz)
        self._asked_modes = AskedModes()
        self._jobs = Jobs(self._own, self._timing, self._report, self._asked_modes)
        self._commands = Commands(self._own, self._timing, self._events.append, self._asked_modes)
        self._drops = Drops(system_id, self._timing, self._events.append)
        self._parameters = ParameterRequests(self._timing, self._events.append)

    @property
    def stack(self) -> Stack | None:
        """The autopilot, once it was heard."""
        return self._watch.stack

    @property
    def target_system(self) -> int | None:
        """The vehicle's system id, once it is known."""
        return self._target_system

    @property
    def armed(self) -> bool:
        """By its last HEARTBEAT."""
        return self._watch.armed

    @property
    def custom_mode(self) -> int:
        """By its last HEARTBEAT."""
        return self._watch.custom_mode

    @property
    def position(self) -> Position | None:
        """The last one told."""
        return self._watch.position

    # What the user asks for -------------------------------------------------------------------

    def upload(
        self,
        items: tuple[MissionItem, ...],
        now_us: int,
        kind: Kind = "mission",
        begin: Begin = "restart",
        check: bool = False,
        holds_first: bool = False,
        by_file: bool = True,
    ) -> int:
        """Replace the mission, fence or rally points; TransferFinished with the id tells how.

        ``begin`` is the item of a new mission to fly next: its first, the one of the same number
        as now, or a number from 0. ``check`` reads back what was accepted. With ``holds_first`` a
        vehicle that flies its mission holds meanwhile if its autopilot would fly a list that is
        half overwritten; if the upload breaks off it stays there. ``by_file`` is for autopilots
        that take whole missions by MAVFTP. A later upload takes the place of one of its kind that
        has not begun yet.
        """
        job = Job(0, "upload", kind, tuple(items), begin, check, holds_first, by_file)
        return self._add(job, now_us)

    def download(self, now_us: int, kind: Kind = "mission", by_file: bool = True) -> int:
        """Read the mission, fence or rally points; the result carries the items."""
        return self._add(Job(0, "download", kind, by_file=by_file), now_us)

    def clear(self, now_us: int, kind: Kind = "mission") -> int:
        """Remove the mission, fence or rally points."""
        return self._add(Job(0, "clear", kind), now_us)

    def cancel(self, transfer_id: int, now_us: int) -> None:
        """End a transfer; it is reported as cancelled when the autopilot has ended it too."""
        self._send(*self._jobs.cancel(transfer_id, self._known_stack(), now_us))
        self._go_on(now_us)

    # Orders; outcome as CommandFinished with the id. They are carried out one after another, but
    # hold, climb and hold, return, land and disarm take the place of all that is not ended.

    def arm(self, now_us: int) -> int:
        """Arm, with the autopilot's checks."""
        return self._order("arm", orders.arm(self._known_stack()), now_us)

    def disarm(self, now_us: int) -> int:
        """Disarm; refused in the air."""
        return self._order("disarm", orders.disarm(self._known_stack()), now_us, urgent=True)

    def takeoff(self, height_m: float, now_us: int) -> int:
        """Arm, take off and hold so high above the ground; sets ArduPlane's TKOFF_ALT."""
        stack, here = self._known_stack(), self.position
        if here is None:
            raise BridgeError("the vehicle has told no position yet; wait for Position")
        return self._order("takeoff", orders.takeoff(stack, height_m, here.altitude_amsl_m), now_us)

    def start_mission(self, now_us: int) -> int:
        """Fly the mission: arm and change mode where needed."""
        steps = orders.start_mission(self._known_stack(), self.armed)
        return self._order("start mission", steps, now_us)

    def hold(self, now_us: int) -> int:
        """Pause: loiter here."""
        return self._order("hold", orders.pause(self._known_stack()), now_us, urgent=True)

    def resume(self, now_us: int) -> int:
        """Go on with the mission where it was left."""
        return self._order("resume", orders.resume(self._known_stack()), now_us)

    def return_home(self, now_us: int) -> int:
        """Return to the launch place."""
        return self._order("return", orders.return_home(self._known_stack()), now_us, urgent=True)

    def set_return_height(self, height_m: float, now_us: int) -> int:
        """How high above home returns of a multirotor lead at least; sets its parameters."""
        steps = orders.return_height(self._known_stack(), height_m)
        return self._order("return height", steps, now_us)

    def land(self, now_us: int) -> int:
        """Land here; ArduPlane by the landing of its mission."""
        return self._order("land", orders.land(self._known_stack()), now_us, urgent=True)

    def reposition(
        self, lat_deg: float, lon_deg: float, altitude_amsl_m: float, now_us: int
    ) -> int:
        """Fly to a place and hold there."""
        steps = orders.reposition(self._known_stack(), lat_deg, lon_deg, altitude_amsl_m)
        return self._order("reposition", steps, now_us)

    def climb_and_hold(
        self, lat_deg: float, lon_deg: float, altitude_amsl_m: float, now_us: int
    ) -> int:
        """Leave what is flown, climb at a place and hold there; repeated often until answered."""
        steps = orders.climb_and_hold(self._known_stack(), lat_deg, lon_deg, altitude_amsl_m)
        return self._order("climb and hold", steps, now_us, urgent=True, timing=AT_ONCE)

    def drop(self, dropper: orders.Dropper, now_us: int) -> int:
        """Let go of one thing now; DropFinished with the id tells how it went.

        Sent once, past all orders that wait; never repeated. Where it cannot be sent at once it is
        refused. Raises BridgeError if the stack has no such dropper.
        """
        lost = self._watch.next_timer() is None
        drop_id, messages = self._drops.drop(
            self._known_stack(), dropper, self._target(), lost, now_us
        )
        self._send(*messages)
        return drop_id

    def orbit(
        self,
        lat_deg: float,
        lon_deg: float,
        altitude_amsl_m: float,
        radius_m: float,
        now_us: int,
        speed_m_s: float | None = None,
    ) -> int:
        """Circle a place, clockwise with a positive radius."""
        place = (lat_deg, lon_deg, altitude_amsl_m)
        steps = orders.orbit(self._known_stack(), *place, radius_m, speed_m_s)
        return self._order("orbit", steps, now_us)

    def change_speed(self, speed_m_s: float, now_us: int) -> int:
        """Airspeed of planes, ground speed of multirotors."""
        stack = self._known_stack()
        orbiting = stack.mode_name(self.custom_mode) == "orbit"
        steps = orders.change_speed(stack, speed_m_s, orbiting)
        return self._order("change speed", steps, now_us)

    def set_mode(self, name: str, now_us: int) -> int:
        """Change to a mode of ``Stack.modes``."""
        return self._order(f"mode {name}", orders.set_mode(self._known_stack(), name), now_us)

    def _order(
        self,
        name: str,
        steps: orders.Steps,
        now_us: int,
        urgent: bool = False,
        timing: TransferTiming | None = None,
    ) -> int:
        if urgent:
            self._drops.withdraw(self._outgoing, f"{name} took its place", now_us)
            self._jobs.leave_mode()
        command_id = self._commands.add(
            name, steps, self._target(), self._known_stack(), urgent, now_us, timing
        )
        self._send(*self._commands.begin_next(now_us))
        return command_id

    # Parameters; outcome as ParametersFinished with the id.

    def read_parameter(self, name: str, now_us: int) -> int:
        """Read one parameter."""
        return self._ask(self._parameters.read(name, self._target(), self._known_stack()), now_us)

    def read_parameters(self, now_us: int) -> int:
        """Read all parameters (ArduPilot has over a thousand)."""
        return self._ask(self._parameters.read_all(self._target(), self._known_stack()), now_us)

    def set_parameter(self, name: str, value: float, now_us: int) -> int:
        """Set a parameter; accepted when the autopilot tells the new value."""
        stack = self._known_stack()
        return self._ask(self._parameters.set(name, value, self._target(), stack), now_us)

    def _ask(self, request_id: int, now_us: int) -> int:
        self._send(*self._parameters.begin_next(now_us))
        return request_id

    def _known_stack(self) -> Stack:
        if self.stack is None:
            raise BridgeError("no autopilot was heard yet; wait for Connected")
        return self.stack

    # Bytes and time -----------------------------------------------------------------------------

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in a datagram."""
        for message in self._codec.decode(data):
            self.receive_message(message, now_us)

    def receive_message(self, message: Message, now_us: int) -> None:
        """Take in a message from anybody on the link."""
        if self._from_vehicle(message):
            for whole in self._texts.receive(message):
                self._receive(whole, now_us)

    def data_to_send(self) -> list[bytes]:
        """Datagrams to send, in order; each is handed out once."""
        outgoing, self._outgoing = self._outgoing, []
        return [self._codec.encode(message) for message in outgoing]

    def next_event(self) -> ClientEvent | None:
        """The oldest event not handed out yet."""
        return self._events.popleft() if self._events else None

    def report(self, event: ClientEvent) -> None:
        """Add an event about this vehicle that the link's owner detected."""
        self._events.append(event)

    def next_timer(self) -> int:
        """When to call ``handle_timer`` next."""
        due_us = self._heartbeat_due_us if self._heartbeats else NEVER_US
        silent_us = self._watch.next_timer()
        for timer_us in (
            self._jobs.next_timer(),
            self._commands_timer(),
            self._drops.next_timer(),
            self._parameters.next_timer(),
            self._watch.alarm_timer(),
            silent_us,
            None if silent_us is None else self._rates.next_timer(),  # not on a lost link
        ):
            if timer_us is not None and timer_us < due_us:
                due_us = timer_us
        return due_us

    def handle_timer(self, now_us: int) -> None:
        """Do what is due."""
        if self._heartbeats and now_us >= self._heartbeat_due_us:
            self._heartbeat_due_us = now_us + HEARTBEAT_EVERY_US
            self._send(gcs_heartbeat())
        self._events.extend(self._watch.handle_timer(now_us))
        self._events.extend(self._watch.end_alarms(now_us))
        if self._watch.next_timer() is not None:
            self._send(*self._rates.handle_timer(now_us))
        self._send(*self._jobs.handle_timer(now_us))
        self._go_on(now_us)
        if now_us >= self._watch.undecided_until_us:
            self._send(*self._commands.handle_timer(now_us))
        self._send(*self._drops.handle_timer(now_us))
        self._send(*self._parameters.handle_timer(now_us))

    def _commands_timer(self) -> int | None:
        """When a command is due to be repeated; not while the autopilot may have restarted."""
        due_us = self._commands.next_timer()
        return None if due_us is None else max(due_us, self._watch.undecided_until_us)

    # Messages -----------------------------------------------------------------------------------

    def _from_vehicle(self, message: Message) -> bool:
        if self._target_system is None and message.get_type() == "HEARTBEAT":
            if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
                return False
            self._target_system = message.get_srcSystem()
        source = (message.get_srcSystem(), message.get_srcComponent())
        return source == (self._target_system, AUTOPILOT)

    def _receive(self, message: Message, now_us: int) -> None:
        watch = self._watch
        mode, armed, critical = watch.custom_mode, watch.armed, watch.critical
        for event in watch.receive(message, now_us):
            self._events.append(event)
            if isinstance(event, Rebooted):
                self._commands.end_all("the autopilot was restarted", now_us)
            if isinstance(event, (Connected, LinkRestored, Rebooted)) and self.stack is not None:
                self._send(*self._rates.begin(self.stack, self._target(), now_us))
            if isinstance(event, ModeChanged):
                self._mode_changed(mode, armed, now_us)
        if watch.critical and not critical:
            self._jobs.taken("its autopilot went into failsafe meanwhile")
        if not watch.used:
            return
        self._drops.receive(message, now_us)
        self._send(*self._rates.receive(message, now_us))
        if now_us >= watch.undecided_until_us:  # else what it acknowledged may be undone
            self._send(*self._commands.receive(message, now_us))
        self._send(*self._parameters.receive(message, now_us))
        if self._jobs.next_timer() is not None:  # a transfer is under way
            self._send(*self._jobs.receive(message, now_us))
            self._go_on(now_us)
        elif message.get_type() == "HEARTBEAT":
            self._go_on(now_us)

    def _mode_changed(self, before: int, was_armed: bool, now_us: int) -> None:
        """Stop transfers and commands if its autopilot, or a pilot by radio, has taken over."""
        mode, stack = self.custom_mode, self._known_stack()
        if mode != before and not self._asked_modes.has(mode, now_us):
            why = changed_meanwhile(stack, mode)
            self._jobs.taken(why)
            self._send(*self._commands.leave_mode(why, now_us))
        elif was_armed and not self.armed:
            self._send(*self._commands.leave_mode("it was disarmed meanwhile", now_us))

    def _target(self) -> tuple[int, int]:
        return self._target_system or 0, AUTOPILOT

    # Transfers ----------------------------------------------------------------------------------

    def _add(self, job: Job, now_us: int) -> int:
        transfer_id = self._jobs.add(job, now_us)
        self._go_on(now_us)
        return transfer_id

    def _go_on(self, now_us: int) -> None:
        """End what has ended, begin what comes after it."""
        if self.stack is None or self._jobs.idle:
            return
        watch = self._watch
        total = None if watch.total is None else watch.total + watch.hidden_items
        seen = Seen(
            *(self.stack, self._target(), watch.current, total, self.armed, self.custom_mode),
            *(watch.plan_id, watch.unfit),
        )
        self._send(*self._jobs.step(seen, now_us))
        self._send(*self._jobs.begin_next(seen, now_us))

    def _report(self, job: Job, result: TransferResult, now_us: int) -> None:
        ended = TransferFinished(now_us, job.transfer_id, job.action, result, job.kind)
        self._events.append(ended)

    def _send(self, *messages: Message) -> None:
        self._outgoing.extend(messages)


def gcs_heartbeat() -> Message:
    """HEARTBEAT of a ground station."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
    )
