"""Read the state of an incident from a journal, by applying its events to the estimate."""

import math
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from firemodel.arrays import Floats
from mission_service.commands import Announce, AnyCommand
from mission_service.core.core import Core
from mission_service.errors import RequestError
from mission_service.events import AnyEvent, NoteAdded
from mission_service.fire.burn_forecast import arrival_times_s, burn_probability
from mission_service.fire.estimated_fire import EstimatedFire
from mission_service.fire.forecast import Arrival, forecast_once
from mission_service.journal.reader import JournalReader
from mission_service.operator_lines import operator_line
from mission_service.products.heat import ObservedHeat
from mission_service.products.incident import ImageTimes, Incident, InterpreterLine
from mission_service.runtime.observation_sources import ObservationSources
from mission_service.runtime.run_statistics import RunStatistics

# The ensemble of the forecast starts from the estimate one to two hours before the products,
# because images from more hours take too long to process.
ENSEMBLE_EVERY_S = 3600.0
EARLIEST_YEAR, LATEST_YEAR = 1900, 2999  # for the date of mission time 0


def incident_in(
    path: Path, at_s: float | None, forecast_s: float, time_zero: datetime | None
) -> Incident:
    """Return the incident in a journal at the given mission time.

    Args:
        path: The journal; its run need not have ended.
        at_s: The mission time; None for the end of the journal.
        forecast_s: The length of the forecast; 0 for none.
        time_zero: The calendar time of mission time 0, which replaces the scenario's.

    Raises:
        JournalError: The journal cannot be read, or its landscape is not available.
        RequestError: The calendar time is unknown or out of range, or ``at_s`` is outside the
            journal.
    """
    recorded = JournalReader(path)
    zero = time_zero or recorded.scenario.time_zero
    if zero is None:
        raise RequestError(
            f"{path}: the scenario has no time_zero, and maps, perimeters and KMZ need calendar "
            "times; add --time-zero, the calendar time of mission time 0, such as "
            "2026-08-01T14:00-06:00"
        )
    if not EARLIEST_YEAR <= zero.year <= LATEST_YEAR:
        raise RequestError(
            f"{path}: the year of time zero {zero.isoformat()} must be from {EARLIEST_YEAR} to "
            f"{LATEST_YEAR}"
        )
    return _Replay(recorded).incident(at_s, forecast_s, zero)


class _Replay:
    """One pass over a journal."""

    def __init__(self, recorded: JournalReader) -> None:
        self._recorded = recorded
        self._scenario, self._landscape = recorded.scenario, recorded.landscape
        start_us = round(self._scenario.start_s * 1e6)
        sources = ObservationSources(self._landscape, self._scenario.estimate.sensors, start_us)
        names = tuple(each.name for each in self._scenario.vehicles)
        self._record = RunStatistics(names, start_us, sources)
        self._estimate = recorded.estimate()
        # Only the core of a burn has the estimate of the burn.
        self._core: Core | None = recorded.core() if self._scenario.burn_flown else None
        self._heat = ObservedHeat(self._landscape)
        self._log: list[InterpreterLine] = []
        self._notes: list[NoteAdded] = []
        self._ensemble_due_us = start_us + round(ENSEMBLE_EVERY_S * 1e6)

    def incident(self, at_s: float | None, forecast_s: float, time_zero: datetime) -> Incident:
        """Return the incident at the given mission time, or at the end of the journal (None)."""
        if at_s is not None and at_s < self._scenario.start_s:
            raise RequestError(
                f"{self._recorded.path}: begins at mission time {self._scenario.start_s:g} s, "
                f"after --at {at_s:g}; specify a later time"
            )
        until_us = None if at_s is None else round(at_s * 1e6)
        latest_us = -math.inf
        for event, commands in self._steps():
            if until_us is not None and event.at_us > until_us:
                latest_us = until_us
                break
            latest_us = max(latest_us, event.at_us)
            self._apply(event, commands)
        if not math.isfinite(latest_us):
            raise RequestError(f"{self._recorded.path}: the journal has no events")
        if until_us is not None and latest_us < until_us:
            raise RequestError(
                f"{self._recorded.path}: ends at mission time {latest_us / 1e6:.0f} s, before "
                f"--at {at_s:g}; omit --at for the end"
            )
        return self._incident(int(latest_us), forecast_s, time_zero)

    def _steps(self) -> Iterator[tuple[AnyEvent, list[AnyCommand]]]:
        """Yield each event with the commands that follow it."""
        event: AnyEvent | None = None
        commands: list[AnyCommand] = []
        for _, entry in self._recorded.intact():
            if not entry.is_event:
                commands.append(entry.content)  # type: ignore[arg-type]
                continue
            if event is not None:
                yield event, commands
            event, commands = entry.content, []  # type: ignore[assignment]
        if event is not None:
            yield event, commands

    def _apply(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        if self._core is not None:
            self._core.handle(event)
        self._estimate.apply_history(event)
        for command in commands:
            self._estimate.on_command(command)
        self._record.apply(event, commands)
        self._heat.apply(event)
        if isinstance(event, NoteAdded):
            self._notes.append(event)
        if line := operator_line(event):
            self._log.append(InterpreterLine(event.at_us / 1e6, line))
        for command in commands:
            if isinstance(command, Announce):
                vehicle = f"{command.vehicle}: " if command.vehicle else ""
                self._log.append(InterpreterLine(event.at_us / 1e6, f"{vehicle}{command.text}"))
        if event.at_us >= self._ensemble_due_us:
            self._ensemble_due_us = event.at_us + round(ENSEMBLE_EVERY_S * 1e6)
            self._estimate.advance(event.at_us)
            self._estimate.ensemble.forget_before_mark(self._estimate.fire)

    def _incident(self, at_us: int, forecast_s: float, time_zero: datetime) -> Incident:
        at_s = at_us / 1e6
        self._estimate.advance(at_us)
        of_burn = self._estimated_fire()
        arrival, probability = self._forecast(of_burn, at_s, forecast_s)
        heat = self._heat.heat(arrival.arrival_s, at_s)
        images = ImageTimes(self._record.observations, self._heat.first_s, self._heat.last_s)
        return Incident(
            name=self._scenario.name,
            landscape=self._landscape,
            at_s=at_s,
            time_zero=time_zero,
            prescribed=of_burn is not None,
            arrival=arrival,
            forecast_s=forecast_s,
            probability=probability,
            fire=None if of_burn is not None else self._estimate.fire,
            heat=heat,
            record=self._record,
            images=images,
            log=self._log,
            notes=self._notes,
            run=self._recorded.path.parent,
        )

    def _forecast(
        self, of_burn: EstimatedFire | None, at_s: float, for_s: float
    ) -> tuple[Arrival, Floats | None]:
        """Return the arrival times, and the burn probability at the end of the forecast."""
        if of_burn is None:
            return forecast_once(self._estimate, for_s)
        simulation, end_s = of_burn.simulation, at_s + for_s
        arrival_s = arrival_times_s(simulation, self._landscape)
        probability = None
        if for_s:
            probability = burn_probability(simulation, self._landscape, arrival_s, end_s)
            probability[arrival_s <= at_s] = 1.0
        return Arrival(at_s, end_s, arrival_s, 0), probability

    def _estimated_fire(self) -> EstimatedFire | None:
        return None if self._core is None else self._core.guidance.estimated_fire
