"""Runs the live service: the vehicles' links and the interfaces, in one TaskGroup."""

import asyncio
import contextlib
import gc
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path

from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.config.rule_lookup import faults_of
from mission_service.config.scenario import Scenario
from mission_service.config.service_section import ServiceSection
from mission_service.config.shared_links import sharing
from mission_service.core.core import Core
from mission_service.errors import UnhandledLineError
from mission_service.events import SERVICE, OrderGiven
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of, warnings_on
from mission_service.fire.simulated_cameras import SimulatedCameras, cameras_of
from mission_service.fire.warm_up import warm_up as warm_up_fire
from mission_service.guidance.registry import way_of
from mission_service.interfaces.control.control_client import NAME
from mission_service.interfaces.control.control_server import claimed, serve_control
from mission_service.interfaces.mqtt.peer_exchange import Channel, PeerExchange
from mission_service.journal.journal_file import Journal, header_of
from mission_service.journal.private_files import refuse_links, writable_by_others
from mission_service.journal.recovery import InterruptedRun, rename_old, resumed, unfinished
from mission_service.journal.snapshot import Frozen, Known, restore
from mission_service.live.aircraft_sources import receive_aircraft
from mission_service.live.compile_progress import compile_progress
from mission_service.live.estimate_worker import EstimateWorker
from mission_service.live.interface_setup import (
    RunInterface,
    flush,
    interfaces_of,
    request_handler_of,
)
from mission_service.runtime.alarms.health_monitor import HealthMonitor
from mission_service.runtime.alarms.proximity_alarms import ProximityAlarms
from mission_service.runtime.clocks import clock_us, last_written_s, wall_us
from mission_service.runtime.engine import Engine, Progress, no_broadcast, unshown
from mission_service.runtime.freed_memory import give_back_freed
from mission_service.runtime.gateway import Gateway, MissionClock
from mission_service.runtime.journal_retention import JournalRetention
from mission_service.runtime.peer_listener import PeerListener
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import OF_FIRE, StateView
from mission_service.runtime.vehicle_links import (
    SEVERITIES,
    Link,
    LinkMonitor,
    alarms,
    connected,
    open_links,
)

STATUS_EVERY_S = 0.2


@dataclass(frozen=True)
class Run:
    """A run: its scenario, settings and files."""

    scenario: Scenario
    journal_path: Path
    created: str  # wall-clock time as text
    settings: ServiceSection = field(default_factory=ServiceSection)
    tlog_path: Path | None = None
    logs: bool = False  # write a log of announcements and alarms
    channel: Channel | None = None  # connects vehicles of several processes
    resume: bool = True  # resume an interrupted run
    skip_unreadable: bool = False  # resume without unreadable journal lines

    @property
    def out(self) -> Path:
        """The folder of the run."""
        return self.journal_path.parent


async def serve(
    run: Run,
    progress: Progress = unshown,
    watch: Callable[[], None] = lambda: None,
    address: Callable[[str], None] = lambda address: None,
    notice: Callable[[str], None] = lambda line: None,
) -> tuple[RunStatistics, Fire]:
    """Run until the scenario's end, SIGINT or SIGTERM; return the statistics and the fire.

    Vehicles keep the mission on board, which ends in a loiter, unless the setting ``on_shutdown``
    is an order. ``progress`` and ``watch`` are called five times a second; ``watch`` may raise an
    exception to end the run, for example after the exit of a child process. ``address`` receives
    the address of the map, which may contain a token and must not be logged. ``notice`` receives
    lines while kernels are compiled before the links open.

    Raises ScenarioError for vehicles that cannot share their link.
    """
    give_back_freed()
    scenario = run.scenario
    sharing(scenario.flown)  # checked before a link is opened
    refuse_links(run.out)
    clock = MissionClock(round(scenario.start_s * 1e6), wall=scenario.clock == "wall")
    latest_us = round(scenario.duration_s * 1e6)
    landscape = landscape_of(scenario)
    watch_arrivals = _arrival_watch(run, landscape)
    _warm_up(scenario, landscape, notice)
    announcements = _Announcements()
    async with contextlib.AsyncExitStack() as stack:
        # Open the ports and the control socket first: if one is in use, an earlier journal stays
        # unchanged.
        listening = stack.enter_context(claimed(run.out / NAME))
        run_interfaces = interfaces_of(
            run.settings,
            run.out,
            scenario.name,
            stack,
            address,
            run.logs,
            announcements.show,
        )
        links = await open_links(
            stack,
            scenario,
            landscape,
            clock,
            clock_us,
            wall_us,
            run.tlog_path,
            announcements.show,
        )
        gateways = {name: link.gateway for name, link in links.items()}
        exchange = None
        if run.channel is not None:
            exchange = PeerExchange(run.channel, gateways, latest_us)
        service = await _engine_of(run, landscape, clock, gateways, exchange, announcements, stack)
        retention = JournalRetention(service, service.shared_references, run.settings.journal)
        worker = EstimateWorker(service, clock_us, partial(flush, links))
        context = _context_of(run, service, clock, links, worker)
        stack.callback(context.close)
        context.gauges["state_seconds"] = lambda: retention.write_s
        check = _Check(context, watch, progress)
        stop = asyncio.Event()
        signals = stop_on_signals(stop)
        tasks: list[RunInterface] = [
            *(partial(_fly, on_it) for on_it in connected(links)),
            lambda context: serve_control(listening, context.request_handler),
            *run_interfaces,
            lambda context: retention.maintain(clock),
            lambda context: worker.fold_inputs(),
        ]
        if scenario.surveillance is not None:
            tasks.append(partial(receive_aircraft, section=scenario.surveillance))
        if watch_arrivals is not None:
            tasks.append(watch_arrivals)
        gc.freeze()  # full collections, which hold the event loop, need not visit these objects
        is_over = await _run_tasks(context, tasks, exchange, check, stop, latest_us)
        _end_journal(service, is_over, signals)
    service.estimate.advance(clock.now_us)
    progress(service.state_view, service.estimate.fire)
    return service.statistics, service.estimate.fire


