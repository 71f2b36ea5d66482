"""Plays a logged flight to all interfaces of a live run: the map, MQTT, metrics."""

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from mission_service.config.service import ServiceSection
from mission_service.core.request_events import REPLAY, STATUS, RequestScope
from mission_service.errors import RequestError
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.guidance.registry import way_of
from mission_service.interfaces.control.control_client import NAME
from mission_service.interfaces.control.control_server import claimed, serve_control
from mission_service.journal.journal_file import header_of
from mission_service.live.daemon import stop_on_signals
from mission_service.live.interfaces import interfaces_of
from mission_service.replay.flights.journal_log import JOURNAL
from mission_service.replay.flights.playback import Playback
from mission_service.replay.flights.scenario_pairing import Replaying
from mission_service.replay.flights.write_once_journal import WriteOnceJournal, refuse_loss
from mission_service.requests import Replay
from mission_service.runtime.clocks import clock_us
from mission_service.runtime.engine import Progress, unshown
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.play_head import PlayHead, Speed
from mission_service.runtime.request_handler import Answer, RequestHandler, wrong
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.run_statistics import RunStatistics

TURN_US = 20_000  # longest time of playing before other tasks run
TICK_S = 0.02  # while no entry is due
SHOWN_EVERY_S = 0.2
ORDERED = "this is a replay: nothing can be ordered"


@dataclass(frozen=True)
class Show:
    """The settings of a replay and the paths of its files."""

    what: Replaying
    out: Path
    created: str  # wall-clock time as text
    settings: ServiceSection = field(default_factory=ServiceSection)
    speed: Speed = 1.0
    until_end: bool = False  # else it pauses at the end and can still be sought in
    logs: bool = False


class ReplayRequestHandler(RequestHandler):
    """Accepts requests for the play head, and no others."""

    def __init__(self, player: Playback, now_us: Callable[[], int]) -> None:
        """``now_us`` is the machine's clock."""
        super().__init__(
            lambda event: [],
            self._where_it_is,
            lambda: player.state().at_us,
            RequestScope(accepted=(REPLAY,)),
        )
        self._player = player
        self._machine_us = now_us

    def _where_it_is(self) -> dict[str, Any]:
        state = self._player.state()
        return {
            "scenario": self._player.what.scenario.name,
            "at_s": state.at_us / 1e6,
            "replay": msgspec.to_builtins(state),
        }

    def ask(self, request: Any, may_approve: bool | None = None) -> Answer:
        """Return the answer to one request; no content of a request makes it raise."""
        do = request.get("do") if isinstance(request, dict) else None
        if do != REPLAY:
            return super().ask(request) if do == STATUS else wrong(ORDERED)
        try:
            said = moved(self._player, request, self._machine_us())
        except RequestError as error:
            return wrong(str(error))
        state = self._player.state()
        return {"ok": True, "at_s": state.at_us / 1e6, "event": "Replay", "messages": said}


def moved(player: Playback, request: dict[str, Any], now_us: int) -> list[str]:
    """Execute a request and describe it; raises RequestError before anything is changed."""
    try:
        asked = msgspec.convert(request, Replay)
    except (msgspec.ValidationError, OverflowError) as error:
        raise RequestError(f"replay: {error}") from None
    head, said = player.head, []
    if asked.speed is not None:
        head.go_at(asked.speed)
        said.append(f"speed {asked.speed if asked.speed == 'max' else f'{asked.speed:g}'}")
    if asked.seek_s is not None:
        head.seek(head.begin_us + round(asked.seek_s * 1e6))
        said.append(f"goes to {asked.seek_s:g} s")
    if asked.paused is not None:
        if asked.paused:
            head.pause()
        else:
            head.resume(now_us)
        said.append("paused" if asked.paused else "goes on")
    if not said:
        raise RequestError("replay: give paused, speed or seek_s")
    player.state_view.replay_changed()
    return said


async def serve_flight(
    show: Show,
    progress: Progress = unshown,
    address: Callable[[str], None] = lambda address: None,
) -> tuple[RunStatistics, SimulatedFire]:
    """Play until SIGINT or SIGTERM, or with ``until_end`` to the end of the flight.

    ``progress`` is called five times a second; ``address`` is called with the map's URL.
    """
    what, scenario = show.what, show.what.scenario
    # Clients that receive the real vehicles must not take a replay for a current flight.
    site, settings = f"{scenario.name}-replay", show.settings.model_copy(update={"cot": None})
    async with contextlib.AsyncExitStack() as stack:
        listening = stack.enter_context(claimed(show.out / NAME))
        run_interfaces = interfaces_of(settings, show.out, site, stack, address, show.logs)
        way_of(scenario).warm_up(scenario, what.landscape)
        path = show.out / JOURNAL
        refuse_loss(path, [log.path for log in what.flight.logs])
        header = header_of(scenario, what.landscape.digest(), show.created)
        journal = WriteOnceJournal(path, header, what.logs)
        head = PlayHead(what.begin_us, what.end_us, show.speed)
        player = Playback(what, journal, head)
        stack.callback(player.close)
        context = _context_of(show, settings, player)
        stop = asyncio.Event()
        stop_on_signals(stop)
        async with asyncio.TaskGroup() as group:
            others = [group.create_task(serve_control(listening, context.request_handler))]
            others += [
                group.create_task(run_interface(context)) for run_interface in run_interfaces
            ]
            try:
                await _play(show, player, context, stop, progress)
            finally:
                context.stopping = True
                for task in others:
                    task.cancel()
    service = player.replay.service
    progress(service.record, service.world)
    return service.record, service.world


async def _play(
    show: Show, player: Playback, context: RunContext, stop: asyncio.Event, progress: Progress
) -> None:
    """Play turn by turn until it is stopped or over."""
    shown_us, before = 0, player.state()
    while not stop.is_set():
        begun_us = clock_us()
        more = player.turn(begun_us, partial(_is_over, begun_us + TURN_US))
        _shown_to(context, player)
        state = player.state()
        changed = (state.seeking, state.ended, state.jumps) != (
            before.seeking,
            before.ended,
            before.jumps,
        )
        if changed or begun_us - shown_us >= SHOWN_EVERY_S * 1e6:
            service = player.replay.service
            progress(service.record, service.world)
            if state != before and state.jumps == before.jumps:  # else it was published already
                player.state_view.replay_changed()
            shown_us, before = begun_us, state
        context.ring()
        if show.until_end and state.ended and not state.seeking:
            return
        if more:
            await asyncio.sleep(0)
        else:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), TICK_S)


def _is_over(until_us: int) -> bool:
    return clock_us() >= until_us


def _context_of(show: Show, settings: ServiceSection, player: Playback) -> RunContext:
    scenario = show.what.scenario
    service = player.replay.service
    clock = MissionClock(player.state().at_us, wall=False)
    request_handler = ReplayRequestHandler(player, clock_us)
    path = show.out / JOURNAL
    context = RunContext(
        scenario, settings, service, player.state_view, request_handler, clock, {}, path
    )
    context.replay = player.state
    player.state_view.replay_changed()
    return context


def _shown_to(context: RunContext, player: Playback) -> None:
    """Give the interfaces the replay that is shown and its time, which may go back."""
    context.service, context.state_view = player.replay.service, player.state_view
    context.clock.now_us = player.what.mission.of(player.head.at_us)
