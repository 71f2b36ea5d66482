"""Runs the engine, which applies each event, in simulations and in live flight.

A projection is a state that is computed from the events, such as that of the core. The engine
journals each event, applies the event to all projections, journals the resulting commands and
executes the commands. At each position a simulated camera, if there is one, takes an image.

**No event in the journal can make a restart fail.** Operators' requests are rare and may have any
content. The engine first applies each request to a copy of all projections (core, state view,
interlock, missions), as in a restart, and journals the request only if no projection raises an
exception. The copy takes milliseconds, or tens of milliseconds with a formation's maps. The
estimated fire is not copied, because changing a fire takes too long: a request is applied to the
estimate after the journal line is written (in a live run by a thread, ``estimate_worker``). If the
request raises an exception in the estimate, the estimate remains unchanged, both in the run and
after a restart. Vehicle events are too frequent to be tried on a copy. The types of these events
limit their values (``events.py``), and the journal refuses other values. A vehicle event that still
raises an exception is a defect. The engine removes the event from the journal and executes none of
its commands. The run then ends with a one-line error, because the state in memory differs from the
journal. A restart resumes the run.
"""

import copy
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property, partial
from typing import Any

import msgspec

from firemodel.errors import FireModelError
from firemodel.spread.edge import at_edge
from firemodel.spread.fire_scheme import Fire
from mission_service.commands import (
    AnyCommand,
    BroadcastMessage,
    Drop,
    Hold,
    Level,
    OrderByService,
    UploadMission,
)
from mission_service.config.rule_lookup import blamed
from mission_service.config.scenario import Scenario
from mission_service.core.core import Core
from mission_service.errors import NotRecordedError, RefusedEventError, in_words
from mission_service.events import (
    SERVICE,
    Aborted,
    AnyEvent,
    AnyOperatorEvent,
    CommandFinished,
    DropFinished,
    FireReachedEdge,
    FrontsEstimated,
    HostTime,
    LinesSkipped,
    Observed,
    OrderGiven,
    PeerLinkChanged,
    PeerMessage,
    Resumed,
    Telemetry,
    UploadFinished,
    VehicleEvent,
)
from mission_service.fire.best_fire import Folded
from mission_service.fire.observed_window import Window
from mission_service.fire.run_estimate import OBSERVATIONS, OF_FIRE, RunEstimate, UnusedReportError
from mission_service.fire.sensors import sensors_of
from mission_service.fire.simulated_cameras import SimulatedCameras, fires_of_run
from mission_service.guidance.registry import lock_of
from mission_service.journal.guarded_journal import GuardedJournal
from mission_service.journal.journal_file import Journal, command_body
from mission_service.journal.snapshot import Known, copied
from mission_service.missions.recognition import MissionsHeld
from mission_service.peer_messages import AnyMessage
from mission_service.runtime.alarms.unrecorded_events import UnrecordedEvents
from mission_service.runtime.gateway import Gateway
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView
from mission_service.sensors.sensor_files import SensorFiles
from mission_service.surveillance.aircraft_reports import AircraftReports

NO_BURN = "the scenario has no burn"
HOST_TIME_EVERY_US = 1_000_000
ESTIMATE_CHECK_EVERY_US = 60_000_000
SHOW_SENSORS_EVERY_US = 5_000_000
# The fields of a snapshot; the scenario determines the other fields.
SNAPSHOT_FIELDS = (
    "core",
    "cameras",
    "estimate",
    "state_view",
    "_missions",
    "_undelivered",
    "_interlock",
    "_acknowledged",
    "_sensor_files",
)
# A request is first applied to a copy of the fields ``TRIED``.
NOT_TRIED = ("cameras", "estimate", "_sensor_files")
TRIED = tuple(name for name in SNAPSHOT_FIELDS if name not in NOT_TRIED)

Progress = Callable[[StateView, Fire], None]


def unshown(state_view: StateView, fire: Fire) -> None:
    """Show no progress."""


def no_broadcast(message: AnyMessage) -> None:
    """Discard a message, in a run without other processes."""


