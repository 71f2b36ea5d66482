"""Shows the progress of a run: a bar on a terminal, plain lines elsewhere."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from firemodel.spread.fire_scheme import Fire
from mission_service.mission_time import clock_text
from mission_service.runtime.published_states import Announcement
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView

STATUS_EVERY_US = 120_000_000
SIM_STATUS_EVERY_US = 1_800_000_000


def status_lines(statistics: RunStatistics, fire: Fire) -> list[str]:
    """Return one line per vehicle: fire size, direction, reversals, uploads."""
    size = f"fire {fire.burned_ha:6.0f} ha"
    lines = []
    for name, vehicle in statistics.vehicles.items():
        accepted = vehicle.uploads["accepted"]
        other = vehicle.uploads.total() - accepted
        direction = vehicle.direction or ("in formation" if vehicle.orders else "flying")
        if not statistics.is_in_air(name):
            direction = "on the ground"
        done = f"{vehicle.reversal_count:3d} reversals"
        if vehicle.orders:
            done = f"{vehicle.orders['Orbit']:3d} orbits"
        lines.append(
            f"{size}  {name}: {direction:<13} {done}  {accepted:4d} uploads accepted"
            + (f", {other} not" if other else "")
        )
    return lines


def announced_text(line: Announcement) -> str:
    """Return the text of an announcement, with its time and vehicle."""
    return f"{clock_text(line.at_us)}  {line.vehicle}: {line.text}"


class LiveReport:
    """A printer of all announcements and, every two minutes of mission time, the status."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=quiet, highlight=False, soft_wrap=True)
        self._next_us = self._last_id = 0

    def __call__(self, state_view: StateView, fire: Fire) -> None:
        """Print new announcements and, if due, a status line."""
        for line in state_view.announcements_after(self._last_id):
            self._last_id = line.id
            style = "bold yellow" if line.level == "warning" else "cyan"
            self._console.print(announced_text(line), style=style, markup=False)
        at_us = state_view.statistics.at_us
        if at_us >= self._next_us:
            self._next_us = at_us + STATUS_EVERY_US
            for status in status_lines(state_view.statistics, fire):
                self._console.print(f"{clock_text(at_us)}  {status}", markup=False)
        sys.stdout.flush()


class SimProgress:
    """The progress of a simulation: a bar on a terminal, a line every half hour elsewhere."""

    def __init__(self, name: str, duration_s: float, quiet: bool) -> None:
        self._console = Console(stderr=quiet, highlight=False, soft_wrap=True)
        self._next_us = self._last_id = 0
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[status]}"),
            TimeElapsedColumn(),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task(name, total=duration_s, status="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()

    def __call__(self, state_view: StateView, fire: Fire) -> None:
        """Print new warnings; update the bar, or print a line if one is due."""
        for line in state_view.announcements_after(self._last_id):
            self._last_id = line.id
            if line.level == "warning":
                self._console.print(announced_text(line))
        at_us, lines = state_view.statistics.at_us, status_lines(state_view.statistics, fire)
        if self._console.is_terminal:
            self._bar.update(self._task, completed=at_us / 1e6, status=lines[0])
        elif at_us >= self._next_us:
            self._next_us = at_us + SIM_STATUS_EVERY_US
            for status in lines:
                self._console.print(f"{clock_text(at_us)}  {status}", markup=False)


@contextmanager
def fire_progress(name: str, from_s: float, to_s: float) -> Iterator[Callable[[float], None]]:
    """Show a bar on a terminal, and yield a function that receives the simulated time in s."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(name, total=to_s - from_s)
        yield lambda time_s: bar.update(task, completed=time_s - from_s)
