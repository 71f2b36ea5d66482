"""The live service: the links of the vehicles and the interfaces, in one TaskGroup."""

import asyncio
import contextlib
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.service import ServiceSection
from mission_service.config.shared_links import sharing
from mission_service.core.core import Core
from mission_service.errors import UnhandledLineError
from mission_service.events import SERVICE, OrderGiven
from mission_service.fire.setup import landscape_of
from mission_service.fire.simulated_fire import SimulatedFire, world_of
from mission_service.guidance.registry import way_of
from mission_service.interfaces.control.control_client import NAME
from mission_service.interfaces.control.control_server import claimed, serve_control
from mission_service.interfaces.mqtt.peer_exchange import Channel, PeerExchange
from mission_service.journal.journal_file import Journal, header_of
from mission_service.journal.private_files import refuse_links, written_by_others
from mission_service.journal.recovery import Unfinished, resumed, set_aside, unfinished
from mission_service.journal.snapshot import Frozen, Known, thawed
from mission_service.live.interfaces import RunInterface, interfaces_of, request_handler_of
from mission_service.runtime.clocks import clock_us, last_written_s, wall_us
from mission_service.runtime.engine import Engine, Progress, unheard, unshown
from mission_service.runtime.freed_memory import give_back_freed
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.health_monitor import HealthMonitor
from mission_service.runtime.journal_retention import Keeping
from mission_service.runtime.peer_listener import PeerListener
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView
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
    goes_on: bool = True  # resume an interrupted run
    skip_unreadable: bool = False  # resume without unreadable journal lines

    @property
    def out(self) -> Path:
        """The folder of the run."""
        return self.journal_path.parent


def unwatched() -> None:
    """The default of ``watch``: no check."""


def untold(address: str) -> None:
    """The default of ``address``: no output."""


async def serve(
    run: Run,
    progress: Progress = unshown,
    watch: Callable[[], None] = unwatched,
    address: Callable[[str], None] = untold,
) -> tuple[RunStatistics, SimulatedFire]:
    """Run until the end of the scenario, SIGINT or SIGTERM; returns the figures and the fire.

    Vehicles keep the mission on board, which ends in a loiter, unless ``on_shutdown`` of the
    settings orders another end. ``progress`` and ``watch`` are called five times a second;
    ``watch`` may raise to end the run, for example because a child process died. ``address``
    receives the address of the map; it may contain a token and must not be logged.

    Raises ScenarioError for vehicles that cannot share their link.
    """
    give_back_freed()
    scenario = run.scenario
    sharing(scenario.flown)  # checked before a link is opened
    clock = MissionClock(round(scenario.start_s * 1e6), wall=scenario.clock == "wall")
    latest_us = round(scenario.duration_s * 1e6)
    landscape = landscape_of(scenario)
    way_of(scenario).warm_up(scenario, landscape)
    announcements = _Announcements()
    async with contextlib.AsyncExitStack() as stack:
        # Ports and socket first: if one is in use, the journal of an earlier run is not touched.
        listening = stack.enter_context(claimed(run.out / NAME))
        run_interfaces = interfaces_of(
            run.settings, run.out, scenario.name, stack, address, run.logs
        )
        links = await open_links(
            stack, scenario, landscape, clock, clock_us, wall_us, run.tlog_path, announcements.add
        )
        exchange = None
        if run.channel is not None:
            gateways = {name: link.gateway for name, link in links.items()}
            exchange = PeerExchange(run.channel, gateways, latest_us)
        service = await _engine_of(run, landscape, clock, links, exchange, announcements, stack)
        keeping = Keeping(service, service.shared_references, run.settings.journal)
        context = _context_of(run, service, clock, links)
        context.gauges["state_seconds"] = lambda: keeping.took_s
        check = _Check(context, watch, progress)
        stop = asyncio.Event()
        signals = stop_on_signals(stop)
        beside: list[RunInterface] = [
            *(partial(_fly, on_it) for on_it in connected(links)),
            lambda context: serve_control(listening, context.request_handler),
            *run_interfaces,
            lambda context: keeping.run(clock),
        ]
        is_over = await _run_tasks(context, beside, exchange, check, stop, latest_us)
        # After SIGTERM, a supervisor's stop, the next start resumes the run.
        by_hand = signal.SIGTERM not in signals
        if is_over or (by_hand and service.core.guidance.status()["complete"]):
            service.recording.journal.end()
    service.world.advance(clock.now_us)
    progress(service.state_view, service.world)
    return service.statistics, service.world


