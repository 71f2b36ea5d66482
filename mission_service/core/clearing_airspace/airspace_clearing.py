"""Clears the airspace at an operator's request: all vehicles land, or leave a volume. Pure.

Vehicles land one after the other at each field (``landings.py``): first those already landing, then
those with the least time left on task; the others hold until their turn. Vehicles leave a volume
all at once (``airspace_guard.py``). A vehicle that cannot be commanded is reported at once, and no
other vehicle waits for it. It is ordered as soon as it can be commanded again, unless all vehicles
are out or an operator has cancelled the request. Each order is an event ``OrderGiven`` by that
operator (``OrderByService``), and passes the same checks as any order.
"""

import math

from mission_service import events
from mission_service.airspace.volumes import Volume
from mission_service.commands import (
    CLEARED,
    REJECTED,
    Announce,
    AnyCommand,
    ClearAlarm,
    ClearedVehicle,
    ClearingOutcome,
    ClearingPhase,
    OrderByService,
    RaiseAlarm,
    ShowClearing,
)
from mission_service.core.airspace_guard import AirspaceGuard
from mission_service.core.clearing_airspace.clearing_phases import (
    SILENT,
    landing_phase,
    lands_by_itself,
    longest_answer_s,
    on_ground,
    unanswered,
    unreachable,
    waits_for_order,
)
from mission_service.core.clearing_airspace.clearing_predictions import ClearingPredictions
from mission_service.core.landings import Landings
from mission_service.mission_time import clock_text
from mission_service.vehicles.clearing_state import ClearingProgress, ClearingState
from mission_service.vehicles.vehicle_state import Vehicle, announce

CLEARING = "clearing"  # kind of the alarm
EVERY_S = 0.5  # interval of the checks between events that may change a phase
AGAIN_S = 10.0  # until a vehicle that could not land is ordered to land again
CONNECTS_S = 10.0  # time after a restart in which a link may be down
SHOWN_CHANGE_S = 5.0  # smaller changes in the predictions are not shown

Phase = tuple[ClearingPhase, str, list[AnyCommand]]


