"""Queues the commands and the parameter requests of one vehicle; runs one of each at a time."""

from collections.abc import Callable
from typing import Generic, TypeVar

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import ARM, Stack
from autopilot_bridge.vehicle.client_events import CommandFinished, ParametersFinished
from autopilot_bridge.vehicle.command_sequence import AnyStep, CommandSequence
from autopilot_bridge.vehicle.commanded_modes import CommandedModes, modes_of_step
from autopilot_bridge.vehicle.parameters import ParameterRead, ParameterSet, ParametersRead
from autopilot_bridge.vehicle.sent_commands import SentCommands

Request = ParameterRead | ParametersRead | ParameterSet
R = TypeVar("R", CommandSequence, Request)


class _RequestQueue(Generic[R]):
    """A queue of requests with ids; one request is active at a time."""

    def __init__(self) -> None:
        self._last_id = 0
        self._queue: list[tuple[int, R]] = []
        self._active = False

    def _add(self, request: R) -> int:
        self._last_id += 1
        self._queue.append((self._last_id, request))
        return self._last_id

    def start_next(self, now_us: int) -> list[Message]:
        """Start the next request if none is active."""
        if self._active or not self._queue:
            return []
        self._active = True
        return self._after_messages(self._queue[0][1].start(now_us), now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Pass a message to the active request."""
        if not self._active:
            return []
        return self._after_messages(self._queue[0][1].receive(message, now_us), now_us)

    @property
    def idle(self) -> bool:
        """Whether no request is in progress."""
        return not self._active

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None if no request is active."""
        return self._queue[0][1].next_timer() if self._active else None

    def handle_timer(self, now_us: int) -> list[Message]:
        """Run all actions due at ``now_us``."""
        if not self._active:
            return []
        return self._after_messages(self._queue[0][1].handle_timer(now_us), now_us)

    def _after_messages(self, messages: list[Message], now_us: int) -> list[Message]:
        """Return ``messages``; if the active request has ended, add those of the next request."""
        request_id, request = self._queue[0]
        if not self._reported(request_id, request, bool(messages), now_us):
            return messages
        self._queue.pop(0)
        self._active = False
        return messages + self.start_next(now_us)

    def _reported(self, request_id: int, request: R, sent: bool, now_us: int) -> bool:
        """Return whether the active request has ended, and report its end.

        ``sent`` is True if the request has just sent messages.
        """
        raise NotImplementedError


class CommandQueue(_RequestQueue[CommandSequence]):
    """The queued and active commands of one vehicle."""

    def __init__(
        self,
        timing: TransferTiming,
        report: Callable[[CommandFinished], None],
        commanded_modes: CommandedModes,
        sent: SentCommands,
    ) -> None:
        super().__init__()
        self._sent = sent
        self._commanded_modes = commanded_modes
        self._modes: dict[int, tuple[int, ...]] = {}  # commanded modes, by command id
        self._timing = timing
        self._report = report

    def enqueue(
        self,
        name: str,
        steps: tuple[AnyStep, ...],
        target: tuple[int, int],
        stack: Stack,
        urgent: bool,
        now_us: int,
        timing: TransferTiming | None = None,
    ) -> int:
        """Queue an order and return its id; an urgent order replaces all others."""
        if urgent:
            self.end_all(f"{name} replaced it", now_us, replaced=True)
        modes = tuple(mode for step in steps for mode in modes_of_step(step, stack))
        sequence = CommandSequence(
            *(name, target, steps, timing or self._timing, self._sent, stack),
            after_heartbeats=bool(modes) and timing is None,
            without_heartbeats=urgent,
        )
        command_id = self._add(sequence)
        self._modes[command_id] = modes
        return command_id

    def end_all(self, reason: str, now_us: int, replaced: bool = False) -> None:
        """End all queued and active commands; ``replaced`` if an urgent order replaces them."""
        for command_id, sequence in self._queue:
            name = sequence.name
            self._report(CommandFinished(now_us, name, False, reason, command_id, replaced))
        self._queue.clear()
        self._modes.clear()
        self._active = False

    def release_mode(self, why: str, now_us: int) -> list[Message]:
        """End commands that arm or change the mode, after a failsafe or a pilot's takeover."""
        remaining = []
        for number, (command_id, sequence) in enumerate(self._queue):
            if self._modes[command_id] or ARM in sequence.steps:
                self._active &= number > 0
                self._report(CommandFinished(now_us, sequence.name, False, why, command_id))
            else:
                remaining.append((command_id, sequence))
        self._queue = remaining
        return self.start_next(now_us)

    def _reported(self, request_id: int, request: CommandSequence, sent: bool, now_us: int) -> bool:
        if sent:
            self._commanded_modes.expect(self._modes[request_id], now_us)
        if request.outcome is None:
            return False
        del self._modes[request_id]
        self._report(CommandFinished(now_us, request.name, *request.outcome, request_id))
        return True


class ParameterQueue(_RequestQueue[Request]):
    """The queued and active parameter requests of one vehicle."""

    def __init__(
        self, timing: TransferTiming, report: Callable[[ParametersFinished], None]
    ) -> None:
        super().__init__()
        self._timing = timing
        self._report = report

    def read(self, name: str, target: tuple[int, int], stack: Stack) -> int:
        """Queue a request to read one parameter, and return its id."""
        return self._add(ParameterRead(target, name, stack.bytewise, self._timing))

    def read_all(self, target: tuple[int, int], stack: Stack) -> int:
        """Queue a request to read all parameters, and return its id."""
        return self._add(ParametersRead(target, stack.bytewise, self._timing))

    def set(self, name: str, value: float, target: tuple[int, int], stack: Stack) -> int:
        """Queue a request to set one parameter, and return its id."""
        return self._add(ParameterSet(target, name, value, stack.bytewise, self._timing))

    def _reported(self, request_id: int, request: Request, sent: bool, now_us: int) -> bool:
        if request.result is None:
            return False
        self._report(ParametersFinished(now_us, request_id, request.result))
        return True