async def _run_tasks(
    context: RunContext,
    beside: list[RunInterface],
    exchange: PeerExchange | None,
    check: Callable[[], None],
    stop: asyncio.Event,
    latest_us: int,
) -> bool:
    """Run until ``stop`` is set or mission time is ``latest_us``, then end all tasks.

    Returns whether the mission time is over.
    """
    clock = context.clock
    async with asyncio.TaskGroup() as group:
        tasks = []
        if exchange is not None:
            listener = PeerListener(context.service, clock, clock_us)
            tasks.append(group.create_task(exchange.run(listener)))
            await exchange.join()
        tasks += [group.create_task(run_interface(context)) for run_interface in beside]
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
    """Announcements of links and journal, kept until the engine exists."""

    def __init__(self) -> None:
        self.engine: Engine | None = None
        self._early: list[tuple[str, str]] = []

    def add(self, vehicle: str, text: str) -> None:
        """Announce a text about a vehicle."""
        if self.engine is None:
            self._early.append((vehicle, text))
        else:
            self.engine.announce(vehicle, text)

    def add_early(self) -> None:
        """Announce what came before the engine."""
        for vehicle, text in self._early:
            self.add(vehicle, text)


async def _engine_of(
    run: Run,
    landscape: Landscape,
    clock: MissionClock,
    links: dict[str, Link],
    exchange: PeerExchange | None,
    announcements: _Announcements,
    stack: contextlib.AsyncExitStack,
) -> Engine:
    """The engine of a new or resumed run; ``stack`` closes its journal."""
    known = Known(run.scenario, landscape)
    refuse_links(run.out)
    cut_off = None
    if run.goes_on:
        cut_off = unfinished(run.journal_path, known, run.scenario, run.skip_unreadable)
    down_from_s = last_written_s(run.journal_path) if cut_off else 0.0
    journal = _journal_of(run, known, cut_off, announcements.add)
    stack.callback(journal.close)
    gateways = {name: link.gateway for name, link in links.items()}
    say = unheard if exchange is None else exchange.broadcast
    core, world, state_view = _begun(run.scenario, landscape, clock, cut_off)
    service = Engine(run.scenario, core, world, journal, state_view, gateways, say)
    announcements.engine = service
    if cut_off is not None:
        await _go_on(cut_off, service, clock, wall_us() / 1e6 - down_from_s)
        service.announce("service", f"resumes the run of {run.journal_path}; approvals are void")
        for why in cut_off.skips_now.values():
            service.announce("service", f"journal line skipped: {why}")
    announcements.add_early()
    return service


def _context_of(
    run: Run, service: Engine, clock: MissionClock, links: dict[str, Link]
) -> RunContext:
    """The context of the interfaces; it is not ready before each vehicle has a heartbeat."""
    context = RunContext(
        run.scenario,
        run.settings,
        service,
        request_handler_of(run.scenario, service, clock, links),
        clock,
        links,
        run.journal_path,
    )
    context.not_ready = dict.fromkeys(links, "no heartbeat yet")
    return context


class _Check:
    """What the daemon checks and shows five times a second."""

    def __init__(self, context: RunContext, watch: Callable[[], None], progress: Progress) -> None:
        self._context = context
        self._watch = watch
        self._progress = progress
        self._links = LinkMonitor(context.links, clock_us())
        separation_m = context.scenario.mission.separation_m
        self._health = HealthMonitor(context.state_view, separation_m, round(STATUS_EVERY_S * 1e6))

    def __call__(self) -> None:
        """Raise the engine's defect if it has one."""
        context = self._context
        self._watch()
        if context.service.defect is not None:
            raise context.service.defect
        _look_around(context, self._health, self._links)
        self._progress(context.state_view, context.world)
        context.ring()


def _journal_of(
    run: Run, known: Known, cut_off: Unfinished | None, report: Callable[[str, str], None]
) -> Journal:
    """The journal of the resumed run, or a new one; an earlier run's journal is renamed."""
    kept = None if cut_off else set_aside(run.journal_path)
    if kept is not None:
        report(
            "service", f"the journal of an earlier run is kept as {kept.name}; this is a new one"
        )
    if written_by_others(run.out):
        report(
            "service", f"other users of this machine can write in {run.out}; chmod 700 {run.out}"
        )
    rest = None if cut_off is None else cut_off.rest()
    header = header_of(run.scenario, known.landscape, run.created)
    return Journal(run.journal_path, header, durable=True, rest=rest)