class AirspaceClearing:
    """The part of the core that clears the airspace; ``state`` is the progress."""

    def __init__(
        self,
        vehicles: dict[str, Vehicle],
        landings: Landings,
        airspace: AirspaceGuard,
        predictions: ClearingPredictions,
        prescribed: bool,
    ) -> None:
        self.state = ClearingState()
        self._vehicles = vehicles
        self._landings = landings
        self._airspace = airspace
        self._predictions = predictions
        self._prescribed = prescribed  # the service does not land a burn's vehicles
        self._checked_at_s = -math.inf
        self._restarted_at_s = -math.inf
        self.shown: ShowClearing | None = None

    # Requests ---------------------------------------------------------------------------------

    def refused(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        """Return the announcement that a request is refused; [] if it is not."""
        why = self._refusal(event)
        if not why:
            return []
        named = (
            event.vehicle if isinstance(event, events.OrderGiven) else next(iter(self._vehicles))
        )
        refused = [each for name, each in self._vehicles.items() if named in ("", name)]
        return [announce(each, f"{REJECTED} {why}", warning=True) for each in refused]

    def _refusal(self, event: events.AnyOperatorEvent) -> str:
        in_force = self.state.in_force
        match event:
            case events.ClearingCancelled() if not in_force:
                return "the airspace is not being cleared"
            case events.ClearingOrdered() if event.volume and in_force and self.state.lands:
                return "all vehicles are already landing: cancel this first"
            case events.ClearingOrdered() if event.volume and not event.corners:
                return "" if self._volume(event.volume, event.at_us / 1e6) else _unknown(event)
            case (
                events.OrderGiven(order="start" | "takeoff")
                | events.PlanRequested()
                | events.Approved()
            ):
                waits = "no vehicle takes off, and nothing is dropped, until it is clear"
                return f"the airspace is being cleared: {waits}" if in_force else ""
            case events.OrderGiven(order="resume") if in_force and self.state.lands:
                return "the airspace is being cleared: cancel this first"
            case _:
                return ""

    def on_operator(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        """Apply a request, after the other parts of the core have applied it."""
        at_s, state = event.at_us / 1e6, self.state
        match event:
            case events.ClearingOrdered():
                return self._ordered(event)
            case events.ClearingCancelled():
                return self._cancelled(event)
            case events.AirspaceOpened() if state.in_force and event.name == state.volume:
                return self._end("cancelled", f"the volume was opened by {event.by}")
            case events.Aborted() if state.in_force and state.lands:
                return self._end("cancelled", f"aborted by {event.by}")
            case events.OrderGiven() if state.in_force and state.lands:
                for name in self._named(event.vehicle):
                    self._note_order(state.vehicles[name], event)
                return self._check(at_s)
            case events.Resumed():
                self._restarted_at_s = at_s
                for progress in state.vehicles.values():
                    progress.ordered_at_s = progress.order_under_way = None
                    progress.flies_until_s = None
                return []
            case _:
                return []

    def on_vehicle(self, event: events.VehicleEvent) -> list[AnyCommand]:
        """Apply a vehicle's event, after the other parts of the core have applied it."""
        if not self.state.in_force:
            return []
        at_s = event.at_us / 1e6
        if isinstance(event, events.Telemetry):
            due = not 0.0 <= at_s - self._checked_at_s < EVERY_S
            return self._check(at_s) if due else []
        progress = self.state.vehicles.get(event.vehicle)
        answers = isinstance(event, events.UploadFinished) and event.outcome == "accepted"
        answers |= isinstance(event, events.CommandFinished) and event.accepted
        if progress is not None and answers:
            progress.acknowledged, progress.silent = True, False
        return self._check(at_s) if isinstance(event, CHANGES) else []

    def _ordered(self, event: events.ClearingOrdered) -> list[AnyCommand]:
        commands: list[AnyCommand] = []
        if event.corners:
            commands += self._airspace.on_operator(_closing(event))
            if any(isinstance(each, Announce) and REJECTED in each.text for each in commands):
                return commands
        commands += self._lower_alarms()
        self.state = ClearingState(
            event.volume, bool(event.corners), event.by, event.at_us, "in force"
        )
        for vehicle in self._vehicles.values():
            if not (vehicle.availability.airborne or self._prescribed):
                vehicle.waits_for_operator = True
                vehicle.end_intentions()
        flying = [each for each in self._vehicles.values() if not on_ground(each)]
        ordered = sorted(flying, key=self._predictions.turn)
        for rank, vehicle in enumerate(ordered):
            vehicle.landing_state.rank = rank
            self.state.vehicles[vehicle.name] = ClearingProgress()
        commands += self._check(event.at_us / 1e6)
        if self.state.in_force:
            commands += self._announced(self._order_words())
        return commands

    def _order_words(self) -> str:
        state = self.state
        names = ", ".join(state.vehicles)
        what = f"all vehicles land, in this order: {names}"
        if not state.lands:
            what = f"all vehicles leave {state.volume!r}: {names}"
        return f"{state.by} clears the airspace: {what}; {self._count_words()}"

    def _count_words(self) -> str:
        vehicles = self.state.vehicles.values()
        ended = sum(each.phase in CLEARED for each in vehicles)
        words = f"{ended} of {len(vehicles)} {'on the ground' if self.state.lands else 'out'}"
        missed = sum(each.phase == "not reached" for each in vehicles)
        words += f", {missed} not reached" if missed else ""
        expected_s = [each.expected_at_s for each in vehicles if each.phase not in CLEARED]
        known_s = [each for each in expected_s if each is not None]
        return f"{words}, last expected at {_clock(max(known_s))}" if known_s else words

    def _cancelled(self, event: events.ClearingCancelled) -> list[AnyCommand]:
        state, commands = self.state, []
        for name, progress in state.vehicles.items():
            vehicle = self._vehicles[name]
            lands = self._landings.must_go_around(vehicle) or lands_by_itself(vehicle)
            left = progress.phase in CLEARED or self._prescribed or lands or progress.other_order
            if not (left or unreachable(vehicle)):
                commands.append(OrderByService(name, "hold", by=event.by))
        ended = self._end("cancelled", f"cancelled by {event.by}: vehicles on their way hold")
        if state.closed_here:
            opened = events.AirspaceOpened(event.at_us, event.by, event.station, state.volume)
            ended += self._airspace.on_operator(opened)
        return [*ended, *commands]

    def _named(self, name: str) -> list[str]:
        return [each for each in self.state.vehicles if name in ("", each)]

    def _note_order(self, progress: ClearingProgress, event: events.OrderGiven) -> None:
        """Record that the clearing gave an order, or that an operator gave another one."""
        if progress.order_under_way == event.order:
            progress.order_under_way = None
        elif event.order == "land":
            progress.other_order, progress.acknowledged = "", False
            progress.ordered_at_s, progress.silent = event.at_us / 1e6, False
        elif event.by != events.SERVICE:
            progress.other_order = f"{event.order} ordered by {event.by}"

    # Progress ---------------------------------------------------------------------------------

    def _check(self, at_s: float) -> list[AnyCommand]:
        """Update the phases, give the orders that are due, and show changes."""
        self._checked_at_s = at_s
        state, commands = self.state, []
        for name, vehicle in self._vehicles.items():
            if name not in state.vehicles and vehicle.availability.airborne:
                state.vehicles[name] = ClearingProgress()
        volume = None if state.lands else self._volume(state.volume, at_s)
        if not (state.lands or volume):
            return self._end("complete", "the volume is open again")
        for name, progress in state.vehicles.items():
            vehicle, before = self._vehicles[name], progress.phase
            if volume is None:
                phase, why, given = self._landing(vehicle, progress, at_s)
            else:
                phase, why, given = self._leaving(vehicle, progress, volume, at_s)
            progress.phase, progress.why = phase, why
            if before == "not reached" != phase:
                progress.restate()
            commands += [*given, *self._reported(vehicle, progress, before, at_s)]
        self._predictions.predict(state, volume, at_s)
        if all(each.phase in CLEARED for each in state.vehicles.values()):
            return [*commands, *self._end("complete", self._count_words())]
        return [*commands, *self._show()]

    def _landing(self, vehicle: Vehicle, progress: ClearingProgress, at_s: float) -> Phase:
        """Return a landing vehicle's phase, why it cannot be commanded, and the orders to it."""
        if on_ground(vehicle):
            return "on the ground", "", []
        if self._prescribed:
            return "not reached", "the vehicle of a burn climbs and holds: land it by radio", []
        why = unreachable(vehicle)
        if why:
            return self._not_reached(vehicle, progress, why, at_s)
        if not vehicle.availability.airborne:
            return "not reached", "it is armed on the ground: disarm it", []
        if vehicle.unconfirmed is not None or progress.order_under_way is not None:
            return progress.phase, progress.why, []
        if progress.other_order:
            goes = progress.other_order.startswith("return")
            return ("on its way" if goes else "not reached"), progress.other_order, []
        if vehicle.landing_state.active:
            self._note_command(vehicle, progress)
            phase = landing_phase(vehicle, progress)
            progress.silent |= unanswered(progress, phase, at_s)
            if not progress.silent:
                return phase, "", []
            since_s = at_s if progress.ordered_at_s is None else progress.ordered_at_s
            too_long = at_s - since_s >= longest_answer_s(vehicle)
            return "not reached", SILENT, self._order_hold(vehicle, progress) if too_long else []
        if progress.silent:
            return "not reached", SILENT, []
        if lands_by_itself(vehicle) or self._airspace.is_led_home(vehicle.name):
            return "on its way", "", []
        return self._order_landing(vehicle, progress, at_s)

    @staticmethod
    def _note_command(vehicle: Vehicle, progress: ClearingProgress) -> None:
        """Await a new answer if the vehicle's turn to land has come since its last order."""
        began_s, since_s = vehicle.landing_state.since_s, progress.ordered_at_s
        if waits_for_order(vehicle) and (since_s is None or began_s > since_s):
            progress.ordered_at_s, progress.acknowledged = began_s, False

    def _order_landing(self, vehicle: Vehicle, progress: ClearingProgress, at_s: float) -> Phase:
        """Order a vehicle to land, to return above ground first, or to hold if it cannot land."""
        since_s = progress.ordered_at_s
        if since_s is not None and at_s - since_s < AGAIN_S:
            return progress.phase, progress.why, []
        why = self._landings.obstacle(vehicle)
        order: events.Order = "hold" if why else "land"
        if why and self._airspace.must_be_led_home(vehicle):
            order, why = "return", ""
        progress.ordered_at_s, progress.acknowledged = at_s, False
        if why and vehicle.ordered == "hold":
            return "not reached", f"it cannot land: {why}; it holds", []
        progress.order_under_way = order
        progress.restate()
        commands: list[AnyCommand] = [OrderByService(vehicle.name, order, by=self.state.by)]
        if why:
            return "not reached", f"it cannot land: {why}; it holds", commands
        return "ordered", "", commands

    def _not_reached(
        self, vehicle: Vehicle, progress: ClearingProgress, why: str, at_s: float
    ) -> Phase:
        """Return the phase of a vehicle that cannot be commanded; no other vehicle waits for it."""
        lost = not vehicle.availability.online
        if lost and at_s - self._restarted_at_s < CONNECTS_S:
            return progress.phase, progress.why, []
        progress.ordered_at_s = None  # it is ordered again as soon as it can be commanded
        if lost:
            commands = self._order_hold(vehicle, progress)
        else:  # the hold would end its failsafe or its pilot's mode
            commands = self._landings.leave_queue(vehicle)
        overdue = progress.out_by_s is not None and at_s > progress.out_by_s
        if lost and overdue and vehicle.landing_state.active:  # it may have landed unobserved
            commands += self._landings.end(vehicle)
        return "not reached", why, commands

    def _order_hold(self, vehicle: Vehicle, progress: ClearingProgress) -> list[AnyCommand]:
        """Order a vehicle that is not yet landing to hold, so that no other vehicle waits for it.

        The hold is repeated until it is acknowledged; the vehicle then lands after the others.
        """
        if not waits_for_order(vehicle) or progress.order_under_way is not None:
            return []
        progress.order_under_way, progress.ordered_at_s = "hold", None
        return [OrderByService(vehicle.name, "hold", by=self.state.by)]

    def _leaving(
        self, vehicle: Vehicle, progress: ClearingProgress, volume: Volume, at_s: float
    ) -> Phase:
        """Return the phase of a vehicle that leaves a volume by order of the airspace guard."""
        fix, why = vehicle.availability.fix, unreachable(vehicle)
        if on_ground(vehicle) or fix is None:
            return "on the ground", "", []
        lost = not vehicle.availability.online
        if lost and at_s - self._restarted_at_s < CONNECTS_S:
            return progress.phase, progress.why, []
        if lost:
            return "not reached", f"{why}: it may be inside", []
        if not volume.contains(fix.x_m, fix.y_m, fix.altitude_m):
            progress.silent = False
            return "out", "", []
        if self._prescribed:
            return "not reached", "the vehicle of a burn climbs and holds: move it by radio", []
        if vehicle.landing_state.active:
            why = why or "it is landing"
        if why:
            return "not reached", why, []
        step = self._airspace.exit_step(vehicle.name)
        if progress.ordered_at_s is None:
            progress.ordered_at_s, progress.acknowledged = at_s, False
        phase: ClearingPhase = "acknowledged" if step == "on board" else "ordered"
        if step == "flown":
            progress.silent = False
            return "on its way", "", []
        progress.silent |= unanswered(progress, phase, at_s)
        return ("not reached", SILENT, []) if progress.silent else (phase, "", [])

    # Reports ----------------------------------------------------------------------------------

    def _reported(
        self, vehicle: Vehicle, progress: ClearingProgress, before: ClearingPhase, at_s: float
    ) -> list[AnyCommand]:
        """Raise or clear the alarm of a vehicle, and announce that it is out."""
        was_inside = self.state.lands or progress.ordered_at_s is not None or progress.alarm != ""
        commands = self._alarmed(vehicle, progress, self._alarm(progress, at_s))
        if progress.phase in CLEARED and before not in CLEARED and was_inside:
            commands.append(announce(vehicle, f"{progress.phase}: {self._count_words()}"))
        return commands

    def _alarm(self, progress: ClearingProgress, at_s: float) -> str:
        if progress.phase in CLEARED:
            return ""
        if progress.phase == "not reached":
            return f"not cleared: {progress.why}; use the radio"
        if progress.out_by_s is not None and at_s > progress.out_by_s:
            where = "on the ground" if self.state.lands else f"out of {self.state.volume!r}"
            return f"is late: it should have been {where} by {_clock(progress.out_by_s)}"
        return ""

    def _alarmed(
        self, vehicle: Vehicle, progress: ClearingProgress, words: str
    ) -> list[AnyCommand]:
        if words == progress.alarm:
            return []
        progress.alarm = words
        if not words:
            return [ClearAlarm(vehicle.name, CLEARING)]
        alarm = RaiseAlarm(vehicle.name, CLEARING, words, "severe")
        return [announce(vehicle, words, warning=True), alarm]

    def _lower_alarms(self) -> list[AnyCommand]:
        return [
            command
            for name, progress in self.state.vehicles.items()
            for command in self._alarmed(self._vehicles[name], progress, "")
        ]

    def _end(self, outcome: ClearingOutcome, why: str) -> list[AnyCommand]:
        self.state.outcome = outcome
        ended = "the airspace is clear" if outcome == "complete" else "airspace clearing ended"
        return [*self._lower_alarms(), *self._announced(f"{ended}: {why}"), *self._show()]

    def _announced(self, words: str) -> list[AnyCommand]:
        first = next(iter(self._vehicles.values()))
        return [announce(first, words, warning=True)]

    def _show(self) -> list[AnyCommand]:
        """Return the command that shows the progress, if it has changed enough."""
        state = self.state
        rows = tuple(
            ClearedVehicle(
                name,
                progress.phase,
                progress.why,
                _us(progress.out_by_s),
                _us(progress.expected_at_s),
            )
            for name, progress in state.vehicles.items()
        )
        first = next(iter(self._vehicles))
        shown = ShowClearing(
            first, state.volume, state.by, state.ordered_at_us, state.outcome, rows
        )
        if self.shown is not None and _alike(shown, self.shown):
            return []
        self.shown = shown
        return [shown]

    def _volume(self, name: str, at_s: float) -> Volume | None:
        """Return the volume with this name that is currently closed."""
        closed = [each for each in self._airspace.volumes if each.is_closed(at_s)]
        return next((each for each in closed if each.name == name), None)


# Events that may change a phase; position reports cause a check every ``EVERY_S``.
CHANGES = (
    events.VehicleConnected,
    events.LinkLost,
    events.LinkRestored,
    events.VehicleRebooted,
    events.ModeChanged,
    events.UploadFinished,
    events.CommandFinished,
    events.MissionReadBack,
    events.SystemStateChanged,
    events.FenceStatusChanged,
    events.GpsFixChanged,
    events.EstimatorStatusChanged,
    events.LandedStateChanged,
)


def _clock(at_s: float) -> str:
    """Return a mission time as h:mm:ss, to the nearest second."""
    return clock_text(round(at_s) * 1_000_000)


def _closing(event: events.ClearingOrdered) -> events.AirspaceClosed:
    """Return the event that closes a request's volume."""
    limits = (event.floor_amsl_m, event.ceiling_amsl_m)
    user = (event.at_us, event.by, event.station)
    return events.AirspaceClosed(*user, event.volume, event.corners, *limits)


def _unknown(event: events.ClearingOrdered) -> str:
    return f"no closed volume {event.volume!r}: close it first, or specify its corners"


def _us(at_s: float | None) -> int | None:
    return None if at_s is None or math.isinf(at_s) else round(at_s * 1e6)


def _alike(one: ShowClearing, other: ShowClearing) -> bool:
    """Return whether two states differ at most by small changes in the predictions."""

    def fixed(shown: ShowClearing) -> tuple[object, ...]:
        rows = [(each.vehicle, each.phase, each.why, each.out_by_us) for each in shown.vehicles]
        return shown.volume, shown.by, shown.ordered_at_us, shown.outcome, rows

    if fixed(one) != fixed(other):
        return False
    pairs = zip(one.vehicles, other.vehicles, strict=True)
    return all(_near(a.expected_us, b.expected_us) for a, b in pairs)


def _near(one_us: int | None, other_us: int | None) -> bool:
    if one_us is None or other_us is None:
        return one_us is other_us
    return abs(one_us - other_us) < SHOWN_CHANGE_S * 1e6
