"""Translates a client's events for the core, and the core's commands for the client. Sans-IO."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import ClassVar

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.client_protocol import VehicleClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle import client_events as bridge
from autopilot_bridge.vehicle.aircraft_seen import AircraftSeen
from autopilot_bridge.vehicle.camera_telemetry import (
    CameraEvent,
    FieldOfView,
    GimbalAttitude,
    HottestPoint,
    ImageCaptured,
    TrackedPlace,
)
from autopilot_bridge.vehicle.message_rates import (
    AIRCRAFT_RATES_HZ,
    CAMERA_RATES_HZ,
    RATES_HZ,
    RatesHz,
)
from autopilot_bridge.vehicle.orders import Dropper
from mission_service.commands import (
    ORDER_NAMES,
    AnyCommand,
    Drop,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.events import (
    AutopilotText,
    BatteryUpdated,
    CommandFinished,
    DropFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    GpsFixChanged,
    LandedStateChanged,
    LinkLost,
    LinkQuality,
    LinkRestored,
    LinksReported,
    MissionProgress,
    MissionReadBack,
    ModeChanged,
    RemoteIdChanged,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.guidance.registry import way_of
from mission_service.missions.recognition import as_uploaded
from mission_service.runtime.air_data import AirData, MeanAirspeed
from mission_service.runtime.camera_reports import CameraReports
from mission_service.runtime.thrust_loss import ThrustMonitor
from mission_service.vehicles.parameter_reports import ParameterReports

Recognise = Callable[[tuple[MissionItem, ...], Stack], int]

GOOD_FIXES = ("3d", "dgps", "rtk float", "rtk fixed", "static", "ppp")

# Texts of a lower severity, and repetitions of a text within this time, are discarded.
MIN_SEVERITY = mavlink.MAV_SEVERITY_INFO
TEXT_AGAIN_AFTER_US = 10_000_000
MAX_TEXTS_KEPT = 32
BATTERY_EVERY_US = 30_000_000  # between reports of an unchanged charge
MAX_AIRCRAFT_KEPT = 5000  # reports of other aircraft between two engine calls

StatusChanged = (
    GpsFixChanged
    | SystemStateChanged
    | LandedStateChanged
    | FenceStatusChanged
    | EstimatorStatusChanged
    | RemoteIdChanged
)

# If a vehicle's clock lags behind mission time by BEHIND_US for BEHIND_FOR_US, that clock is set to
# mission time.
BEHIND_US = 1_000_000
BEHIND_FOR_US = 5_000_000
# Mission time continues without the autopilots' clocks if none of them has been reported for
# SILENT_US. Its rate is measured over the last RATE_FROM_US / 2 or longer.
SILENT_US, RATE_FROM_US = 10_000_000, 60_000_000
MAX_IMAGE_DELAY_US = 10_000_000  # maximum delay from an image to its report
BETWEEN_POSITIONS_US = 1_000_000  # mission time is the time of the last position


def rates_hz(scenario: Scenario) -> RatesHz:
    """Return the messages requested from a scenario's vehicles, with their rates in Hz."""
    camera_hz = CAMERA_RATES_HZ if scenario.estimate.sensors else {}
    aircraft_hz = {} if scenario.surveillance is None else AIRCRAFT_RATES_HZ
    return {**RATES_HZ, **camera_hz, **aircraft_hz, **way_of(scenario).rates_hz}


def camera_reports_of(scenario: Scenario, vehicle: str) -> CameraReports | None:
    """Return a vehicle's camera reports in a scenario with sensors; otherwise None."""
    if not scenario.estimate.sensors:
        return None
    return CameraReports(vehicle, scenario.estimate.thermal_frames.hot_c)


def dropper_of(scenario: Scenario) -> Dropper | None:
    """Return the dropper of a scenario's burn; None without a burn."""
    return None if scenario.burn is None else Dropper(*scenario.burn.dropper.output)


