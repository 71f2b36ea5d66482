"""A core and the vehicles of ``autopilot_model``, advanced turn by turn; each turn is checked.

This module advances the time; other events are in ``vehicle_flights``.
"""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, ProposeMission, UploadMission
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.core.core import Core
from mission_service.events import (
    AnyEvent,
    BatteryUpdated,
    CommandFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    GpsFixChanged,
    LandedStateChanged,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Observed,
    SystemStateChanged,
    Telemetry,
    VehicleConnected,
)
from mission_service.guidance.burn.controller import BurnFlight
from mission_service.simulation.simulated_crew import SimulatedCrew
from tests.service.autopilot_model import NAMES, Autopilot, Bridge, Sent, Source
from tests.service.vehicle_oracle import Oracle, Violation
from tests.service.vehicle_sites import Site, site_of

FIRE_M, VIEW_CELLS = 200.0, 8
# Events that are left out of a story if no command follows.
NOT_IN_STORY = (
    *(Observed, SystemStateChanged, LandedStateChanged, FenceStatusChanged),
    *(EstimatorStatusChanged, GpsFixChanged, BatteryUpdated, MissionProgress),
)
REMEMBERED = 40  # number of turns in the report of a violation
OMITTED_FIELDS = ("at_us", "by", "station", "custom_mode", "atomic_upload", "stack")
MIN_STEP_S = 0.01


