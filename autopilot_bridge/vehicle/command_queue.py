"""Commands and parameter requests of one vehicle, one of each at a time, sans-IO."""

from collections.abc import Callable

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import ARM, Stack
from autopilot_bridge.vehicle.client_events import CommandFinished, ParametersFinished
from autopilot_bridge.vehicle.command_sequence import AnyStep, CommandSequence
from autopilot_bridge.vehicle.commanded_modes import CommandedModes, modes_of_step
from autopilot_bridge.vehicle.parameters import ParameterRead, ParameterSet, ParametersRead

Request = ParameterRead | ParametersRead | ParameterSet


class CommandQueue:
    """Orders waiting and under way."""

    def __init__(
        self,
        own: tuple[int, int],
        timing: TransferTiming,
        report: Callable[[CommandFinished], None],
        commanded_modes: CommandedModes,
    ) -> None:
        self._own = own
        self._commanded_modes = commanded_modes
        self._modes: dict[int, tuple[int, ...]] = {}  # that each leads to, by its id
        self._timing = timing
        self._report = report
        self._last_id = 0
        self._queue: list[tuple[int, CommandSequence]] = []
        self._active = False

    def add(
        self,
        name: str,
        steps: tuple[AnyStep, ...],
        target: tuple[int, int],
        stack: Stack,
        urgent: bool,
        now_us: int,
        timing: TransferTiming | None = None,
    ) -> int:
        """Queue an order; an urgent one takes the place of all others."""
        if urgent:
            self.end_all(f"{name} took its place", now_us)
        self._last_id += 1
        modes = tuple(mode for step in steps for mode in modes_of_step(step, stack))
        sequence = CommandSequence(
            *(name, self._own, target, steps, timing or self._timing),
            bytewise=stack.name == "px4",
            behind_heartbeats=bool(modes) and timing is None,
            insists=urgent,
        )
        self._modes[self._last_id] = modes
        self._queue.append((self._last_id, sequence))
        return self._last_id

    def end_all(self, reason: str, now_us: int) -> None:
        """End what waits and what is under way."""
        for command_id, sequence in self._queue:
            self._report(CommandFinished(now_us, sequence.name, False, reason, command_id))
        self._queue.clear()
        self._modes.clear()
        self._active = False

    def release_mode(self, why: str, now_us: int) -> list[Message]:
        """Autopilot or pilot took over: end commands that would change the mode or arm."""
        kept = []
        for number, (command_id, sequence) in enumerate(self._queue):
            if self._modes[command_id] or ARM in sequence.steps:
                self._active &= number > 0
                self._report(CommandFinished(now_us, sequence.name, False, why, command_id))
            else:
                kept.append((command_id, sequence))
        self._queue = kept
        return self.start_next(now_us)

    def _sent(self, messages: list[Message], now_us: int) -> list[Message]:
        """Note which modes were commanded, if anything was sent."""
        if messages and self._queue:
            self._commanded_modes.ask(self._modes[self._queue[0][0]], now_us)
        return messages

    def start_next(self, now_us: int) -> list[Message]:
        """Begin what waits if nothing is under way."""
        if self._active or not self._queue:
            return []
        self._active = True
        messages = self._sent(self._queue[0][1].start(now_us), now_us)
        return messages + self._after(now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Hand a message to what is under way."""
        if not self._active:
            return []
        messages = self._sent(self._queue[0][1].receive(message, now_us), now_us)
        return messages + self._after(now_us)

    def next_timer(self) -> int | None:
        """When to call ``handle_timer``."""
        return self._queue[0][1].next_timer() if self._active else None

    def handle_timer(self, now_us: int) -> list[Message]:
        """Do what is due."""
        if not self._active:
            return []
        messages = self._sent(self._queue[0][1].handle_timer(now_us), now_us)
        return messages + self._after(now_us)

    def _after(self, now_us: int) -> list[Message]:
        outcome = self._queue[0][1].outcome
        if outcome is None:
            return []
        command_id, ended = self._queue.pop(0)
        del self._modes[command_id]
        self._active = False
        self._report(CommandFinished(now_us, ended.name, *outcome, command_id))
        return self.start_next(now_us)


class ParameterQueue:
    """Reading and setting of parameters, waiting and under way."""

    def __init__(
        self, timing: TransferTiming, report: Callable[[ParametersFinished], None]
    ) -> None:
        self._timing = timing
        self._report = report
        self._last_id = 0
        self._queue: list[tuple[int, Request]] = []
        self._active = False

    def read(self, name: str, target: tuple[int, int], stack: Stack) -> int:
        """Queue the reading of one."""
        return self._add(ParameterRead(target, name, _bytewise(stack), self._timing))

    def read_all(self, target: tuple[int, int], stack: Stack) -> int:
        """Queue the reading of all."""
        return self._add(ParametersRead(target, _bytewise(stack), self._timing))

    def set(self, name: str, value: float, target: tuple[int, int], stack: Stack) -> int:
        """Queue the setting of one."""
        return self._add(ParameterSet(target, name, value, _bytewise(stack), self._timing))

    def _add(self, request: Request) -> int:
        self._last_id += 1
        self._queue.append((self._last_id, request))
        return self._last_id

    def start_next(self, now_us: int) -> list[Message]:
        """Begin what waits if nothing is under way."""
        if self._active or not self._queue:
            return []
        self._active = True
        return self._queue[0][1].start(now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Hand a message to what is under way."""
        if not self._active:
            return []
        messages = self._queue[0][1].receive(message, now_us)
        return messages + self._after(now_us)

    def next_timer(self) -> int | None:
        """When to call ``handle_timer``."""
        return self._queue[0][1].next_timer() if self._active else None

    def handle_timer(self, now_us: int) -> list[Message]:
        """Do what is due."""
        if not self._active:
            return []
        messages = self._queue[0][1].handle_timer(now_us)
        return messages + self._after(now_us)

    def _after(self, now_us: int) -> list[Message]:
        result = self._queue[0][1].result
        if result is None:
            return []
        request_id, _ = self._queue.pop(0)
        self._active = False
        self._report(ParametersFinished(now_us, request_id, result))
        return self.start_next(now_us)


def _bytewise(stack: Stack) -> bool:
    return stack.name == "px4"