class Engine:
    """The engine, which connects the core, the journal, the fire and the vehicles' gateways."""

    def __init__(
        self,
        scenario: Scenario,
        core: Core,
        cameras: SimulatedCameras | None,
        estimate: RunEstimate,
        journal: Journal,
        state_view: StateView,
        gateways: dict[str, Gateway],
        broadcast: Callable[[AnyMessage], None] = no_broadcast,
    ) -> None:
        """Connect the parts; ``broadcast`` sends messages to other processes.

        ``cameras`` is None without a simulated fire.
        """
        self._scenario = scenario
        self.core = core
        self.cameras = cameras
        self.sensors = sensors_of(scenario, estimate.landscape)
        self._sensor_files = SensorFiles()
        self.estimate = estimate
        self.aircraft = AircraftReports(scenario.surveillance)
        self.state_view = state_view
        self.recording = GuardedJournal(journal)
        self._missions = MissionsHeld()
        # Corrected windows that a vehicle's planner has not received yet, oldest first.
        self._undelivered: dict[str, tuple[Window, ...]] = {}
        self._estimate_due_us = 0  # mission time of the next check of the estimate
        self._down_since_us = 0  # mission time of the last event that was journalled
        self._skipped: LinesSkipped | None = None  # not journalled yet
        self._host_time_due_us = self._sensors_due_us = -(2**63)
        self._gateways = gateways
        self._broadcast = broadcast
        self._acknowledged: dict[tuple[str, str], int] = {}
        self._unrecorded = UnrecordedEvents()
        # Events that result from commands, to be handled after these commands.
        self._held_back: deque[DropFinished | UploadFinished | OrderGiven] = deque()
        self._interlock = lock_of(scenario, estimate.landscape)
        self.defect: RefusedEventError | None = None  # set when memory and journal differ

    @property
    def statistics(self) -> RunStatistics:
        """The statistics of the run, such as tracks and decision counts."""
        return self.state_view.statistics

    @cached_property
    def shared_references(self) -> Known:
        """The objects that the state and its copies share."""
        return Known(self._scenario, self.estimate.landscape)

    def handle_events(self, events: Iterable[VehicleEvent], now_us: int) -> None:
        """Handle the events of a gateway; ``now_us`` is the time on the link's clock."""
        self.clock_read(now_us)
        for event in events:
            if not isinstance(event, Telemetry):
                if not self._handle(event, now_us) and self.recording.trouble:
                    self._unrecorded.show(event, self.state_view)
            # Check the position before an image is taken there.
            elif (body := self._unrecorded.line_of(event, self.state_view)) is not None:
                for seen in self._seen_at(event):
                    self._handle(seen, now_us)
                if self._written(event, body):
                    self._process(event, now_us)
                else:
                    self.state_view.show_unrecorded(event)
                self.take_reports(event.at_us, now_us)
        self.check_estimate(now_us)

    def take_reports(self, at_us: int, now_us: int) -> None:
        """Handle new aircraft and sensor reports at the given mission time.

        Refused sensor reports are announced.
        """
        if self.recording.trouble:
            return
        if self.aircraft.section is not None:
            for name, gateway in self._gateways.items():
                self.aircraft.take_seen(name, gateway.aircraft, at_us)
            for reported in self.aircraft.events_due(self.state_view.telemetry, at_us):
                self._handle(reported, now_us)
        for report in self.sensors.reports(at_us):
            try:
                self.submit(report, now_us)
            except (FireModelError, NotRecordedError, RefusedEventError) as error:
                text = f"sensor {report.by}: {report.source} is not used: {error}"
                self.announce("service", text)

    def check_estimate(self, now_us: int) -> None:
        """Once a minute, check for corrections removed by images and for fire at the edge.

        Planners receive the windows around removed corrections. ``FireReachedEdge`` is journalled
        once, when the estimated fire has reached the edge of the landscape.
        """
        self._show_sensors(now_us)
        at_us = self.statistics.at_us
        if at_us < self._estimate_due_us or self.recording.trouble:
            return
        if self.estimate.in_background and self.estimate.is_behind:  # never in a replay
            return
        self._estimate_due_us = at_us + ESTIMATE_CHECK_EVERY_US
        self.estimate.advance(at_us)
        self._show_estimate_alarms()
        if windows := self.estimate.contradicted():
            for window in windows:
                self._queue(window)
            self._deliver(at_us, now_us)
        found = None if self.state_view.reached_edge else at_edge(self.estimate.fire)
        if found is not None:
            arrived_us = round(found.at_s * 1e6)
            place = (found.lat_deg, found.lon_deg)
            self._handle(FireReachedEdge(at_us, SERVICE, "", arrived_us, *place), now_us)

    def _show_sensors(self, now_us: int) -> None:
        """Show sensor problems every few seconds, even in a run without telemetry."""
        if now_us >= self._sensors_due_us:
            self._sensors_due_us = now_us + SHOW_SENSORS_EVERY_US
            self.state_view.show_sensors(self.sensors.problems(), self.sensors.failed)

    def _show_estimate_alarms(self) -> None:
        """Show an alarm for each source that contradicts others, and for a defective report."""
        texts = self.estimate.agreement.contradictions()
        self.state_view.show_alarms("observer", texts, "severe")
        defects = {"defect": self.estimate.defect} if self.estimate.defect else {}
        self.state_view.show_alarms("estimate", defects, "severe")

    def _seen_at(self, fix: Telemetry) -> Iterator[Observed | FrontsEstimated]:
        """Yield new observations from sensors, then from a camera, then the estimated fronts.

        Without a simulated fire, planners receive the part of the estimate that a camera would
        show. As in a replay, this part is computed after the sensors' observations are processed.
        """
        for seen in self.sensors.observe(fix):
            yield self._with_trust(seen)
        image = self.estimate.view(fix) if self.cameras is None else self.cameras.observe(fix)
        if image is not None:
            yield self._with_trust(image)
        fronts = self.estimate.fronts(fix)
        if fronts is not None:
            yield fronts

    def _with_trust(self, image: Observed) -> Observed:
        """Mark an image as distrusted if its source contradicts the other sources."""
        if (image.source or image.vehicle) not in self.estimate.agreement.distrusted:
            return image
        return msgspec.structs.replace(image, distrusted=True)

    def advance_fire(self, at_us: int) -> None:
        """Advance the simulated fire, if there is one, and the estimate to a given mission time."""
        for fire in fires_of_run(self.cameras, self.estimate):
            fire.advance(at_us)

    def clock_read(self, now_us: int) -> None:
        """In a burn, handle a ``HostTime`` event for each vehicle about once a second."""
        if self._interlock is None or now_us < self._host_time_due_us:
            return
        self._host_time_due_us = now_us + HOST_TIME_EVERY_US
        for name in self._gateways:
            self._handle(HostTime(self.statistics.at_us, name, now_us), now_us)

    def on_peer_message(self, message: AnyMessage, at_us: int, now_us: int) -> None:
        """Handle a message from another process's vehicle, for each vehicle of this process."""
        for name in self._gateways:
            self._handle(PeerMessage(at_us, name, message), now_us)

    def submit(self, event: AnyOperatorEvent, now_us: int) -> None:
        """Handle an operator's event, and flush it to the disk before returning.

        In a live run a report about the fire is only journalled; a thread applies the report later.

        Raises NotRecordedError if the journal cannot be written, FireModelError for an impossible
        fire correction, and RefusedEventError for an event that a projection cannot handle. After
        such an error the state is unchanged. An abort is always executed.
        """
        self.clock_read(now_us)
        self._try(event, now_us)
        self.estimate.check(event)
        if not self._written(event):
            reason = self.recording.trouble
            raise NotRecordedError(f"not recorded: {reason}; the request was not executed")
        try:
            window = self.estimate.apply_report(event)
        except UnusedReportError as error:  # the line stays: later lines may depend on its time
            self._process(event, now_us)
            self._show_estimate_alarms()
            raise self.unused(event, error.reason) from error
        except Exception as error:
            self.recording.remove_last()
            raise _defect(event, error, self._scenario.planner.rule) from error
        self._process(event, now_us)
        if isinstance(event, OBSERVATIONS):
            self._show_estimate_alarms()
        self._queue(window)
        self._deliver(event.at_us, now_us)

    def adopt(self, found: Folded) -> AnyOperatorEvent | None:
        """Adopt the result of a thread that applied an input; return the input if it is a report.

        ``deliver_next`` then delivers the change to the vehicles' planners.
        """
        report = self.estimate.adopt(found)
        if report is not None:
            self.state_view.fire_changed()
            self._show_estimate_alarms()
        self._queue(found.change.window)
        return report

    def unused(self, event: AnyOperatorEvent, error: Exception) -> Exception:
        """Return the error for the sender of a report that the estimate cannot use."""
        if isinstance(error, FireModelError):
            return error
        return _defect(event, error, self._scenario.planner.rule)

    def _try(self, event: AnyOperatorEvent, now_us: int) -> None:
        """Apply a request to a copy of the state. Raises RefusedEventError on any exception."""
        trial = copy.copy(self)
        try:
            fields = {name: getattr(self, name) for name in TRIED}
            trial.restore(copied(fields, self.shared_references))
            for command in trial._apply(event):
                command_body(command)
                trial._refused(command)
                if trial._interlock is not None:
                    trial._interlock.on_commands([command])
        except Exception as error:
            if isinstance(event, Aborted):  # an abort that the core cannot handle
                for name, gateway in self._gateways.items():
                    gateway.execute(Hold(name), now_us)
            raise _defect(event, error, self._scenario.planner.rule) from error

    def on_peer_link(self, connected: bool, at_us: int, now_us: int) -> None:
        """Handle a lost or restored link to other processes, for each vehicle of this process."""
        for name in self._gateways:
            self._handle(PeerLinkChanged(at_us, name, connected), now_us)

    def apply_history(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        """Apply an event of the journal with its commands, without executing the commands."""
        if self.cameras is not None:
            self.cameras.apply_history(event)
        window = self.estimate.apply_history(event)
        self._sensor_files.on_event(event)
        for command in commands:
            self._apply_command_to_fire(command)
        self._show(event, commands)
        self._queue(window)
        if isinstance(event, Observed) and event.corrects:
            self._received(event.vehicle)
        if self._interlock is not None:
            self._interlock.apply(event)
            self._interlock.on_commands(commands)

    def resume(
        self,
        missing: Iterable[AnyCommand],
        event: Resumed,
        now_us: int,
        skipped: LinesSkipped | None = None,
    ) -> None:
        """Continue a run after its journal's events were applied, and handle ``event``.

        ``missing`` contains the last commands, which the journal lacks and which are now written.
        ``skipped`` records the lines of the journal that were not applied. If the journal cannot be
        written, ``retry`` writes ``skipped``, and a ``Resumed`` with the whole interruption.
        """
        self.sensors.skip(self._sensor_files.names())
        self.sensors.restore_burned(self.estimate.agreement.burned_since_s(), event.at_us)
        self._skipped = skipped
        self._down_since_us = event.at_us - round(event.down_s * 1e6)
        self.recording.write_commands(list(missing))
        self._restart(event, now_us)

    def _restart(self, event: Resumed, now_us: int) -> None:
        """Handle the end of an interruption, and read back the missions of connected vehicles.

        The interruption is a restart, or a time in which the journal could not be written. No reply
        to a drop that was ordered before it is in the journal, so the outcome is unknown.
        """
        if self._skipped is not None and self._handle(self._skipped, now_us):
            self._skipped = None
        self._handle(event, now_us)
        self._deliver(event.at_us, now_us)
        for name, gateway in self._gateways.items():
            gateway.read_back(partial(self._missions.recognised, name), now_us)
        for drop in () if self._interlock is None else self._interlock.unfinished_drops():
            named = (drop.vehicle, drop.plan_hash, drop.number)
            why = "no reply was recorded (restart of the service, or full disk)"
            self._handle(DropFinished(event.at_us, *named, False, False, why), now_us)

    def retry(self, at_us: int, now_us: int) -> bool:
        """Try to write the journal again, and return whether it can be written."""
        if not self.recording.retry():
            return False
        self._unrecorded.forget_modes(self.state_view)
        down_us = max(at_us - self._down_since_us, 0)
        self._restart(Resumed(at_us, "service", "", down_us / 1e6), now_us)
        return not self.recording.trouble

    def snapshot_fields(self) -> dict[str, Any]:
        """Return the fields of a snapshot; together with the scenario, they are the whole state."""
        return {name: getattr(self, name) for name in SNAPSHOT_FIELDS}

    def restore(self, fields: dict[str, Any]) -> None:
        """Restore the fields of a snapshot."""
        for name, value in fields.items():
            setattr(self, name, value)

    def announce(self, about: str, text: str, level: Level = "warning") -> None:
        """Show the operators an announcement that is not journalled."""
        self.state_view.announce(about, text, level)

    def _queue(self, window: Window | None) -> None:
        if window is not None:
            waiting = self._undelivered
            self._undelivered = {name: (*waiting.get(name, ()), window) for name in self._gateways}

    def _received(self, vehicle: str) -> None:
        later = self._undelivered.pop(vehicle, ())[1:]
        if later:
            self._undelivered[vehicle] = later

    def _deliver(self, at_us: int, now_us: int) -> None:
        """Deliver operators' corrections of the fire to each vehicle's planner."""
        for name, windows in list(self._undelivered.items()):
            for _ in windows:
                self._deliver_to(name, at_us, now_us)

    def deliver_next(self, now_us: int) -> bool:
        """Deliver one change to one vehicle's planner; return False if no change was pending.

        More than one change per call could block the event loop for too long, because a planner may
        take a third of the permitted time.
        """
        name = next(iter(self._undelivered), None)
        return name is not None and self._deliver_to(name, self.statistics.at_us, now_us)

    def _deliver_to(self, vehicle: str, at_us: int, now_us: int) -> bool:
        window = self._undelivered[vehicle][0]
        delivered = self._handle(Observed(at_us, vehicle, *window, corrects=True), now_us)
        if delivered:
            self._received(vehicle)
        return delivered

    def acknowledged_by(self, command: str, since_us: int) -> set[str]:
        """Return the vehicles that have acknowledged a command since the given mission time."""
        found = self._acknowledged.items()
        return {name for (name, word), at_us in found if word == command and at_us >= since_us}

    def status(self) -> dict[str, Any]:
        """Return the interlock's state of plans, vehicles and crew, or {} without an interlock."""
        return {} if self._interlock is None else self._interlock.status()

    def _handle(self, event: AnyEvent, now_us: int) -> bool:
        """Journal and apply an event; return False if the event cannot be journalled."""
        body = self._unrecorded.line_of(event, self.state_view)
        if body is None or not self._written(event, body):
            return False
        self._process(event, now_us)
        return True

    def _written(self, event: AnyEvent, body: bytes | None = None) -> bool:
        if self.defect is not None:
            raise self.defect
        may_handle = self.recording.write_event(event, body)
        if not self.recording.trouble:
            self._down_since_us = event.at_us
        return may_handle

    def _process(self, event: AnyEvent, now_us: int) -> None:
        """Apply a journalled event, then journal and execute the commands."""
        try:
            commands = self._apply(event)
            self._apply_event_to_fire(event)
            may_act = self.recording.write_commands(commands)
        except OSError:  # the journal of a simulation cannot be written
            raise
        except Exception as error:
            self.recording.remove_last()
            self.defect = _defect(event, error, self._scenario.planner.rule)
            raise self.defect from error
        for command in commands:
            if may_act:
                self._carry_out(command, event.at_us, now_us)
            else:  # ``retry`` journals the command
                self._apply_command_to_fire(command)
            if self._interlock is not None:
                self._interlock.on_commands([command])
        while self._held_back:
            self._handle(self._held_back.popleft(), now_us)

    def _carry_out(self, command: AnyCommand, at_us: int, now_us: int) -> None:
        """Execute a journalled command, or hold back the event that follows from it."""
        if isinstance(command, BroadcastMessage):
            self._broadcast(command.message)
        elif isinstance(command, OrderByService):
            named = (command.vehicle, command.order)
            order = OrderGiven(at_us, command.by, "", *named, hold_at=command.hold_at)
            self._held_back.append(order)
        elif self._unrecorded.keeps_mode(command, self.state_view):
            pass
        elif (refused := self._refused(command)) is not None:
            self._held_back.append(refused)
        else:
            self._apply_command_to_fire(command)
            self._gateways[command.vehicle].execute(command, now_us)

    def _apply_event_to_fire(self, event: AnyEvent) -> None:
        self.sensors.on_event(event)
        self._sensor_files.on_event(event)
        for fire in fires_of_run(self.cameras, self.estimate):
            fire.on_event(event)

    def _apply_command_to_fire(self, command: AnyCommand) -> None:
        for fire in fires_of_run(self.cameras, self.estimate):
            fire.on_command(command)

    def _apply(self, event: AnyEvent) -> list[AnyCommand]:
        """Apply an event to all projections except the fire; return the core's commands."""
        commands = self.core.handle(event)
        self._show(event, commands)
        if self._interlock is not None:
            self._interlock.apply(event)
        return commands

    def _show(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        if isinstance(event, OF_FIRE):
            self.state_view.fire_changed()
        if isinstance(event, CommandFinished) and event.accepted:
            self._acknowledged[event.vehicle, event.command] = event.at_us
        self._missions.apply(event, commands)
        self.state_view.apply(event, commands)

    def _refused(self, command: AnyCommand) -> DropFinished | UploadFinished | None:
        """Return the event that refuses a command; None for a command that may be executed.

        The interlock refuses drops that are not permitted, and all missions that may drop.
        """
        at_us, lock = self.statistics.at_us, self._interlock
        if isinstance(command, Drop):
            why = NO_BURN if lock is None else lock.refuses(command, at_us)
            if why is None:
                return None
            named = (command.plan_hash, command.number)
            return DropFinished(at_us, command.vehicle, *named, False, True, f"interlock: {why}")
        if isinstance(command, UploadMission) and lock is not None and lock.may_drop(command.items):
            why = "interlock: the mission contains an item that may drop"
            return UploadFinished(at_us, command.vehicle, command.mission_id, "refused", why)
        return None


def _defect(event: AnyEvent, error: Exception, rule: str) -> RefusedEventError:
    blame = blamed(rule)
    if isinstance(error, RefusedEventError):
        return error if blame is None else RefusedEventError(f"{error}; {blame}")
    return RefusedEventError(
        f"{type(event).__name__} at {event.at_us / 1e6:.3f} s cannot be handled and had no effect: "
        f"{in_words(error)}; {blame or 'this is a defect, please report it'}"
    )