def _end_journal(service: Engine, is_over: bool, signals: set[signal.Signals]) -> None:
    """Mark the end of the run in the journal, unless the next start is to resume the run.

    After SIGTERM, sent by a supervisor, the next start resumes the run.
    """
    terminated = signal.SIGTERM in signals
    if is_over or (not terminated and service.core.guidance.status()["complete"]):
        service.recording.journal.end()
        if signal.SIGINT in signals:
            service.announce("service", "the run has ended; the next start begins a new run")


def _arrival_watch(run: Run, landscape: Landscape) -> RunInterface | None:
    """Return the interface for alarms of the fire's arrival, if it is configured.

    Raises ScenarioError.
    """
    section = run.settings.fire_arrival
    if section is None:
        return None
    from mission_service.live.fire_arrival_watch import values_of, watch_fire_arrival

    values = values_of(section, landscape)
    return partial(watch_fire_arrival, section=section, values=values)


def _warm_up(scenario: Scenario, landscape: Landscape, notice: Callable[[str], None]) -> None:
    """Compile all kernels of planners and fire, or load them from the disk cache."""
    with compile_progress(notice):
        with faults_of(scenario.planner.rule):
            way_of(scenario).warm_up(scenario, landscape)
        warm_up_fire(scenario)


async def _run_tasks(
    context: RunContext,
    interfaces: list[RunInterface],
    exchange: PeerExchange | None,
    check: Callable[[], None],
    stop: asyncio.Event,
    latest_us: int,
) -> bool:
    """Run until ``stop`` is set or mission time is ``latest_us``, then cancel all tasks.

    Returns whether mission time ``latest_us`` was reached.
    """
    clock = context.clock
    async with asyncio.TaskGroup() as group:
        tasks = []
        if exchange is not None:
            listener = PeerListener(context.service, clock, clock_us)
            tasks.append(group.create_task(exchange.run(listener)))
            await exchange.join()
        tasks += [group.create_task(run_interface(context)) for run_interface in interfaces]
        group.create_task(asyncio.to_thread(_load_for_corrections))
        while not stop.is_set() and clock.now_us < latest_us:
            check()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), STATUS_EVERY_S)
        context.stopping = True
        is_over = clock.now_us >= latest_us
        if not is_over:
            await _stop_ordered(context)
        for task in tasks:
            task.cancel()
    return is_over


class _Announcements:
    """Announcements from the links and the journal, buffered until the engine exists."""

    def __init__(self) -> None:
        self.engine: Engine | None = None
        self._early: list[tuple[str, str]] = []

    def show(self, vehicle: str, text: str) -> None:
        """Announce a text about a vehicle, or buffer the text."""
        if self.engine is None:
            self._early.append((vehicle, text))
        else:
            self.engine.announce(vehicle, text)

    def add_early(self) -> None:
        """Announce the buffered texts."""
        for vehicle, text in self._early:
            self.show(vehicle, text)


