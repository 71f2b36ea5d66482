"""Plays a logged flight on all interfaces of a live run: the map, MQTT, metrics."""

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from firemodel.spread.fire_scheme import Fire
from mission_service.config.rule_lookup import faults_of
from mission_service.config.service_section import ServiceSection
from mission_service.core.request_events import REPLAY, STATUS, RequestScope
from mission_service.errors import RequestError
from mission_service.guidance.registry import way_of
from mission_service.interfaces.control.control_client import NAME
from mission_service.interfaces.control.control_server import claimed, serve_control
from mission_service.journal.journal_file import header_of
from mission_service.live.daemon import stop_on_signals
from mission_service.live.interface_setup import interfaces_of
from mission_service.replay.flights.journal_log import JOURNAL
from mission_service.replay.flights.playback import Playback
from mission_service.replay.flights.scenario_pairing import Pairing
from mission_service.replay.flights.write_once_journal import WriteOnceJournal, refuse_loss
from mission_service.requests import Replay
from mission_service.runtime.clocks import clock_us
from mission_service.runtime.engine import Progress, unshown
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.play_head import PlayHead, Speed
from mission_service.runtime.request_handler import Answer, RequestHandler, wrong
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.value_errors import in_words

TURN_US = 20_000  # duration of a turn, after which other tasks run
TICK_S = 0.02  # interval of turns while no entry is due
SHOWN_EVERY_S = 0.2
NO_ORDERS = "this is a replay; orders are refused"


@dataclass(frozen=True)
class ReplayRun:
    """The settings of a replay and the paths of its files."""

    pairing: Pairing
    out: Path
    created: str  # wall-clock time as text
    settings: ServiceSection = field(default_factory=ServiceSection)
    speed: Speed = 1.0
    until_end: bool = False  # exit at the end, instead of a pause
    logs: bool = False


class ReplayRequestHandler(RequestHandler):
    """A request handler that accepts only requests for the play head."""

    def __init__(self, player: Playback, now_us: Callable[[], int]) -> None:
        """Control the playback ``player``; ``now_us`` returns the time of the machine's clock."""
        scope = RequestScope(accepted=(REPLAY,))
        super().__init__(lambda event: [], self._state, lambda: player.state().at_us, scope)
        self._player = player
        self._machine_us = now_us

    def _state(self) -> dict[str, Any]:
        state = self._player.state()
        return {
            "scenario": self._player.pairing.scenario.name,
            "at_s": state.at_us / 1e6,
            "replay": msgspec.to_builtins(state),
        }

    def ask(self, request: Any, may_approve: bool | None = None) -> Answer:
        """Return the reply to one request; no content of a request raises an exception."""
        do = request.get("do") if isinstance(request, dict) else None
        if do != REPLAY:
            return super().ask(request) if do == STATUS else wrong(NO_ORDERS)
        try:
            messages = control(self._player, request, self._machine_us())
        except RequestError as error:
            return wrong(str(error))
        at_s = self._player.state().at_us / 1e6
        return {"ok": True, "at_s": at_s, "event": "Replay", "messages": messages}

    def ask_or_wait(self, request: Any, may_approve: bool | None = None, role: str = "") -> Answer:
        """Return the reply of ``ask``."""
        return self.ask(request, may_approve)


def control(player: Playback, request: dict[str, Any], now_us: int) -> list[str]:
    """Execute a request and return its description. Raises RequestError before any change."""
    try:
        values = msgspec.convert(request, Replay)
    except (msgspec.ValidationError, OverflowError) as error:
        raise RequestError(f"replay: {in_words(error, Replay, request)}") from None
    head, messages = player.head, []
    if values.speed is not None:
        head.go_at(values.speed)
        messages.append(f"speed {values.speed if values.speed == 'max' else f'{values.speed:g}'}")
    if values.seek_s is not None:
        head.seek(head.begin_us + round(values.seek_s * 1e6))
        messages.append(f"seeks to {values.seek_s:g} s")
    if values.paused is not None:
        if values.paused:
            head.pause()
        else:
            head.resume(now_us)
        messages.append("paused" if values.paused else "continues")
    if not messages:
        raise RequestError("replay: specify paused, speed or seek_s")
    player.state_view.replay_changed()
    return messages


