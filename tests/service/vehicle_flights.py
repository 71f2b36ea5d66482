"""Events of vehicles, links, service and operators, each as one step.

``vehicle_machine`` selects the steps by hypothesis.
"""

from mission_service.events import (
    Aborted,
    AutopilotText,
    CommandFinished,
    EstimatorStatusChanged,
    LinkLost,
    MissionAccepted,
    MissionReadBack,
    MissionRefused,
    MissionRequested,
    ModeChanged,
    Order,
    OrderGiven,
    PlanRequested,
    Resumed,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.guidance.formation.way import FORMATION
from mission_service.guidance.registry import way_of
from mission_service.journal.snapshot import Frozen, restore
from tests.service.autopilot_model import NAMES, Bridge
from tests.service.vehicle_oracle import Violation
from tests.service.vehicle_turns import Turns

RECOVERS_WITHIN_S, ORDERS_AGAIN_S = 300, 100
SERVICE_STARTS_S = 2.0


class Flights(Turns):
    """Vehicles in the air and on the ground, and the service that flies them."""

    # The vehicles -----------------------------------------------------------------------------

    def pilot(self, name: str, mode: str) -> None:
        """Let a pilot change the mode by radio, in the air or armed on the ground."""
        self.bridges[name].autopilot.change(mode, "pilot")
        self.step()

    def arm(self, name: str, armed: bool) -> None:
        """Let a pilot arm by radio, or disarm on the ground."""
        flown = self.bridges[name].autopilot
        if armed:
            flown.armed = True
            flown.chosen_by = "pilot"
        else:
            flown.land()
        self.step()

    def takes_off_manually(self, name: str, mode: str) -> None:
        """Let a pilot take off by radio."""
        flown = self.bridges[name].autopilot
        flown.armed, flown.height_m = True, max(flown.height_m, 60.0)
        flown.change(mode, "pilot")
        self.fly(1.0)

    def failsafe(self, name: str, kind: str) -> None:
        """Let the autopilot change the mode by itself in the air."""
        flown = self.bridges[name].autopilot
        if flown.armed and flown.in_air:
            self.met[f"failsafe: {kind}"] += 1
            flown.fail(kind)
            if self.bridges[name].linked:
                self.process(AutopilotText(self.now_us, name, 2, f"{kind}: {flown.mode}"))
        self.step()

    def estimator_fails(self, name: str, seconds: float) -> None:
        """Let the autopilot's estimator be unhealthy for a while."""
        if not self.bridges[name].linked:
            return
        problem = ("attitude",)
        self.process(EstimatorStatusChanged(self.now_us, name, False, problem))
        self.fly(seconds)
        self.process(EstimatorStatusChanged(self.now_us, name, True, ()))

    def wind(self, name: str, speed_m_s: float) -> None:
        """Let the autopilot measure the wind."""
        if self.bridges[name].linked:
            self.process(WindMeasured(self.now_us, name, speed_m_s, 270.0))
        self.step()

    def lands(self, name: str, reported: bool) -> None:
        """Land the vehicle and disarm it, with or without positions on the way."""
        flown = self.bridges[name].autopilot
        if flown.in_air and reported:
            flown.height_m = 5.0
            self.fly(0.5)
        flown.land()
        self.step()

    def reboot(self, name: str, keeps_flying: bool, heartbeat_first: bool) -> None:
        """Restart the autopilot; its commands in progress end without success."""
        bridge = self.bridges[name]
        bridge.autopilot.reboot(keeps_flying and bridge.autopilot.armed)
        if not bridge.linked:
            return
        if heartbeat_first:
            self._heartbeat(name, bridge)
        self.process(VehicleRebooted(self.now_us, name))
        ended, bridge.commands = bridge.commands, []
        for sent in ended:
            self._ended(name, sent, "the autopilot was restarted")
        self.step()

    # Links and answers ------------------------------------------------------------------------

    def link(self, name: str, works: bool) -> None:
        """Stop or restore the heartbeats."""
        bridge = self.bridges[name]
        if bridge.linked and not works:
            bridge.linked, bridge.lost = False, True
            self.now_us += 3_000_000
            self.process(LinkLost(self.now_us, name, 3.0))
        bridge.linked = works
        self.step()

    def deliver(self, name: str, refused: str, answers: bool) -> None:
        """Deliver a command; its reply arrives before the mode change, or later."""
        bridge = self.bridges[name]
        if bridge.linked:
            bridge.deliver(refused)
            if answers:
                self._answer(name, bridge, 0)
        self.step()

    def answer(self, name: str, number: int) -> None:
        """Report the reply to any command that arrived, however long ago."""
        self._answer(name, self.bridges[name], number)
        self.step()

    def _answer(self, name: str, bridge: Bridge, number: int) -> None:
        arrived = [each for each in bridge.commands if each.answer is not None]
        if arrived:
            sent = arrived[number % len(arrived)]
            bridge.commands.remove(sent)
            command, reason = NAMES[type(sent.command)], sent.answer or "accepted"
            self.process(CommandFinished(self.now_us, name, command, not sent.answer, reason))

    def unanswered(self, name: str, number: int) -> None:
        """Lose a command or its reply: the bridge stops waiting."""
        bridge = self.bridges[name]
        if bridge.commands:
            self.met["command without an answer"] += 1
            sent = bridge.commands.pop(number % len(bridge.commands))
            self._ended(name, sent, "was not answered")
        self.step()

    def upload_begins(self, name: str) -> None:
        """Begin an upload, during which ArduPilot holds."""
        if self.bridges[name].linked:
            self.bridges[name].pause()
        self.step()

    def upload_ends(self, name: str, outcome: str, on_board: bool) -> None:
        """End the oldest upload; with ``on_board`` the vehicle has the mission anyway."""
        bridge = self.bridges[name]
        upload = bridge.finish(outcome, on_board)
        if upload is not None:
            self.met[f"upload {outcome}"] += 1
            mission_id = upload.mission_id
            self.process(UploadFinished(self.now_us, name, mission_id, outcome, "because"))
        self.step()

    def all_goes_well(self, seconds: int) -> None:
        """For some seconds deliver all commands, and accept all of them."""
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

    def operators_fly_on(self) -> None:
        """Let operators order all vehicles to fly; all must then soon fly missions again."""
        if self.operators is not None:
            self.operators_present = True
            self.renew("")
            self.all_goes_well(10)
            return
        for name, bridge in self.bridges.items():
            bridge.autopilot.trouble = ""
            self.link(name, True)
        for second in range(RECOVERS_WITHIN_S):
            # A vehicle that landed in the meantime waits for an operator.
            if second % ORDERS_AGAIN_S == 0:
                self.order("", "resume", True)
                self.order("", "start", True)
                for name in self.bridges:  # a vehicle that landed far from home
                    self.order(name, "takeoff", False, "it must fly")
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
        orbits = way_of(self.site.scenario) is FORMATION and flown.chosen_by == "service"
        modes = ("mission", "hold", "guided") if orbits else ("mission",)
        return flown.armed and flown.in_air and flown.mode in modes

    # People -----------------------------------------------------------------------------------

    def order(self, name: str, order: Order, confirmed: bool, override: str = "") -> None:
        """Send an order to one vehicle, or to all without a name; a burn has no such order."""
        if self.operators is None:
            given = OrderGiven(self.now_us, "ann", "", name, order, confirmed, override=override)
            self.process(given)
        self.step()

    def abort(self) -> None:
        """Let an operator abort."""
        self.process(Aborted(self.now_us, "ann", ""))
        self.step()

    def renew(self, name: str) -> None:
        """Let an operator request another mission, or another plan of a burn."""
        if self.operators is None:
            self.process(MissionRequested(self.now_us, "ann", "", name))
        else:
            self.process(PlanRequested(self.now_us, "ann", ""))
        self.step()

    def word_on_mission(self, name: str, accepts: bool, newest: bool) -> None:
        """Let an operator accept or refuse a mission that is, or was never, proposed."""
        if self.operators is not None:
            return
        named = self.proposed.get(name, "") if newest else "0" * 64
        kind = MissionAccepted if accepts else MissionRefused
        self.process(kind(self.now_us, "ann", "", name, named))
        self.step()

    # The service ------------------------------------------------------------------------------

    def restart(self, down_s: float, killed: bool, read: str) -> None:
        """Restart the service after a kill or after a full disk; commands are answered afterwards.

        ``read`` is the mission that is read back: the same, another, none, or later.
        """
        self.met["killed" if killed else "disk full"] += 1
        for bridge in self.bridges.values():
            bridge.autopilot.fly(down_s)
            bridge.restart(killed)
        if killed:
            self._replaced.clear()
        self.now_us += round(down_s * 1e6)
        self.process(Resumed(self.now_us, "service", "", down_s))
        if not killed:
            for name, bridge in self.bridges.items():
                if bridge.connected and not bridge.lost:
                    stack = bridge.autopilot.stack
                    self.process(VehicleConnected(self.now_us, name, stack, stack == "px4"))
        self.step(SERVICE_STARTS_S)
        if read != "later":
            self.read_back(read)

    def kill_before_sending(self, name: str, order: Order) -> None:
        """Kill the service when an event is journalled, but its commands are not."""
        event = OrderGiven(self.now_us, "ann", "", name, order, True)
        aborted = Aborted(self.now_us, "ann", "")
        self.process(event if self.operators is None else aborted, carried_out=False)
        self.restart(1.0, True, "same")

    def read_back(self, read: str) -> None:
        """Report the missions on board of the vehicles that are connected."""
        for name, bridge in self.bridges.items():
            if not (bridge.reads_back and bridge.linked):
                continue
            bridge.reads_back = False
            flown = bridge.autopilot
            mission_id, items = (flown.mission, 3) if read == "same" else (0, 3)
            self.process(ModeChanged(self.now_us, name, 0, flown.armed, flown.mode))
            bridge.mode = (flown.armed, flown.mode)
            self.process(
                MissionReadBack(self.now_us, name, mission_id, None if read == "nothing" else items)
            )

    def restore(self) -> None:
        """Continue from a snapshot on the disk, beside the core that was never stopped."""
        self.met["restored from a state"] += 1
        self.twin = restore(Frozen({"core": self.core}, self.site.shared))["core"]