async def _engine_of(
    run: Run,
    landscape: Landscape,
    clock: MissionClock,
    gateways: dict[str, Gateway],
    exchange: PeerExchange | None,
    announcements: _Announcements,
    stack: contextlib.AsyncExitStack,
) -> Engine:
    """Return the engine of a new or resumed run; ``stack`` closes the journal."""
    references = Known(run.scenario, landscape)
    interrupted, down_from_s = _interrupted(run, references, announcements.show)
    journal = _journal_of(run, references, interrupted, announcements.show)
    stack.callback(journal.close)
    broadcast = no_broadcast if exchange is None else exchange.broadcast
    core, cameras, estimate, state_view = _initial_state(
        run.scenario, landscape, clock, interrupted
    )
    service = Engine(
        run.scenario, core, cameras, estimate, journal, state_view, gateways, broadcast
    )
    stack.callback(service.sensors.close)
    announcements.engine = service
    if interrupted is not None:
        await _resume(interrupted, service, clock, wall_us() / 1e6 - down_from_s)
        service.announce(
            "service", f"resumes the run of {run.journal_path}; earlier approvals are void"
        )
        for why in interrupted.newly_skipped.values():
            service.announce("service", f"journal line skipped: {why}")
    announcements.add_early()
    return service


def _interrupted(
    run: Run, references: Known, report: Callable[[str, str], None]
) -> tuple[InterruptedRun | None, float]:
    """Return the run to resume, if any, and when its journal was last written (s since 1970).

    A run that was interrupted for longer than its duration is not resumed. Otherwise it would end
    at once, and no vehicle in the air would be controlled: the computer's clock may have been wrong
    before the interruption.
    """
    if not run.resume:
        return None, 0.0
    interrupted = unfinished(run.journal_path, references, run.scenario, run.skip_unreadable)
    if interrupted is None:
        return None, 0.0
    down_from_s = last_written_s(run.journal_path)
    down_s = wall_us() / 1e6 - down_from_s
    if down_s > run.scenario.duration_s - run.scenario.start_s:
        words = f"the run of {run.journal_path} is not resumed: it was interrupted"
        words += f" {down_s / 3600.0:.1f} h ago, which is longer than its duration"
        report("service", f"{words}; if that is not true, check the computer's clock")
        return None, 0.0
    return interrupted, down_from_s


def _context_of(
    run: Run,
    service: Engine,
    clock: MissionClock,
    links: dict[str, Link],
    worker: EstimateWorker,
) -> RunContext:
    """Return the interfaces' context, which is ready after a heartbeat from each vehicle."""
    context = RunContext(
        run.scenario,
        run.settings,
        service,
        request_handler_of(run.scenario, service, clock, links, worker.outcome),
        clock,
        links,
        run.journal_path,
    )
    context.not_ready = dict.fromkeys(links, "no heartbeat yet")
    return context


class _Check:
    """The checks and the progress display that the daemon runs five times a second."""

    def __init__(self, context: RunContext, watch: Callable[[], None], progress: Progress) -> None:
        self._context = context
        self._watch = watch
        self._progress = progress
        self._links = LinkMonitor(context.links, clock_us())
        view, separation_m = context.state_view, context.scenario.mission.separation_m
        self._health = HealthMonitor(view, round(STATUS_EVERY_S * 1e6))
        self._proximity = ProximityAlarms(view, separation_m)
        self._not_ready = context.ready()

    def __call__(self) -> None:
        """Check links and alarms, and show progress. Raises the engine's defect, if any."""
        context = self._context
        self._watch()
        if context.service.defect is not None:
            raise context.service.defect
        now_us = clock_us()
        context.service.clock_read(now_us)
        context.service.take_reports(context.clock.now_us, now_us)
        self._health.check_delay(now_us)
        self._proximity.check_pairs(now_us)
        _check_links(context, self._links, now_us)
        if (not_ready := context.ready()) != self._not_ready:
            self._not_ready = not_ready
            context.state_view.readiness_changed()
        self._progress(context.state_view, context.estimate.fire)
        context.ring()


def _journal_of(
    run: Run,
    references: Known,
    interrupted: InterruptedRun | None,
    report: Callable[[str, str], None],
) -> Journal:
    """Return the journal of the resumed run, or a new journal; an earlier journal is renamed."""
    renamed = None if interrupted else rename_old(run.journal_path)
    if renamed is not None:
        report("service", f"begins a new run; the previous journal was renamed to {renamed.name}")
    if writable_by_others(run.out.stat()):
        report(
            "service",
            f"other users of this machine can write to {run.out}; run chmod 700 {run.out}",
        )
    rest = None if interrupted is None else interrupted.rest()
    header = header_of(run.scenario, references.landscape, run.created)
    return Journal(run.journal_path, header, durable=True, rest=rest)


def _load_for_corrections() -> None:
    """Import and compile the modules that the first corrections and images of the fire use.

    Otherwise the imports would block the event loop at the first correction or image.
    """
    modules = (
        "scipy.ndimage",
        "firemodel.assimilation.corrected_cells",
        "contourpy",
        "rasterio.features",
    )
    for name in modules:
        import_module(name)
    from firemodel.assimilation.corrected_cells import warm_up

    warm_up()