async def serve_flight(
    run: ReplayRun,
    progress: Progress = unshown,
    address: Callable[[str], None] = lambda address: None,
) -> tuple[RunStatistics, Fire]:
    """Play until SIGINT or SIGTERM, or with ``until_end`` until the end of the flight.

    ``progress`` is called five times a second; ``address`` receives the map's URL.
    """
    pairing, scenario = run.pairing, run.pairing.scenario
    # A replay publishes to other topics, so that clients can distinguish it from a live flight.
    site, settings = f"{scenario.name}-replay", run.settings.model_copy(update={"cot": None})
    async with contextlib.AsyncExitStack() as stack:
        listening = stack.enter_context(claimed(run.out / NAME))
        run_interfaces = interfaces_of(settings, run.out, site, stack, address, run.logs)
        with faults_of(scenario.planner.rule):
            way_of(scenario).warm_up(scenario, pairing.landscape)
        path = run.out / JOURNAL
        refuse_loss(path, [log.path for log in pairing.flight.logs])
        header = header_of(scenario, pairing.landscape.digest(), run.created)
        journal = WriteOnceJournal(path, header, pairing.logs)
        head = PlayHead(pairing.begin_us, pairing.end_us, run.speed)
        player = Playback(pairing, journal, head)
        stack.callback(player.close)
        context = _context_of(run, settings, player)
        stack.callback(context.close)
        stop = asyncio.Event()
        stop_on_signals(stop)
        async with asyncio.TaskGroup() as group:
            others = [group.create_task(serve_control(listening, context.request_handler))]
            others += [
                group.create_task(run_interface(context)) for run_interface in run_interfaces
            ]
            try:
                await _play(run, player, context, stop, progress)
            finally:
                context.stopping = True
                for task in others:
                    task.cancel()
    service = player.replay.service
    progress(service.state_view, service.estimate.fire)
    return service.statistics, service.estimate.fire


async def _play(
    run: ReplayRun, player: Playback, context: RunContext, stop: asyncio.Event, progress: Progress
) -> None:
    """Play turn by turn until ``stop`` is set, or with ``until_end`` until the end."""
    shown_us, before = 0, player.state()
    while not stop.is_set():
        begun_us = clock_us()
        more = player.turn(begun_us, partial(_is_over, begun_us + TURN_US))
        _update(context, player)
        state = player.state()
        changed = any(
            getattr(state, name) != getattr(before, name) for name in ("seeking", "ended", "jumps")
        )
        if changed or begun_us - shown_us >= SHOWN_EVERY_S * 1e6:
            progress(player.state_view, player.replay.service.estimate.fire)
            if state != before and state.jumps == before.jumps:  # a jump publishes the state itself
                player.state_view.replay_changed()
            shown_us, before = begun_us, state
        context.ring()
        if run.until_end and state.ended and not state.seeking:
            return
        if more:
            await asyncio.sleep(0)
        else:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), TICK_S)


def _is_over(until_us: int) -> bool:
    return clock_us() >= until_us


def _context_of(run: ReplayRun, settings: ServiceSection, player: Playback) -> RunContext:
    scenario = run.pairing.scenario
    service = player.replay.service
    clock = MissionClock(player.state().at_us, wall=False)
    request_handler = ReplayRequestHandler(player, clock_us)
    path = run.out / JOURNAL
    context = RunContext(scenario, settings, service, request_handler, clock, {}, path)
    context.replay = player.state
    player.state_view.replay_changed()
    return context


def _update(context: RunContext, player: Playback) -> None:
    """Set the interfaces' context to the replay that is shown, with the play head as the clock."""
    context.service = player.replay.service
    context.clock.now_us = player.pairing.mission.of(player.head.at_us)