class MissionClock:
    """Mission time, from the autopilots' clocks or from the wall clock.

    In a simulation that runs faster than real time, the autopilots' clocks synchronise fire and
    flight. The first autopilot begins at ``start_us``. If an autopilot connects later, is restarted
    or has a slower clock, its time is set to the current mission time, because a team ignores a
    vehicle with a time that lags behind. While no autopilot reports its time, for example because
    all of them are switched off between two flights, mission time continues at its last rate. With
    the wall clock, mission time is ``start_us`` plus the time since the service began.
    """

    def __init__(self, start_us: int, wall: bool) -> None:
        self.now_us = start_us
        self.latest_us = start_us  # the latest mission time of all processes
        self.wall = wall
        # In a journal replay, mission time minus the log's time.
        self.ahead_us: int | None = None
        self._start_us = start_us
        self._began_us: int | None = None
        # With the autopilots' clocks: the machine's time and the mission time of the last report,
        # and the recent amounts by which both advanced.
        self._reported_us: tuple[int, int] | None = None
        self._advanced_us = (0, 0)

    def go_on(self, mission_us: int, wall_us: int) -> None:
        """Set the mission time at machine time ``wall_us``; call only before vehicles connect."""
        self.now_us = self.latest_us = self._start_us = mission_us
        self._began_us = wall_us if self.wall else None

    def wall_passed(self, wall_us: int) -> None:
        """Advance to the machine's time.

        If the autopilots' clocks are used, this has an effect only if none of them has reported its
        time for ``SILENT_US``.
        """
        if not self.wall:
            self._continue(wall_us)
            return
        if self._began_us is None:
            self._began_us = wall_us
        self.now_us = max(self.now_us, self._start_us + wall_us - self._began_us)

    def autopilot_passed(self, mission_us: int, wall_us: int) -> None:
        """Advance to the mission time of an autopilot's clock."""
        self.now_us = max(self.now_us, mission_us)
        self.latest_us = max(self.latest_us, mission_us)
        if self._reported_us is not None:
            wall_passed_us, mission_passed_us = self._advanced_us
            passed_us = wall_us - self._reported_us[0]
            if passed_us <= SILENT_US:
                wall_passed_us += passed_us
                mission_passed_us += self.latest_us - self._reported_us[1]
            if wall_passed_us > RATE_FROM_US:
                wall_passed_us, mission_passed_us = wall_passed_us // 2, mission_passed_us // 2
            self._advanced_us = wall_passed_us, mission_passed_us
        self._reported_us = wall_us, self.latest_us

    def _continue(self, wall_us: int) -> None:
        if self._reported_us is None or wall_us - self._reported_us[0] <= SILENT_US:
            return
        wall_passed_us, mission_passed_us = self._advanced_us
        rate = mission_passed_us / wall_passed_us if wall_passed_us > 0 else 1.0
        passed_us = round((wall_us - self._reported_us[0]) * rate)
        self.now_us = max(self.now_us, self._reported_us[1] + passed_us)
        self.latest_us = max(self.latest_us, self.now_us)

    def others_passed(self, mission_us: int, wall_us: int) -> None:
        """Advance to another process's mission time; lagging vehicle clocks are set to that time.

        A small lag remains, because all events of a process share one time.
        """
        self.latest_us = max(self.latest_us, mission_us)
        self.wall_passed(wall_us)
        if self._began_us is not None:
            self._began_us = min(self._began_us, wall_us - (mission_us - self._start_us))