def _load_for_corrections() -> None:
    """Import and compile the modules of the first correction of the fire: this takes long."""
    for name in ("firemodel.assimilation.corrected_cells", "contourpy", "rasterio.features"):
        import_module(name)
    from firemodel.assimilation.corrected_cells import warm_up

    warm_up()


def _begun(
    scenario: Scenario, landscape: Landscape, clock: MissionClock, cut_off: Unfinished | None
) -> tuple[Core, SimulatedFire, StateView]:
    """Core, fire and state view: new, or from the latest snapshot of a resumed run."""
    if cut_off is not None and cut_off.objects is not None:
        kept = cut_off.objects
        return kept["core"], kept["fire"].world, kept["state_view"]
    world = world_of(scenario, landscape)
    world.advance(clock.now_us)
    return Core(scenario, landscape), world, StateView(scenario, landscape, clock.now_us)


async def _go_on(cut_off: Unfinished, service: Engine, clock: MissionClock, down_s: float) -> None:
    """Resume an interrupted run: apply its journal in a thread, while links stay open."""
    began_us = clock_us()
    if cut_off.objects is not None:
        service.restore(cut_off.objects)
    await asyncio.to_thread(replay, cut_off, service)
    last_us = max(cut_off.last_us, service.statistics.at_us)
    announcements = resumed(last_us, down_s)
    clock.go_on(announcements.at_us, began_us)
    service.state_view.clear_all_but("abort")
    service.state_view.last_id_before_restart = service.state_view.announcement_id
    service.resume(cut_off.missing, announcements, clock_us(), cut_off.skips(last_us))


def replay(cut_off: Unfinished, service: Engine) -> None:
    """Apply the journal to a fresh core and all other folds; no command is carried out.

    Starts over without a line that cannot be applied, if it may be skipped. Raises JournalError.
    """
    begun = Frozen(service.snapshot_fields(), service.shared_references)
    while True:
        try:
            for event, commands in cut_off.turns(service.core.handle):
                try:
                    service.apply_history(event, commands)
                except Exception as error:
                    raise cut_off.unhandled(error) from error
        except UnhandledLineError as problem:
            cut_off.skip_line(problem)
            service.restore(thawed(begun))
        else:
            return


def _refusals(links: dict[str, Link]) -> list[tuple[str, str]]:
    """Frames that links refused since the last call: pairs of vehicle and announcement."""
    return [
        (name, line)
        for name, link in links.items()
        for line in link.refusals.announcements(
            link.connection.counts, link.connection.receives_signed
        )
    ]


def _look_around(context: RunContext, health_monitor: HealthMonitor, silence: LinkMonitor) -> None:
    """Check for silent links, refused frames and other alarms, and advance the fire."""
    now_us = clock_us()
    context.service.clock_read(now_us)
    health_monitor.check(now_us)
    for name, line in silence.announcements(now_us):
        context.service.announce(name, line)
        context.state_view.alarm(f"silent/{name}", f"{name}: {line}", "warning", name)
    for name, kind, words in alarms(context.links):
        if words:
            context.service.announce(name, words)
            context.state_view.alarm(f"{kind}/{name}", f"{name}: {words}", SEVERITIES[kind], name)
        else:
            context.state_view.clear(f"{kind}/{name}")
    for name, line in _refusals(context.links):
        context.service.announce(name, line)
    context.clock.wall_passed(now_us)
    context.world.advance(context.clock.now_us)
    for name in [
        name
        for name in context.not_ready
        if name in context.links and context.links[name].connected
    ]:
        del context.not_ready[name]


async def _stop_ordered(context: RunContext) -> None:
    """Send the order that ``on_shutdown`` sets to the vehicles and wait for their answers.

    A vehicle in a mode that its autopilot or pilot selected stays in it (see
    ``DecisionEngine.ordered``).
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
    """Pass the events of all vehicles of one connection to the service until cancelled."""
    connection = on_it[0].connection
    while True:
        await connection.wait()
        now_us = clock_us()
        for link in on_it:
            context.service.handle_events(link.gateway.events(now_us), now_us)
        connection.flush()
        context.ring()


def stop_on_signals(stop: asyncio.Event) -> set[signal.Signals]:
    """Set ``stop`` on SIGINT or SIGTERM; returns a set, to which received signals are added."""
    loop, come = asyncio.get_running_loop(), set[signal.Signals]()

    def comes(number: signal.Signals) -> None:
        come.add(number)
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, comes, number)
    return come