class Turns:
    """The turns of a service: events to the core, its commands to the oracle and the vehicles."""

    def __init__(
        self,
        name: str,
        met: Counter[str],
        found: Callable[[Violation, str], None],
        make: Callable[[Scenario, Landscape], Core] = Core,
    ) -> None:
        """``met`` counts situations; ``found`` is called with each violation and its story.

        ``make`` creates the core and a second core, which must return the same commands.
        """
        self.site = site_of(name)
        scenario, landscape = self.site.scenario, self.site.landscape
        self.core = make(scenario, landscape)
        self.twin = make(scenario, landscape)
        self.bridges = {
            section.name: Bridge(_autopilot(self.site, section)) for section in scenario.vehicles
        }
        self.names = list(self.bridges)
        self.oracle = Oracle(
            {each.name: (each.stack, each.autostart) for each in scenario.vehicles},
            burn=scenario.burn is not None,
        )
        self.now_us = 0
        self.met = met
        self.proposed: dict[str, str] = {}
        # In a burn, operators answer GO, watch and approve while they are present.
        self.operators = (
            None if scenario.burn is None else SimulatedCrew(scenario.burn, thinks_s=1.0)
        )
        self.operators_present = True
        self._found = found
        self._log: deque[str] = deque(maxlen=REMEMBERED)
        self._replaced: deque[tuple[str, Sent, str]] = deque()
        self.met[f"flights: {name}"] += 1
        self.step()

    # Events and commands ----------------------------------------------------------------------

    def process(self, event: AnyEvent, carried_out: bool = True) -> list[AnyCommand]:
        """Let the core process an event; check its commands and send them."""
        commands = self._handle(event)
        self._note(event, commands)
        source: Source = "start-up"
        if isinstance(event, ModeChanged):
            source = self.bridges[event.vehicle].autopilot.chosen_by
        for violation in self.oracle.judge(event, commands, source):
            self._report(violation)
        self.met.update(self.oracle.met)
        self.met["events"] += 1
        for command in commands:
            self._send(command, carried_out)
        return commands

    def _handle(self, event: AnyEvent) -> list[AnyCommand]:
        try:
            commands = self.core.handle(event)
            again = self.twin.handle(event)
            self.core.validate_state()
            if isinstance(self.core.guidance, BurnFlight):
                self.core.guidance.approvals.validate_state()
        except Exception as error:  # any exception is a violation
            self._log.append(f"{_in_words(event)} raises {error!r}")
            self._report(Violation("raises", repr(error)))
            raise
        if again != commands:
            self._log.append(f"{_in_words(event)} -> {commands}, and again {again}")
            self._report(Violation("not the same commands", ""))
        return commands

    def _note(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        """Add a line to the story; of positions without commands only the last is kept."""
        if not commands and isinstance(event, NOT_IN_STORY):
            return
        line = f"{_in_words(event)} -> {', '.join(map(_in_words, commands))}"
        repeats = line.startswith("Telemetry") and line.endswith("-> ") and self._log
        if repeats and self._log[-1].startswith("Telemetry") and self._log[-1].endswith("-> "):
            self._log.pop()
        self._log.append(line)

    def _report(self, violation: Violation) -> None:
        self._found(violation, "\n".join(self._log))

    def _send(self, command: AnyCommand, carried_out: bool) -> None:
        if isinstance(command, ProposeMission):
            self.proposed[command.vehicle] = command.mission_hash
        if isinstance(command, UploadMission) or type(command) in NAMES:
            self.met[f"commanded: {type(command).__name__}"] += 1
        if carried_out:
            replaced = self.bridges[command.vehicle].send(command)
            reason = f"{NAMES.get(type(command))} took its place"
            self._replaced.extend((command.vehicle, sent, reason) for sent in replaced)

    def step(self, seconds: float = MIN_STEP_S) -> None:
        """Advance the ground station; bridges report new states, heartbeats first."""
        self.now_us += round(seconds * 1e6)
        while self._replaced:
            self._ended(*self._replaced.popleft())
        for name, bridge in self.bridges.items():
            if bridge.linked:
                self._heartbeat(name, bridge)

    def _ended(self, name: str, sent: Sent, reason: str) -> None:
        """Report a command as not carried out, whether it was or not."""
        self.process(CommandFinished(self.now_us, name, NAMES[type(sent.command)], False, reason))

    def _heartbeat(self, name: str, bridge: Bridge) -> None:
        flown = bridge.autopilot
        if not bridge.connected:
            bridge.connected = True
            self.process(VehicleConnected(self.now_us, name, flown.stack, flown.stack == "px4"))
        if bridge.lost:
            bridge.lost = False
            self.process(LinkRestored(self.now_us, name))
        if bridge.mode != (flown.armed, flown.mode):
            bridge.mode = (flown.armed, flown.mode)
            self.process(ModeChanged(self.now_us, name, 0, flown.armed, flown.mode))
        if bridge.seq != flown.seq:
            bridge.seq = flown.seq
            self.process(MissionProgress(self.now_us, name, flown.seq))
        for kind, state in flown.states.items():
            if bridge.states.get(kind) != state:
                bridge.states[kind] = state
                self.process(self._state(name, kind, state))

    def _state(self, name: str, kind: str, state: str) -> AnyEvent:
        match kind:
            case "system":
                return SystemStateChanged(self.now_us, name, state)
            case "landed":
                return LandedStateChanged(self.now_us, name, state)
            case "fence":
                return FenceStatusChanged(self.now_us, name, bool(state), state)
            case "estimator":
                problems = (state,) if state else ()
                return EstimatorStatusChanged(self.now_us, name, not state, problems)
            case "fix":
                return GpsFixChanged(self.now_us, name, state == "3d", state)
            case _:
                return BatteryUpdated(self.now_us, name, float(state))

    # Flight -----------------------------------------------------------------------------

    def fly(self, seconds: float) -> None:
        """Fly all vehicles; positions are sent at most once a second, and at least three times."""
        count = max(1, min(3, round(seconds)))
        for _ in range(count):
            self.now_us += round(seconds / count * 1e6)
            for name, bridge in self.bridges.items():
                bridge.autopilot.fly(seconds / count)
                if bridge.linked:
                    self._heartbeat(name, bridge)
                    self._position(name, bridge.autopilot)
            if self.operators is not None and self.operators_present:
                for event in self.operators.due(self.now_us, self.core):
                    self.process(event)
        self.step()

    def _position(self, name: str, flown: Autopilot) -> None:
        landscape = self.site.landscape
        lat_deg, lon_deg = landscape.lat_lon_of(flown.x_m, flown.y_m)
        if flown.height_m > 30.0 and self.operators is None:
            self.process(self._seen(name, flown))
        self.process(
            Telemetry(
                self.now_us,
                name,
                float(lat_deg),
                float(lon_deg),
                self.site.ground_amsl_m(flown.x_m, flown.y_m) + flown.height_m,
                flown.height_m,
                0.0,
                flown.speed_m_s if flown.in_air else 0.0,
                90.0,
            )
        )

    def _seen(self, name: str, flown: Autopilot) -> Observed:
        """Return the camera's image of a round fire that does not grow."""
        landscape = self.site.landscape
        rows, cols = landscape.shape
        row, col = (round(float(each)) for each in landscape.row_col_of(flown.x_m, flown.y_m))
        top, left = max(row - VIEW_CELLS, 0), max(col - VIEW_CELLS, 0)
        seen = np.mgrid[top : min(row + VIEW_CELLS, rows), left : min(col + VIEW_CELLS, cols)]
        if seen.size == 0:
            return Observed(self.now_us, name, 0, 0, (".",))
        x_m, y_m = landscape.xy_of(seen[0], seen[1])
        burns = np.hypot(x_m - self.site.fire_m[0], y_m - self.site.fire_m[1]) < FIRE_M
        codes = np.where(burns, "b", "u")
        return Observed(self.now_us, name, top, left, tuple("".join(line) for line in codes))


def _autopilot(site: Site, section: VehicleSection) -> Autopilot:
    x_m, y_m = site.landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    home_m = (float(x_m), float(y_m))
    return Autopilot(
        section.stack, home_m, site.fire_m, section.airspeed_m_s, circle_m=FIRE_M + 50.0
    )


def _in_words(thing: AnyEvent | AnyCommand) -> str:
    """Return an event or a command as a short text."""
    at_s = f" at {thing.at_us / 1e6:.2f} s" if hasattr(thing, "at_us") else ""
    fields = thing.__struct_fields__
    shown = [repr(getattr(thing, field)) for field in fields if field not in OMITTED_FIELDS]
    words = f"{type(thing).__name__}({', '.join(shown)}){at_s}"
    if isinstance(thing, Observed):
        words = f"Observed({thing.vehicle})"
    elif isinstance(thing, UploadMission | ProposeMission):
        words = f"{type(thing).__name__}({thing.vehicle}, {thing.mission_id}, {thing.why!r})"
    elif isinstance(thing, Telemetry):
        words = f"Telemetry({thing.vehicle}, {thing.altitude_relative_m:.0f} m){at_s}"
    return words