class Gateway:
    """The translator of one client's events, and of the commands to the client's vehicle."""

    def __init__(
        self,
        name: str,
        client: VehicleClient,
        clock: MissionClock,
        dropper: Dropper | None = None,
        return_height_m: float | None = None,
        camera: CameraReports | None = None,
        parameters: ParameterReports | None = None,
    ) -> None:
        """Connect the vehicle and its client; without a ``dropper``, every drop is refused.

        When the vehicle connects, its return height is set to ``return_height_m`` above home.
        Without ``camera``, camera reports are not used. Without ``parameters``, no parameter is
        read.
        """
        self.name = name
        self.client = client
        self._clock = clock
        self._dropper = dropper
        self._return_height_m = return_height_m
        self._camera = camera
        self._parameters = parameters
        self._drops: dict[int, Drop] = {}  # unfinished drops by the number that the client assigned
        self._queued: deque[VehicleEvent] = deque()  # events that the gateway itself creates
        self._batteries: dict[int, bridge.Battery] = {}
        self._battery_reported: BatteryUpdated | None = None
        self._status: dict[type, StatusChanged] = {}  # the newest event of each kind
        self._airspeed, self._thrust = MeanAirspeed(), ThrustMonitor()
        self._air_data = AirData()
        self._texts: dict[str, int] = {}  # time of each text's last report, on the link's clock
        self._offset_us: int | None = None
        self._min_behind_us = 0
        self._watched_from_us = 0
        self._mission_of_transfer: dict[int, int] = {}
        self._recognise: Recognise | None = None
        self._reading: int | None = None  # number of the download, as assigned by the client
        self._mode: tuple[int, bool, str] | None = None
        self._mode_reported = False  # since the start or the last ``read_back``
        # The kind and text of each alarm; an empty text ends the alarm.
        self.link_alarms: deque[tuple[str, str]] = deque()
        # Reports from the vehicle's ADS-B receiver, until the engine removes them.
        self.aircraft: deque[AircraftSeen] = deque(maxlen=MAX_AIRCRAFT_KEPT)
        self._connected = False  # whether the connection was reported
        self._lost = False
        self._status_due = False  # whether to report the states again when connected

    def read_back(self, recognise: Recognise, now_us: int) -> None:
        """Read the mission on board as soon as the vehicle is connected; report all states again.

        ``recognise`` returns the id of the mission read, or 0 if the service did not send it.
        """
        self._recognise = recognise
        self._mode_reported = False
        self._battery_reported = None
        self._airspeed, self._thrust = MeanAirspeed(), ThrustMonitor()
        stack = self.client.stack
        self._status_due = True
        if stack is not None and self._connected and not self._lost:
            at_us = self._clock.now_us
            if self._mode is not None:  # the mode is reported before any command
                self._mode_reported = True
                self._queued.append(ModeChanged(at_us, self.name, *self._mode))
            self._queued.append(_connected(at_us, self.name, stack))
            self._report_status()
            if self._parameters is not None:
                self._parameters.report_again(now_us)
            self._reading = self.client.download(now_us)

    def _report_status(self) -> None:
        """Report the states again that the client reports only on a change."""
        at_us, self._status_due = self._clock.now_us, False
        for status in self._status.values():
            self._queued.append(msgspec.structs.replace(status, at_us=at_us))

    def events(self, now_us: int) -> Iterator[VehicleEvent]:
        """Yield the events since the last call, translated for the core, with mission times."""
        self._clock.wall_passed(now_us)
        if self._parameters is not None:
            self._parameters.continue_reading(self._mode is not None and self._mode[1], now_us)
        while True:
            while self._queued:
                yield self._queued.popleft()
            event = self.client.next_event()
            if event is None:
                return
            translated = self._translate(event, now_us)
            if translated is not None:
                yield translated
            if self._parameters is not None:
                self._queued += self._parameters.receive(event, self._clock.now_us, now_us)

    def execute(self, command: AnyCommand, now_us: int) -> None:
        """Execute one command; ``events`` yields the outcome.

        A command that the client cannot send, for example before the vehicle is connected, is
        reported as refused.
        """
        match command:
            case UploadMission():
                items = as_uploaded(command.items, self.client.stack)
                transfer_id = self.client.upload(items, now_us, holds_first=True)
                self._mission_of_transfer[transfer_id] = command.mission_id
            case Drop():
                self._drop(command, now_us)
            case _ if (order := ORDER_NAMES.get(type(command))) is not None:
                self._order(order, command, now_us)

    def _order(self, name: str, command: AnyCommand, now_us: int) -> None:
        _vehicle, *arguments = msgspec.structs.astuple(command)
        try:
            self.client.command(name, now_us, *arguments)
        except BridgeError as error:
            at_us = self._clock.now_us
            self._queued.append(CommandFinished(at_us, self.name, name, False, str(error)))

    def _drop(self, command: Drop, now_us: int) -> None:
        try:
            if self._dropper is None:
                raise BridgeError("no dropper is configured")
            self._drops[self.client.drop(self._dropper, now_us)] = command
        except BridgeError as error:
            self._queued.append(self._drop_finished(command, "refused", str(error)))

    def _drop_finished(self, command: Drop, outcome: str, reason: str) -> DropFinished:
        named = (self.name, command.plan_hash, command.number)
        done, refused = outcome == "done", outcome == "refused"
        return DropFinished(self._clock.now_us, *named, done, refused, reason)

    def _mission_us(self, boot_us: int, now_us: int) -> int:
        if self._clock.ahead_us is not None:
            mission_us = boot_us + self._clock.ahead_us
            self._clock.autopilot_passed(mission_us, now_us)
            return mission_us
        if self._clock.wall:
            return self._clock.now_us
        if self._offset_us is None:
            self._offset_us = self._clock.latest_us - boot_us
            self._min_behind_us, self._watched_from_us = 0, now_us
        mission_us = self._offset_us + boot_us
        self._clock.autopilot_passed(mission_us, now_us)
        self._watch_behind(self._clock.latest_us - mission_us, now_us)
        return mission_us

    def _watch_behind(self, behind_us: int, now_us: int) -> None:
        # The minimum over ``BEHIND_FOR_US``, because a single message may be delayed.
        self._min_behind_us = min(self._min_behind_us, behind_us)
        if now_us - self._watched_from_us < BEHIND_FOR_US:
            return
        if self._min_behind_us > BEHIND_US and self._offset_us is not None:
            self._offset_us += self._min_behind_us
            behind_us -= self._min_behind_us
        self._min_behind_us, self._watched_from_us = behind_us, now_us

    def _translate(self, event: bridge.ClientEvent, link_us: int) -> VehicleEvent | None:
        now_us, name = self._clock.now_us, self.name
        match event:
            case bridge.Position():
                self._air_data.over_ground(event)
                return Telemetry(
                    self._mission_us(event.boot_us, link_us),
                    name,
                    event.lat_deg,
                    event.lon_deg,
                    event.altitude_amsl_m,
                    event.altitude_relative_m,
                    event.velocity_north_m_s,
                    event.velocity_east_m_s,
                    event.heading_deg,
                )
            case (
                bridge.Attitude()
                | ImageCaptured()
                | GimbalAttitude()
                | FieldOfView()
                | HottestPoint()
                | TrackedPlace()
            ):
                return None if self._camera is None else self._seen(self._camera, event, link_us)
            case bridge.Connected():
                if self._return_height_m is not None:
                    self.client.command("return height", link_us, self._return_height_m)
                self._connected = True
                if self._recognise is not None:
                    self._reading = self.client.download(link_us)
                if self._status_due:
                    self._report_status()
                return _connected(now_us, name, event.stack)
            case bridge.LinkLost():
                self._lost = True
                return LinkLost(now_us, name, round(event.silent_us / 1e6, 3))
            case bridge.LinkRestored():
                self._lost = False
                if self._recognise is not None and self._reading is None:
                    self._reading = self.client.download(link_us)
                if self._status_due:
                    self._report_status()
                return LinkRestored(now_us, name)
            case _:
                translation = self._TRANSLATIONS.get(type(event))
                return None if translation is None else translation(self, event, now_us)

    def _seen(
        self, camera: CameraReports, event: bridge.Attitude | CameraEvent, link_us: int
    ) -> VehicleEvent | None:
        """Return the event for a camera report or for the airframe's attitude."""
        now_us = self._clock.now_us
        match event:
            case bridge.Attitude():
                return camera.on_attitude(event, self._mission_us(event.boot_us, link_us))
            case ImageCaptured():
                return camera.on_image(event, self._image_us(event.boot_us))
            case FieldOfView():
                return camera.on_field_of_view(event, now_us)
            case HottestPoint():
                return camera.on_hottest(event, now_us)
            case TrackedPlace():
                return camera.on_target(event, now_us)
            case GimbalAttitude():
                camera.on_gimbal(event)
        return None

    def _image_us(self, boot_us: int | None) -> int:
        """Return the mission time of an image; an implausible time has no effect on the clock."""
        now_us = self._clock.now_us
        ahead_us = self._offset_us if self._clock.ahead_us is None else self._clock.ahead_us
        if boot_us is None or ahead_us is None or self._clock.wall:
            return now_us
        at_us = boot_us + ahead_us
        plausible = now_us - MAX_IMAGE_DELAY_US < at_us <= now_us + BETWEEN_POSITIONS_US
        return at_us if plausible else now_us

    def _link_alarm(self, event: bridge.LinkAlarm | bridge.AlarmEnded, now_us: int) -> None:
        words = "" if isinstance(event, bridge.AlarmEnded) else str(event)
        self.link_alarms.append((event.kind, words))

    def _links_changed(self, event: bridge.LinksChanged, now_us: int) -> LinksReported:
        found = []
        for status in event.links:
            loss = None if status.loss_share is None else round(status.loss_share, 3)
            since_us = None
            if status.state == "silent" and status.received_us is not None:
                since_us = now_us - (event.at_us - status.received_us)
            found.append(LinkQuality(status.link, status.state, loss, since_us))
        return LinksReported(now_us, self.name, tuple(found), event.in_use, event.cause)

    def _clock_changed(self, event: bridge.ClockChanged, now_us: int) -> None:
        self._offset_us = None

    def _rebooted(self, event: bridge.Rebooted, now_us: int) -> VehicleRebooted:
        self._offset_us = None
        self._status.pop(GpsFixChanged, None)  # so that the fix is reported again
        self._airspeed, self._thrust, self._air_data = MeanAirspeed(), ThrustMonitor(), AirData()
        self._texts.clear()
        return VehicleRebooted(now_us, self.name)

    def _progressed(self, event: bridge.MissionProgress, now_us: int) -> MissionProgress:
        return MissionProgress(now_us, self.name, event.current_seq)

    def _mode_changed(self, event: bridge.ModeChanged, now_us: int) -> ModeChanged:
        self._mode = (event.custom_mode, event.armed, event.name)
        self._mode_reported = True
        return ModeChanged(now_us, self.name, *self._mode)

    def _wind(self, event: bridge.Wind, now_us: int) -> WindMeasured:
        speed_m_s, from_deg = round(event.speed_m_s, 2), round(event.from_deg, 1)
        return WindMeasured(now_us, self.name, speed_m_s, from_deg)

    def _speed(self, event: bridge.Speed, now_us: int) -> None:
        monitors = (self._airspeed, self._air_data, self._thrust)
        found = [monitor.new_report(event, self.name, now_us) for monitor in monitors]
        self._queued += [each for each in found if each is not None]

    def _transferred(self, event: bridge.TransferFinished, now_us: int) -> UploadFinished | None:
        result = event.result
        if event.transfer_id == self._reading:
            self._queued += self._held(result.items)
            return None
        mission_id = self._mission_of_transfer.pop(event.transfer_id, None)
        if mission_id is None:
            return None
        return UploadFinished(now_us, self.name, mission_id, result.outcome, result.reason)

    def _commanded(self, event: bridge.CommandFinished, now_us: int) -> CommandFinished:
        result = (event.name, event.accepted, event.reason, event.replaced)
        return CommandFinished(now_us, self.name, *result)

    def _dropped(self, event: bridge.DropFinished, now_us: int) -> DropFinished | None:
        command = self._drops.pop(event.drop_id, None)
        if command is None:
            return None
        return self._drop_finished(command, event.outcome, event.reason)

    def _battery(self, event: bridge.Battery, now_us: int) -> VehicleEvent | None:
        """Return the state of the battery with the lowest charge, on a change and periodically."""
        self._batteries[event.battery_id] = event
        lowest = min(self._batteries.values(), key=_charge_pct)
        # Floats, as the journal returns them.
        percent, consumed_mah, remaining_s = (
            None if value is None else float(value)
            for value in (lowest.percent, lowest.consumed_mah, lowest.remaining_s)
        )
        before = self._battery_reported
        is_new = before is None or percent != before.percent
        if before is not None and not is_new and now_us - before.at_us < BATTERY_EVERY_US:
            return None
        self._battery_reported = BatteryUpdated(
            *(now_us, self.name, percent, lowest.voltage_v, lowest.current_a),
            *(consumed_mah, remaining_s),
        )
        return self._battery_reported

    def _gps_fix(self, event: bridge.GpsFix, now_us: int) -> VehicleEvent | None:
        """Return the fix, or None if it has not changed: the client also reports satellites."""
        fix = GpsFixChanged(now_us, self.name, event.fix in GOOD_FIXES, event.fix)
        before = self._status.get(GpsFixChanged)
        self._status[GpsFixChanged] = fix
        if before is not None and msgspec.structs.replace(before, at_us=now_us) == fix:
            return None
        return fix

    def _held(self, items: tuple[MissionItem, ...] | None) -> Iterator[VehicleEvent]:
        """Yield the mode, if it has not changed since ``read_back``, and the mission read back."""
        now_us, stack, recognise = self._clock.now_us, self.client.stack, self._recognise
        self._reading = self._recognise = None
        if stack is None or recognise is None:
            return
        if not self._mode_reported:
            self._mode_reported = True
            mode = self._mode or (0, False, stack.mode_name(0))
            yield ModeChanged(now_us, self.name, *mode)
        mission_id = 0 if items is None else recognise(items, stack)
        count = None if items is None else len(items)
        yield MissionReadBack(now_us, self.name, mission_id, count)

    def _text(self, event: bridge.Text, now_us: int) -> AutopilotText | None:
        """Return an autopilot's text; None for a low severity or a repeated text."""
        text = printable(event.text)
        if event.severity > MIN_SEVERITY or not text:
            return None
        before_us = self._texts.pop(text, None)
        self._texts[text] = event.at_us
        if len(self._texts) > MAX_TEXTS_KEPT:
            self._texts.pop(next(iter(self._texts)))
        if before_us is not None and event.at_us - before_us < TEXT_AGAIN_AFTER_US:
            return None
        return AutopilotText(now_us, self.name, event.severity, text)

    def _status_changed(self, event: bridge.StatusEvent, now_us: int) -> StatusChanged:
        """Store a state for ``read_back``, because the client reports a state only on a change."""
        status: StatusChanged
        match event:
            case bridge.SystemState():
                status = SystemStateChanged(now_us, self.name, event.state)
            case bridge.LandedState():
                status = LandedStateChanged(now_us, self.name, event.state)
            case bridge.FenceStatus():
                status = FenceStatusChanged(now_us, self.name, event.breached, event.kind)
            case bridge.EstimatorStatus():
                status = EstimatorStatusChanged(now_us, self.name, event.healthy, event.problems)
            case bridge.RemoteIdStatus():
                status = RemoteIdChanged(now_us, self.name, event.state, printable(event.text))
        self._status[type(status)] = status
        return status

    # ``_translate`` handles the events that need the link's clock. The core does not use events
    # that are in neither this table nor ``_translate``.
    def _aircraft_seen(self, event: AircraftSeen, now_us: int) -> None:
        self.aircraft.append(event)

    _TRANSLATIONS: ClassVar[dict[type[bridge.ClientEvent], Callable[..., VehicleEvent | None]]] = {
        bridge.SameSystemId: _link_alarm,
        bridge.RemoteChanged: _link_alarm,
        bridge.Implausible: _link_alarm,
        bridge.AlarmEnded: _link_alarm,
        bridge.LinksChanged: _links_changed,
        bridge.ClockChanged: _clock_changed,
        AircraftSeen: _aircraft_seen,
        bridge.Rebooted: _rebooted,
        bridge.MissionProgress: _progressed,
        bridge.ModeChanged: _mode_changed,
        bridge.Wind: _wind,
        bridge.Speed: _speed,
        bridge.TransferFinished: _transferred,
        bridge.CommandFinished: _commanded,
        bridge.DropFinished: _dropped,
        bridge.Battery: _battery,
        bridge.GpsFix: _gps_fix,
        bridge.Text: _text,
        bridge.SystemState: _status_changed,
        bridge.LandedState: _status_changed,
        bridge.FenceStatus: _status_changed,
        bridge.EstimatorStatus: _status_changed,
        bridge.RemoteIdStatus: _status_changed,
    }


def _charge_pct(battery: bridge.Battery) -> float:
    """Return the charge in percent; a battery without a percentage counts as fuller than others."""
    return math.inf if battery.percent is None else battery.percent


def printable(text: str) -> str:
    """Return a text as one line without control characters."""
    shown = "".join(each if each.isprintable() else " " for each in text)
    return " ".join(shown.split())


def _connected(now_us: int, name: str, stack: Stack) -> VehicleConnected:
    return VehicleConnected(now_us, name, f"{stack.name} {stack.kind}", stack.atomic_upload)