def _initial_state(
    scenario: Scenario,
    landscape: Landscape,
    clock: MissionClock,
    interrupted: InterruptedRun | None,
) -> tuple[Core, SimulatedCameras | None, RunEstimate, StateView]:
    """Return core, cameras, estimate and state view, new or from the state of a resumed run."""
    if interrupted is not None and interrupted.objects is not None:
        saved = interrupted.objects
        return saved["core"], saved["cameras"], saved["estimate"], saved["state_view"]
    estimate = RunEstimate(scenario, landscape)
    estimate.advance(clock.now_us)
    warnings = warnings_on(scenario, landscape)
    state_view = StateView(scenario, landscape, clock.now_us, warnings)
    return Core(scenario, landscape), cameras_of(scenario, landscape), estimate, state_view


async def _resume(
    interrupted: InterruptedRun, service: Engine, clock: MissionClock, down_s: float
) -> None:
    """Resume an interrupted run: apply its journal in a thread while links stay open."""
    began_us = clock_us()
    if interrupted.objects is not None:
        service.restore(interrupted.objects)
    await asyncio.to_thread(replay, interrupted, service)
    last_us = max(interrupted.last_us, service.statistics.at_us)
    restart = resumed(last_us, down_s)
    clock.go_on(restart.at_us, began_us)
    clock.autopilot_passed(restart.at_us, began_us)
    service.state_view.clear_all_but("abort", *OF_FIRE)
    service.state_view.last_id_before_restart = service.state_view.announcement_id
    service.resume(interrupted.missing, restart, clock_us(), interrupted.skips(last_us))


def replay(interrupted: InterruptedRun, service: Engine) -> None:
    """Apply the journal to the core and to all other state of the run; execute no command.

    If a line cannot be applied but may be skipped, the function starts again without the line.
    Raises JournalError.
    """
    initial = Frozen(service.snapshot_fields(), service.shared_references)
    while True:
        try:
            for event, commands in interrupted.turns(service.core.handle):
                try:
                    service.apply_history(event, commands)
                except Exception as error:
                    raise interrupted.unhandled(error) from error
        except UnhandledLineError as problem:
            interrupted.skip_line(problem)
            service.restore(restore(initial))
        else:
            return


def _check_links(context: RunContext, link_monitor: LinkMonitor, now_us: int) -> None:
    """Announce silent links, refused frames and lost datagrams, and raise or clear their alarms."""
    for name, line in link_monitor.silent_vehicles(now_us):
        context.service.announce(name, line)
        context.state_view.alarm(f"silent/{name}", f"{name}: {line}", "warning", name)
    for name, kind, words in alarms(context.links):
        if words:
            context.service.announce(name, words)
            context.state_view.alarm(f"{kind}/{name}", f"{name}: {words}", SEVERITIES[kind], name)
        else:
            context.state_view.clear_alarm(f"{kind}/{name}")
    for name, link in context.links.items():
        for line in link.new_reports():
            context.service.announce(name, line)
    context.clock.wall_passed(now_us)
    context.service.advance_fire(context.clock.now_us)
    context.service.check_estimate(now_us)
    for name, link in context.links.items():
        if link.connected:
            context.not_ready.pop(name, None)


async def _stop_ordered(context: RunContext) -> None:
    """Send the order of the setting ``on_shutdown`` to the vehicles, and wait for the replies.

    A vehicle stays in a mode that its autopilot or pilot selected (see
    ``DecisionEngine.apply_order``).
    """
    settings = context.settings
    if settings.on_shutdown == "leave" or context.scenario.burn_flown is not None:
        return
    availability = context.core.decision_engine.availability
    waiting = {name for name in context.links if availability[name].flies}
    at_us = context.clock.now_us
    context.service.submit(OrderGiven(at_us, SERVICE, "", "", settings.on_shutdown), clock_us())
    for on_it in connected(context.links):
        on_it[0].connection.flush()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(settings.shutdown_s):
            while waiting - context.service.acknowledged_by(settings.on_shutdown, at_us):
                await context.changed(context.state_view.version)


async def _fly(on_it: list[Link], context: RunContext) -> None:
    """Pass events from all vehicles on one connection to the service until cancelled."""
    connection = on_it[0].connection
    while True:
        await connection.wait()
        now_us = clock_us()
        for link in on_it:
            context.service.handle_events(link.gateway.events(now_us), now_us)
        connection.flush()
        context.ring()


def stop_on_signals(stop: asyncio.Event) -> set[signal.Signals]:
    """Set ``stop`` on SIGINT or SIGTERM; return the set to which received signals are added."""
    loop, received = asyncio.get_running_loop(), set[signal.Signals]()

    def on_signal(number: signal.Signals) -> None:
        received.add(number)
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, on_signal, number)
    return received
