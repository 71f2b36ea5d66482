"""A core, its vehicles (``autopilot_model``) and the crew, moved on by single steps; each is judged.

What happens is decided elsewhere: by hypothesis (``test_vehicle_states``), one step after another.
"""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from firemodel.landscape import Landscape
from mission_service.commands import AnyCommand, ProposeMission, UploadMission
from mission_service.config import Scenario
from mission_service.config_sections import VehicleSection
from mission_service.core import Core
from mission_service.events import (
    Aborted,
    AnyEvent,
    AutopilotText,
    BatteryTold,
    CommandFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    FixTold,
    LandedStateChanged,
    LinkLost,
    LinkRestored,
    MissionAccepted,
    MissionHeld,
    MissionProgress,
    MissionRefused,
    MissionWanted,
    ModeChanged,
    Observed,
    Order,
    Ordered,
    PlanWanted,
    Resumed,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.planning import FORMATION
from mission_service.simulated_crew import SimulatedCrew
from mission_service.state_file import Frozen, thawed
from tests.service.autopilot_model import NAMES, Autopilot, Bridge, Sent, Source
from tests.service.vehicle_oracle import Oracle, Violation
from tests.service.vehicle_sites import Site, site_of

FIRE_M, VIEW_CELLS = 200.0, 8
RECOVERS_WITHIN_S = 300
# Events without commands that need no line in a story.
UNTOLD = (
    *(Observed, SystemStateChanged, LandedStateChanged, FenceStatusChanged),
    *(EstimatorStatusChanged, FixTold, BatteryTold, MissionProgress),
)
REMEMBERED = 40  # turns, for the report of a violation
UNSAID = ("at_us", "by", "station", "custom_mode", "atomic_upload", "stack")
LEAST_STEP_S = 0.01
SERVICE_STARTS_S = 2.0


class Flights:
    """Vehicles in the air and on the ground, and the service that flies them."""

    def __init__(
        self,
        name: str,
        met: Counter[str],
        found: Callable[[Violation, str], None],
        make: Callable[[Scenario, Landscape], Core] = Core,
    ) -> None:
        """``met`` counts situations; ``found`` is handed each violation with what led to it.

        ``make`` makes the core, and a second one that must answer the same.
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
        # A burn's crew says GO, watches and approves, while it is there.
        self.crew = None if scenario.burn is None else SimulatedCrew(scenario.burn, thinks_s=1.0)
        self.crew_is_there = True
        self._found = found
        self._log: deque[str] = deque(maxlen=REMEMBERED)
        self._replaced: deque[tuple[str, Sent, str]] = deque()
        self.met[f"flights: {name}"] += 1
        self.step()

    # Events and commands ----------------------------------------------------------------------

    def tell(self, event: AnyEvent, carried_out: bool = True) -> list[AnyCommand]:
        """One turn of the service: the core handles an event, its commands are judged and sent."""
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
        except Exception as error:  # any at all: that there is none is what is judged
            self._log.append(f"{_in_words(event)} raises {error!r}")
            self._report(Violation("raises", repr(error)))
            raise
        if again != commands:
            self._log.append(f"{_in_words(event)} -> {commands}, and again {again}")
            self._report(Violation("not the same commands", ""))
        return commands

    def _note(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        """A line for the story; of positions without a command only the last."""
        if not commands and isinstance(event, UNTOLD):
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

    def step(self, seconds: float = LEAST_STEP_S) -> None:
        """Time passes on the ground station; bridges report what is new, heartbeats first."""
        self.now_us += round(seconds * 1e6)
        while self._replaced:
            self._ended(*self._replaced.popleft())
        for name, bridge in self.bridges.items():
            if bridge.linked:
                self._heartbeat(name, bridge)

    def _ended(self, name: str, sent: Sent, reason: str) -> None:
        """A command is reported as not carried out, whether it was or not."""
        self.tell(CommandFinished(self.now_us, name, NAMES[type(sent.command)], False, reason))

    def _heartbeat(self, name: str, bridge: Bridge) -> None:
        flown = bridge.autopilot
        if not bridge.connected:
            bridge.connected = True
            self.tell(VehicleConnected(self.now_us, name, flown.stack, flown.stack == "px4"))
        if bridge.lost:
            bridge.lost = False
            self.tell(LinkRestored(self.now_us, name))
        if bridge.mode != (flown.armed, flown.mode):
            bridge.mode = (flown.armed, flown.mode)
            self.tell(ModeChanged(self.now_us, name, 0, flown.armed, flown.mode))
        if bridge.seq != flown.seq:
            bridge.seq = flown.seq
            self.tell(MissionProgress(self.now_us, name, flown.seq))
        for kind, state in flown.states.items():
            if bridge.states.get(kind) != state:
                bridge.states[kind] = state
                self.tell(self._state(name, kind, state))

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
                return FixTold(self.now_us, name, state == "3d", state)
            case _:
                return BatteryTold(self.now_us, name, float(state))

    # The vehicles -----------------------------------------------------------------------------

    def fly(self, seconds: float) -> None:
        """All vehicles go on; positions come at most each second, at least three times."""
        count = max(1, min(3, round(seconds)))
        for _ in range(count):
            self.now_us += round(seconds / count * 1e6)
            for name, bridge in self.bridges.items():
                bridge.autopilot.fly(seconds / count)
                if bridge.linked:
                    self._heartbeat(name, bridge)
                    self._position(name, bridge.autopilot)
            if self.crew is not None and self.crew_is_there:
                for event in self.crew.due(self.now_us, self.core):
                    self.tell(event)
        self.step()

    def _position(self, name: str, flown: Autopilot) -> None:
        landscape = self.site.landscape
        lat_deg, lon_deg = landscape.lat_lon_of(flown.x_m, flown.y_m)
        if flown.height_m > 30.0 and self.crew is None:
            self.tell(self._seen(name, flown))
        self.tell(
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
        """What a camera sees of a round fire that does not grow."""
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

    def pilot(self, name: str, mode: str) -> None:
        """Somebody switches a mode by radio; in the air or armed on the ground."""
        self.bridges[name].autopilot.change(mode, "pilot")
        self.step()

    def arm(self, name: str, armed: bool) -> None:
        """Somebody arms by radio, or disarms on the ground."""
        flown = self.bridges[name].autopilot
        if armed:
            flown.armed = True
            flown.chosen_by = "pilot"
        else:
            flown.land()
        self.step()

    def takes_off_by_hand(self, name: str, mode: str) -> None:
        """Somebody flies it by radio."""
        flown = self.bridges[name].autopilot
        flown.armed, flown.height_m = True, max(flown.height_m, 60.0)
        flown.change(mode, "pilot")
        self.fly(1.0)

    def failsafe(self, name: str, kind: str) -> None:
        """The autopilot changes the mode by itself, in the air."""
        flown = self.bridges[name].autopilot
        if flown.armed and flown.in_air:
            self.met[f"failsafe: {kind}"] += 1
            flown.fail(kind)
            if self.bridges[name].linked:
                self.tell(AutopilotText(self.now_us, name, 2, f"{kind}: {flown.mode}"))
        self.step()

    def wind(self, name: str, speed_m_s: float) -> None:
        """The autopilot measures the wind."""
        if self.bridges[name].linked:
            self.tell(WindMeasured(self.now_us, name, speed_m_s, 270.0))
        self.step()

    def lands(self, name: str, reported: bool) -> None:
        """It comes down and is disarmed, with some positions on its way or none."""
        flown = self.bridges[name].autopilot
        if flown.in_air and reported:
            flown.height_m = 5.0
            self.fly(0.5)
        flown.land()
        self.step()

    def reboot(self, name: str, keeps_flying: bool, heartbeat_first: bool) -> None:
        """The autopilot starts again; all that was under way for it ends without success."""
        bridge = self.bridges[name]
        bridge.autopilot.reboot(keeps_flying and bridge.autopilot.armed)
        if not bridge.linked:
            return
        if heartbeat_first:
            self._heartbeat(name, bridge)
        self.tell(VehicleRebooted(self.now_us, name))
        ended, bridge.commands = bridge.commands, []
        for sent in ended:
            self._ended(name, sent, "the autopilot was restarted")
        self.step()

    # Links and answers ------------------------------------------------------------------------

    def link(self, name: str, works: bool) -> None:
        """Heartbeats end, or come again."""
        bridge = self.bridges[name]
        if bridge.linked and not works:
            bridge.linked, bridge.lost = False, True
            self.now_us += 3_000_000
            self.tell(LinkLost(self.now_us, name, 3.0))
        bridge.linked = works
        self.step()

    def deliver(self, name: str, refused: str, answers: bool) -> None:
        """A command arrives; its answer is reported before the mode it leads to, or waits."""
        bridge = self.bridges[name]
        if bridge.linked:
            bridge.deliver(refused)
            if answers:
                self._answer(name, bridge, 0)
        self.step()

    def answer(self, name: str, number: int) -> None:
        """The answer to any command that arrived is reported, however long ago that was."""
        self._answer(name, self.bridges[name], number)
        self.step()

    def _answer(self, name: str, bridge: Bridge, number: int) -> None:
        arrived = [each for each in bridge.commands if each.answer is not None]
        if arrived:
            sent = arrived[number % len(arrived)]
            bridge.commands.remove(sent)
            command, reason = NAMES[type(sent.command)], sent.answer or "accepted"
            self.tell(CommandFinished(self.now_us, name, command, not sent.answer, reason))

    def unanswered(self, name: str, number: int) -> None:
        """A command got lost, or its answer: the bridge gives up."""
        bridge = self.bridges[name]
        if bridge.commands:
            self.met["command without an answer"] += 1
            sent = bridge.commands.pop(number % len(bridge.commands))
            self._ended(name, sent, "was not answered")
        self.step()

    def upload_begins(self, name: str) -> None:
        """ArduPilot holds while its mission is overwritten."""
        if self.bridges[name].linked:
            self.bridges[name].pause()
        self.step()

    def upload_ends(self, name: str, outcome: str, on_board: bool) -> None:
        """The oldest upload ends, as reported; the vehicle may have it whatever is reported."""
        bridge = self.bridges[name]
        upload = bridge.finish(outcome, on_board)
        if upload is not None:
            self.met[f"upload {outcome}"] += 1
            mission_id = upload.mission_id
            self.tell(UploadFinished(self.now_us, name, mission_id, outcome, "because"))
        self.step()

    def all_goes_well(self, seconds: int) -> None:
        """For a while all commands arrive, and all is answered and accepted."""
        self.read_back("same")
        for _ in range(seconds):
            for name, bridge in self.bridges.items():
                if not bridge.linked:
                    continue
                while bridge.uploads:
                    self.upload_ends(name, "accepted", True)
                while bridge.deliver() is not None:
                    self._answer(name, bridge, 0)
            self.fly(1.0)

    def crew_flies_on(self) -> None:
        """People order all to fly, all goes well: then all must be led again before long."""
        if self.crew is not None:
            self.crew_is_there = True
            self.renew("")
            self.all_goes_well(10)
            return
        for name, bridge in self.bridges.items():
            bridge.autopilot.trouble = ""
            self.link(name, True)
        for order in ("resume", "start"):
            self.order("", order, True)
        for _ in range(RECOVERS_WITHIN_S):
            for name in list(self.proposed):
                self.word_on_mission(name, True, True)
                del self.proposed[name]
            self.all_goes_well(1)
            late = [name for name, bridge in self.bridges.items() if not self._led(bridge)]
            if not late:
                return
        words = ", ".join(f"{name} in {self.bridges[name].autopilot.mode}" for name in late)
        if all(section.endurance_s is None for section in self.site.scenario.vehicles):
            self._report(Violation("not flown on", f"after {RECOVERS_WITHIN_S} s: {words}"))

    def _led(self, bridge: Bridge) -> bool:
        flown = bridge.autopilot
        orbits = self.site.scenario.planner.rule == FORMATION and flown.chosen_by == "service"
        modes = ("mission", "hold", "guided") if orbits else ("mission",)
        return flown.armed and flown.in_air and flown.mode in modes

    # People -----------------------------------------------------------------------------------

    def order(self, name: str, order: Order, confirmed: bool) -> None:
        """An order to one vehicle, or to all without a name; a burn has none."""
        if self.crew is None:
            self.tell(Ordered(self.now_us, "ann", "", name, order, confirmed))
        self.step()

    def abort(self) -> None:
        """Somebody aborts."""
        self.tell(Aborted(self.now_us, "ann", ""))
        self.step()

    def renew(self, name: str) -> None:
        """Somebody wants another mission, or another plan of a burn."""
        if self.crew is None:
            self.tell(MissionWanted(self.now_us, "ann", "", name))
        else:
            self.tell(PlanWanted(self.now_us, "ann", ""))
        self.step()

    def word_on_mission(self, name: str, accepts: bool, newest: bool) -> None:
        """Somebody accepts or refuses what is proposed, or what was never proposed."""
        if self.crew is not None:
            return
        named = self.proposed.get(name, "") if newest else "0" * 64
        kind = MissionAccepted if accepts else MissionRefused
        self.tell(kind(self.now_us, "ann", "", name, named))
        self.step()

    # The service ------------------------------------------------------------------------------

    def restart(self, down_s: float, killed: bool, read: str) -> None:
        """The service is killed and goes on, or its disk was full: commands are answered then.

        ``read`` is what is read back of the vehicles: the same, another, nothing; or later.
        """
        self.met["killed" if killed else "disk full"] += 1
        for bridge in self.bridges.values():
            bridge.autopilot.fly(down_s)
            bridge.restart(killed)
        if killed:
            self._replaced.clear()
        self.now_us += round(down_s * 1e6)
        self.tell(Resumed(self.now_us, "service", "", down_s))
        if not killed:
            for name, bridge in self.bridges.items():
                if bridge.connected and not bridge.lost:
                    stack = bridge.autopilot.stack
                    self.tell(VehicleConnected(self.now_us, name, stack, stack == "px4"))
        self.step(SERVICE_STARTS_S)
        if read != "later":
            self.read_back(read)

    def kill_before_sending(self, name: str, order: Order) -> None:
        """The service is killed when an order is written down, and what follows is not."""
        event = Ordered(self.now_us, "ann", "", name, order, True)
        aborted = Aborted(self.now_us, "ann", "")
        self.tell(event if self.crew is None else aborted, carried_out=False)
        self.restart(1.0, True, "same")

    def read_back(self, read: str) -> None:
        """What vehicles have on board is reported, as far as they are heard."""
        for name, bridge in self.bridges.items():
            if not (bridge.reads_back and bridge.linked):
                continue
            bridge.reads_back = False
            flown = bridge.autopilot
            known, items = (flown.mission, 3) if read == "same" else (0, 3)
            self.tell(ModeChanged(self.now_us, name, 0, flown.armed, flown.mode))
            bridge.mode = (flown.armed, flown.mode)
            self.tell(MissionHeld(self.now_us, name, known, None if read == "nothing" else items))

    def restore(self) -> None:
        """The core goes on from a state on the disk, beside the one that was never stopped."""
        self.met["restored from a state"] += 1
        self.twin = thawed(Frozen({"core": self.core}, self.site.known))["core"]


def _autopilot(site: Site, section: VehicleSection) -> Autopilot:
    x_m, y_m = site.landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    home_m = (float(x_m), float(y_m))
    return Autopilot(
        section.stack, home_m, site.fire_m, section.airspeed_m_s, circle_m=FIRE_M + 50.0
    )


def _in_words(thing: AnyEvent | AnyCommand) -> str:
    """An event or a command, short."""
    at_s = f" at {thing.at_us / 1e6:.2f} s" if hasattr(thing, "at_us") else ""
    fields = thing.__struct_fields__
    told = [repr(getattr(thing, field)) for field in fields if field not in UNSAID]
    words = f"{type(thing).__name__}({', '.join(told)}){at_s}"
    if isinstance(thing, Observed):
        words = f"Observed({thing.vehicle})"
    elif isinstance(thing, UploadMission | ProposeMission):
        words = f"{type(thing).__name__}({thing.vehicle}, {thing.mission_id}, {thing.why!r})"
    elif isinstance(thing, Telemetry):
        words = f"Telemetry({thing.vehicle}, {thing.altitude_relative_m:.0f} m){at_s}"
    return words
