"""Derives, from the events and commands of a run, the states that interfaces show. Pure.

HTTP, MQTT, metrics and feeds read this state view and store no state. Each part of the view has a
key (``vehicle/hawk``, ``fire``, ...) and the version of its last change, so that a slow reader
misses intermediate states but never the current state. States are flat JSON with units in their
keys. The state view also contains the statistics of the run.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

from firemodel.landscape.landscape import Landscape
from firemodel.spread.edge import AtEdge
from mission_service.commands import (
    CONFIRM,
    REJECTED,
    AlertOnAircraft,
    Announce,
    AnyCommand,
    ChangeSpeed,
    ClearAlarm,
    DirectionDecision,
    Drop,
    Orbit,
    ProposeMission,
    ProposePlan,
    RaiseAlarm,
    ReportChecks,
    ReportEnergy,
    ShowClearing,
    ShowLanding,
    ShowRelief,
    UploadMission,
    WithdrawMission,
    WithdrawPlan,
)
from mission_service.config.scenario import Scenario
from mission_service.core.lost_link import reaction_of
from mission_service.events import (
    Aborted,
    AircraftReported,
    AirspaceClosed,
    AirspaceOpened,
    AlarmAcknowledged,
    AnyEvent,
    AnyOperatorEvent,
    BatteryUpdated,
    ClearingCancelled,
    ClearingOrdered,
    CommandFinished,
    DropFinished,
    FireReachedEdge,
    GpsFixChanged,
    LinkLost,
    LinkRestored,
    LinksReported,
    MissionProgress,
    MissionRefused,
    ModeChanged,
    NoteAdded,
    Observed,
    OperatorEvent,
    OperatorHeartbeat,
    OrderGiven,
    ParametersReported,
    RemoteIdChanged,
    Resumed,
    SettingsChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
    WindSet,
)
from mission_service.fire.camera import camera_of
from mission_service.ignition_plan import IgnitionPlan
from mission_service.missions.mission_hash import mission_hash
from mission_service.operator_lines import operator_line
from mission_service.runtime.alarms.nearby_aircraft import AircraftView
from mission_service.runtime.alarms.notices import Notices
from mission_service.runtime.observation_sources import ObservationSources
from mission_service.runtime.published_states import (
    ClearingStatus,
    LinkState,
    Mission,
    MissionState,
    NearbyAircraft,
    OrbitState,
    RecordKind,
    SourceState,
    TelemetryState,
    VehicleState,
    clearing_status,
    item_state,
)
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.vehicles.remote_id_state import RemoteIdReport

FIRE_EVERY_US = 30_000_000
SOURCES_EVERY_US = 5_000_000
LOW_BATTERY_PCT, GOOD_BATTERY_PCT = 25.0, 30.0
OF_AIRSPACE = (AirspaceClosed, AirspaceOpened, ClearingOrdered, ClearingCancelled)
# Kinds of log lines about operators' events; all other lines concern the fire.
RECORD_KINDS: dict[type[OperatorEvent], RecordKind] = {
    SettingsChanged: "settings",
    AlarmAcknowledged: "alarm",
}
OF_FIRE = ("edge", "input")  # prefixes of alarms about the fire, which persist after a restart
# Prefixes of the alarms that result from the flight; all others concern the service itself.
OF_FLIGHT = (
    *("link", "one_link", "silent", "position", "battery", "mission", "order", "abort", "near"),
    *("mode", "state", "fence", "estimator", "autopilot", "front", "landed", "unrecorded"),
    *("observer", "sensor", "estimate", "lost_link", "energy", "overdue"),
    *("airspace", "clearing", "airspeed", "thrust", "landing", "aircraft", "preflight", "relief"),
    *OF_FIRE,
)


def questioned(commands: Iterable[AnyCommand]) -> set[str]:
    """Return the vehicles whose order was refused or needs confirmation."""
    lines = [command for command in commands if isinstance(command, Announce)]
    return {line.vehicle for line in lines if line.text.startswith((CONFIRM, REJECTED))}


def edge_text(event: FireReachedEdge) -> str:
    """Return the warning that the fire has reached the edge of the landscape."""
    return str(AtEdge(event.arrived_at_us / 1e6, event.lat_deg, event.lon_deg))


def _of_flight(alarm: str) -> bool:
    return alarm.partition("/")[0] in OF_FLIGHT


class StateView(Notices):
    """The states of a run. ``apply`` processes an event; ``version`` increases with each change."""

    def __init__(
        self, scenario: Scenario, landscape: Landscape, at_us: int, warnings: Sequence[str] = ()
    ) -> None:
        """Begin at ``at_us`` with an alarm for each warning about the scenario."""
        sources = ObservationSources(landscape, scenario.estimate.sensors, at_us)
        names = tuple(each.name for each in scenario.flown)
        super().__init__(at_us, RunStatistics(names, at_us, sources))
        self.vehicles = {
            section.name: VehicleState(
                at_us,
                section.name,
                section.kind,
                section.stack,
                section.system_id,
                section.home_lat_deg,
                section.home_lon_deg,
            )
            for section in scenario.flown
        }
        self.missions = {name: MissionState(at_us, name) for name in self.vehicles}
        self.telemetry: dict[str, TelemetryState] = {}
        self.clearing: ClearingStatus | None = None
        self._aircraft = AircraftView()
        self.plan: IgnitionPlan | None = None
        self.plan_hash = ""
        self.fire_version = 1  # increases when operators change the fire
        self.wind_set: WindSet | None = None
        self.reached_edge: FireReachedEdge | None = None
        self.telemetry_count = 0  # includes positions that could not be journalled
        self._landscape = landscape
        self._view_width_m = {
            section.name: round(2.0 * camera_of(section).half_width_m(section.altitude_agl_m), 1)
            for section in scenario.flown
        }
        self._fire_shown_us = at_us
        self._failed_sensors: tuple[str, ...] = ()
        self._sources_due_us = at_us
        self._sources_shown: tuple[tuple[str, str, str, int], ...] = ()
        self._touch("status", "fire", "burn", "airspace", "alarms", "announcements", "records")
        self._touch("sources")
        if scenario.surveillance is not None:
            self._touch("aircraft")
        for name in self.vehicles:
            self._touch(f"vehicle/{name}", f"mission/{name}")
        for number, line in enumerate(warnings, start=1):
            self._warn(f"input/{number}", line)

    # Input ------------------------------------------------------------------------------------

    def apply(self, event: AnyEvent, commands: Iterable[AnyCommand]) -> None:
        """Process an event and its commands."""
        self.at_us = max(self.at_us, event.at_us)
        commands = list(commands)
        self.statistics.apply(event, commands)
        if isinstance(event, OperatorEvent):
            if isinstance(event, AlarmAcknowledged):
                self.acknowledge_alarm(event.alarm, event.by or "an operator")
            else:
                self._asked(event, questioned(commands))
            line = operator_line(event)
            if isinstance(event, NoteAdded):
                self._record("note", "", line, note=event)
            elif line:
                self._record(RECORD_KINDS.get(type(event), "fire"), "", line)
        elif event.vehicle in self.vehicles:
            self._happened(self.vehicles[event.vehicle], event)
        for command in commands:
            if command.vehicle in self.vehicles:
                self._commanded(self.vehicles[command.vehicle], command)
            elif isinstance(command, Announce):
                self.announce(command.vehicle, command.text, command.level)
        self._fire_grew()
        self._check_sources()

    def show_unrecorded(self, fix: Telemetry) -> None:
        """Show a position that could not be journalled and is not used otherwise."""
        self.at_us = max(self.at_us, fix.at_us)
        self._moved(fix)
        self._fire_grew()

    def _fire_grew(self) -> None:
        if self.at_us - self._fire_shown_us >= FIRE_EVERY_US:
            self._fire_shown_us = self.at_us
            self._touch("fire")

    def _check_sources(self) -> None:
        """Every few seconds, mark the sources as changed if an observation or a state is new."""
        if self.at_us < self._sources_due_us:
            return
        self._sources_due_us = self.at_us + SOURCES_EVERY_US
        shown = tuple(
            (each.source, each.state, each.problem, each.observations) for each in self.sources()
        )
        if shown != self._sources_shown:
            self._sources_shown = shown
            self._touch("sources")

    def show_sensors(self, problems: Mapping[str, str], failed: Iterable[str]) -> None:
        """Raise an alarm for each sensor with a problem; the ``failed`` sensors are not used."""
        self.show_alarms("sensor", problems, "severe")
        self._failed_sensors = tuple(failed)

    def fire_changed(self) -> None:
        """Mark the fire as changed by an operator."""
        self.fire_version += 1
        self._touch("fire")

    def readiness_changed(self) -> None:
        """Mark the status as changed after a change in the conditions that are not met."""
        self._touch("status")

    def arrivals_changed(self) -> None:
        """Mark the fire's arrivals at people and values at risk as changed."""
        self._touch("fire_arrivals")

    def replay_changed(self) -> None:
        """Mark the replay as changed after a change in its position or speed."""
        self._touch("replay")

    def take_the_place_of(self, before: "StateView") -> None:
        """Replace the view ``before``, and mark all states as changed, so that all are read again.

        The announcements of this view count as already forwarded.
        """
        self.version = max(self.version, before.version)
        self.fire_version = max(self.fire_version, before.fire_version) + 1
        of_service = {key: alarm for key, alarm in before.alarms.items() if not _of_flight(key)}
        self.alarms = {key: alarm for key, alarm in self.alarms.items() if _of_flight(key)}
        self.alarms |= of_service
        self._touch("replay")  # first, so that readers read all states again
        self._touch(*(self.changed.keys() - {"replay"}))
        self.announcement_id = self.last_id_before_restart = self.version

    def _asked(self, event: AnyOperatorEvent, not_ordered: set[str]) -> None:
        """Process a request; orders to the vehicles ``not_ordered`` were refused or are pending."""
        if isinstance(event, OperatorHeartbeat | NoteAdded):
            return
        of_airspace = isinstance(event, OF_AIRSPACE)
        self._touch("airspace" if of_airspace else "burn")
        match event:
            case WindSet():
                self.wind_set = event
                self.fire_changed()
            case OrderGiven():
                self._ordered(event, not_ordered)
            case Aborted():
                self.alarm("abort", f"aborted by {event.by or 'an operator'}", "severe")
                for vehicle in self.vehicles.values():
                    self._order(vehicle, "hold")
            case SettingsChanged():
                self._touch("status")
            case FireReachedEdge():
                self.reached_edge = event
                self._warn("edge", edge_text(event))
            case MissionRefused():
                proposed = self.missions[event.vehicle].proposed
                if proposed is not None and proposed.mission_hash == event.mission_hash:
                    self._withdrawn(event.vehicle)
            case Resumed():
                for name, vehicle in self.vehicles.items():
                    vehicle.link, vehicle.links = "never heard", ()
                    self._touch(f"vehicle/{name}")
                    self._withdrawn(name)
                self._touch("status")
            case _:
                pass

    def _ordered(self, event: OrderGiven, not_ordered: set[str]) -> None:
        held = "hold" if event.order == "go-around" else ""
        order = event.order if event.order in ("hold", "return", "land") else held
        for name, vehicle in self.vehicles.items():
            if event.vehicle in ("", name) and name not in not_ordered:
                self._order(vehicle, order)
        if event.order in ("resume", "start", "takeoff") and not not_ordered:
            self.clear_alarm("abort")

    def _order(self, vehicle: VehicleState, order: str) -> None:
        vehicle.order = order
        vehicle.orbit = None if order else vehicle.orbit
        self._touch(f"vehicle/{vehicle.vehicle}")

    def _withdrawn(self, name: str) -> None:
        self.missions[name].proposed = None
        self._touch(f"mission/{name}")

    def _happened(self, vehicle: VehicleState, event: VehicleEvent) -> None:
        match event:
            case Telemetry():
                self._moved(event)
                return
            case AircraftReported():
                self._aircraft.on_reported(event)
                self._touch("aircraft")
                return
            case Observed() | MissionProgress(current_seq=vehicle.current_seq):
                return
            case _:
                happened = self._HAPPENED.get(type(event))
        if happened is not None:
            happened(self, vehicle, event)
            vehicle.at_us = event.at_us
            self._touch(f"vehicle/{vehicle.vehicle}")

    def _linked(
        self, vehicle: VehicleState, event: VehicleConnected | LinkLost | LinkRestored
    ) -> None:
        name = vehicle.vehicle
        if isinstance(event, LinkLost):
            vehicle.link = "lost"
            self.alarm(f"link/{name}", f"{name}: link lost", "severe", name)
            return
        vehicle.link = "online"
        self.clear_alarm(f"link/{name}")
        if isinstance(event, VehicleConnected):
            vehicle.detected_stack = event.stack
            self.clear_alarm(f"silent/{name}")

    def _links(self, vehicle: VehicleState, event: LinksReported) -> None:
        vehicle.links = tuple(
            LinkState(
                each.link,
                each.state,
                each.link == event.in_use,
                None if each.loss_share is None else round(100.0 * each.loss_share, 1),
                each.silent_since_us,
            )
            for each in event.links
        )

    def _rebooted(self, vehicle: VehicleState, event: VehicleRebooted) -> None:
        self.missions[vehicle.vehicle] = MissionState(event.at_us, vehicle.vehicle)
        vehicle.orbit = None
        self._touch(f"mission/{vehicle.vehicle}")

    def _parameters(self, vehicle: VehicleState, event: ParametersReported) -> None:
        loss = reaction_of(event)
        vehicle.lost_link = "" if loss is None else str(loss)
        vehicle.return_height_m = None if loss is None else loss.return_height_m
        vehicle.fence_action = "" if loss is None else loss.fence

    def _remote_id(self, vehicle: VehicleState, event: RemoteIdChanged) -> None:
        vehicle.remote_id = RemoteIdReport(event.state, event.text).state_in_words

    def _mode_changed(self, vehicle: VehicleState, event: ModeChanged) -> None:
        vehicle.mode, vehicle.armed = event.mode, event.armed
        if not event.armed:
            vehicle.orbit = None

    def _gps_fix(self, vehicle: VehicleState, event: GpsFixChanged) -> None:
        name = vehicle.vehicle
        vehicle.position_good, vehicle.position_fix = event.good, event.fix
        if event.good:
            self.clear_alarm(f"position/{name}")
        else:
            self.alarm(f"position/{name}", f"{name}: no position fix", "severe", name)

    def _wind_measured(self, vehicle: VehicleState, event: WindMeasured) -> None:
        vehicle.wind_speed_m_s, vehicle.wind_from_deg = event.speed_m_s, event.from_deg

    def _progressed(self, vehicle: VehicleState, event: MissionProgress) -> None:
        vehicle.current_seq = event.current_seq

    def _moved(self, fix: Telemetry) -> None:
        self.telemetry_count += 1
        land = self._landscape
        x_m, y_m = land.xy_of_lat_lon(fix.lat_deg, fix.lon_deg)
        height_m = None
        if math.isfinite(x_m + y_m):
            height_m = round(fix.altitude_amsl_m - float(land.elevation_at(x_m, y_m)), 1)
        north, east = fix.velocity_north_m_s, fix.velocity_east_m_s
        self.telemetry[fix.vehicle] = TelemetryState(
            fix.at_us,
            fix.vehicle,
            fix.lat_deg,
            fix.lon_deg,
            fix.altitude_amsl_m,
            fix.altitude_relative_m,
            height_m,
            fix.heading_deg,
            round(math.hypot(north, east), 2),
            round(math.degrees(math.atan2(east, north)) % 360.0, 1),
        )
        self._touch(f"telemetry/{fix.vehicle}")

    def _battery(self, vehicle: VehicleState, event: BatteryUpdated) -> None:
        if event.percent is None:
            return
        name, vehicle.battery_pct = vehicle.vehicle, event.percent
        if event.percent < LOW_BATTERY_PCT:
            self.alarm(f"battery/{name}", f"{name}: battery low", "warning", name)
        elif event.percent >= GOOD_BATTERY_PCT and not vehicle.armed:
            # In flight the charge does not rise: a wrong value must not hide a low battery.
            self.clear_alarm(f"battery/{name}")

    def _uploaded(self, vehicle: VehicleState, event: UploadFinished) -> None:
        name = vehicle.vehicle
        mission = self.missions[name]
        sent = mission.sending
        if sent is None or sent.mission_id != event.mission_id:
            return
        sent.outcome, sent.reason = event.outcome, event.reason
        uploads = self.statistics.vehicles[name].uploads
        vehicle.uploads_accepted = uploads["accepted"]
        vehicle.uploads_failed = uploads.total() - vehicle.uploads_accepted
        mission.at_us = event.at_us
        size = f"mission of {len(sent.items)} items"
        if event.outcome == "accepted":
            self._record("mission", name, f"{size} on board: {sent.why}")
            mission.on_board, mission.sending = sent, None
            self.clear_alarm(f"mission/{name}")
        else:
            self._record("mission", name, f"{size} {event.outcome}: {event.reason}", "warning")
            text = f"{name}: mission {event.outcome}: {event.reason}"
            self.alarm(f"mission/{name}", text, "warning", name)
        self._touch(f"mission/{name}")

    def _answered(self, vehicle: VehicleState, event: CommandFinished) -> None:
        name = vehicle.vehicle
        key = f"order/{name}/{event.command}"
        if event.accepted:
            self.clear_alarm(key)
        elif not event.replaced:
            text = f"{name}: {event.command} refused: {event.reason}"
            self.alarm(key, text, "warning", name)

    def _dropped(self, vehicle: VehicleState, event: DropFinished) -> None:
        match event.outcome:
            case "done":
                vehicle.drops_done += 1
            case "refused":
                vehicle.drops_refused += 1
            case _:
                vehicle.drops_unknown += 1
        self._touch("burn")

    def _commanded(self, vehicle: VehicleState, command: AnyCommand) -> None:
        name = vehicle.vehicle
        match command:
            case DirectionDecision() | Orbit() | ChangeSpeed():
                self._led(vehicle, command)
            case ReportEnergy() | ShowLanding() | ShowRelief() | ReportChecks():
                self._reported(vehicle, command)
            case UploadMission() | ProposeMission():
                self._sent(name, command)
            case Announce():
                self.announce(name, command.text, command.level)
            case RaiseAlarm() | ClearAlarm() | AlertOnAircraft():
                self._alerted(name, command)
            case WithdrawMission():
                proposed = self.missions[name].proposed
                if proposed and proposed.mission_id == command.mission_id:
                    self._withdrawn(name)
            case ProposePlan() | WithdrawPlan() | Drop():
                self._of_burn(command)
            case ShowClearing():
                self.clearing = clearing_status(command, self.at_us)
                self._touch("airspace")
            case _:
                pass

    def _of_burn(self, command: ProposePlan | WithdrawPlan | Drop) -> None:
        match command:
            case ProposePlan():
                self.plan, self.plan_hash = command.plan, command.plan_hash
            case WithdrawPlan() if command.plan_hash == self.plan_hash:
                self.plan, self.plan_hash = None, ""
        self._touch("burn")

    def _alerted(self, name: str, command: RaiseAlarm | ClearAlarm | AlertOnAircraft) -> None:
        match command:
            case RaiseAlarm():
                text = f"{name}: {command.text}"
                self.alarm(f"{command.alarm}/{name}", text, command.severity, name)
            case ClearAlarm():
                self.clear_alarm(f"{command.alarm}/{name}")
            case AlertOnAircraft():
                self._aircraft.on_level(name, command.aircraft, command.level)
                self._touch("aircraft")

    def _led(self, vehicle: VehicleState, command: DirectionDecision | Orbit | ChangeSpeed) -> None:
        match command:
            case DirectionDecision():
                vehicle.direction = command.direction
                statistics = self.statistics.vehicles[vehicle.vehicle]
                vehicle.decisions = statistics.decisions
                vehicle.reversals = statistics.reversal_count
                if command.reversed:
                    vehicle.reversed_at_us = self.at_us
                vehicle.importance_back = round(command.importance_back, 3)
                vehicle.importance_front = round(command.importance_front, 3)
                vehicle.front_cells = command.front_cells
            case Orbit():
                circle = (command.lat_deg, command.lon_deg, command.altitude_amsl_m)
                view_width_m = self._view_width_m[vehicle.vehicle]
                vehicle.orbit = OrbitState(*circle, command.radius_m, view_width_m)
            case ChangeSpeed():
                vehicle.ordered_airspeed_m_s = command.airspeed_m_s
        vehicle.at_us = self.at_us
        self._touch(f"vehicle/{vehicle.vehicle}")

    def _reported(
        self, vehicle: VehicleState, command: ReportEnergy | ShowLanding | ShowRelief | ReportChecks
    ) -> None:
        match command:
            case ReportChecks():
                vehicle.checks = command.checks
                vehicle.waits_for_signoff = command.waits
                vehicle.signed_off_by = command.signed_off_by
            case ReportEnergy():
                self._energy(vehicle, command)
            case ShowRelief():
                vehicle.relief = command.text
            case ShowLanding():
                vehicle.landing = "" if command.phase == "none" else command.phase
                vehicle.order = "hold" if command.holds else vehicle.order
        vehicle.at_us = self.at_us
        self._touch(f"vehicle/{vehicle.vehicle}")

    def _energy(self, vehicle: VehicleState, command: ReportEnergy) -> None:
        times_s = (command.time_on_task_s, command.time_home_s, command.time_landing_s)
        vehicle.time_on_task_s, vehicle.time_home_s, vehicle.time_landing_s = times_s
        known_s = [each for each in times_s if each is not None]
        is_known = len(known_s) == len(times_s)
        vehicle.must_land_at_us = self.at_us + sum(known_s) * 1_000_000 if is_known else None
        vehicle.energy_source = command.source

    def _sent(self, name: str, command: UploadMission | ProposeMission) -> None:
        proposed = isinstance(command, ProposeMission)
        sent = Mission(
            command.mission_id,
            self.at_us,
            command.why,
            "proposed" if proposed else "sending",
            "",
            mission_hash(command.items),
            tuple(item_state(item) for item in command.items),
        )
        mission = self.missions[name]
        mission.at_us = self.at_us
        if proposed:
            mission.proposed = sent
        else:
            mission.sending, mission.proposed = sent, None
        self._touch(f"mission/{name}")

    # The methods that change a vehicle's state, by event; telemetry is handled separately.
    _HAPPENED: ClassVar[dict[type[VehicleEvent], Callable[..., None]]] = {
        VehicleConnected: _linked,
        LinkLost: _linked,
        LinkRestored: _linked,
        LinksReported: _links,
        VehicleRebooted: _rebooted,
        ModeChanged: _mode_changed,
        ParametersReported: _parameters,
        RemoteIdChanged: _remote_id,
        BatteryUpdated: _battery,
        GpsFixChanged: _gps_fix,
        WindMeasured: _wind_measured,
        MissionProgress: _progressed,
        UploadFinished: _uploaded,
        CommandFinished: _answered,
        DropFinished: _dropped,
    }

    # Output -----------------------------------------------------------------------------------

    def sources(self) -> list[SourceState]:
        """Return the contribution and the state of each source of observations."""
        problems, contradictions = self._alarms_of("sensor"), self._alarms_of("observer")
        return self.statistics.sources.states(
            self.at_us, problems, contradictions, self._failed_sensors
        )

    def aircraft(self) -> list[NearbyAircraft]:
        """Return the other aircraft near the vehicles."""
        return self._aircraft.nearby(self.telemetry)

    def _alarms_of(self, prefix: str) -> dict[str, str]:
        """Return the texts of the alarms ``prefix/NAME`` by name."""
        split = ((key.partition("/"), alarm.text) for key, alarm in self.alarms.items())
        return {name: text for (kind, _, name), text in split if kind == prefix}

    def fire(self, area_ha: float, corrections: list[dict[str, Any]]) -> dict[str, Any]:
        """Return the fire's area, wind and corrections; clients request the shape separately."""
        wind = self.wind_set
        return {
            "schema": "fire/1",
            "at_us": self.at_us,
            "version": self.fire_version,
            "area_ha": round(area_ha, 2),
            "wind_speed_m_s": None if wind is None else wind.speed_m_s,
            "wind_from_deg": None if wind is None else wind.from_deg,
            "wind_set_by": "" if wind is None else wind.by,
            "corrections": corrections,
        }
