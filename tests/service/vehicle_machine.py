"""The state machine of vehicles for hypothesis: refusals, losses, failsafes, orders, landings.

``test_vehicle_states`` runs it for some thousand steps, ``benchmarks.vehicle_states`` for more.
"""

from collections import Counter
from collections.abc import Callable
from typing import ClassVar

import hypothesis.strategies as st
from hypothesis import HealthCheck, Phase, settings
from hypothesis import seed as seeded
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    rule,
    run_state_machine_as_test,
)

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.core.core import Core
from tests.service.autopilot_model import FAILSAFES, PILOT_MODES
from tests.service.vehicle_flights import Flights
from tests.service.vehicle_oracle import Violation
from tests.service.vehicle_sites import BURNS, SETTINGS

REFUSALS = ("", "", "temporarily rejected", "denied: arming checks")
OUTCOMES = ("accepted", "accepted", "rejected", "failed", "unknown", "cancelled", "superseded")
STEPS_S = (0.1, 0.5, 1.0, 3.0, 10.0, 30.0, 120.0)
WHICH = st.integers(0, 1)  # index of a vehicle of the scenario
READ = st.sampled_from(["same", "same", "other", "nothing", "later"])
WORDS = (
    *("resume", "start", "hold", "return", "resume", "start", "hold all", "start all", "abort"),
    *("land", "land", "go-around", "land all", "takeoff", "takeoff over"),
)


class VehicleMachine(RuleBasedStateMachine):
    """One or two vehicles; the effect of each rule is in ``Flights``."""

    sites: ClassVar[tuple[str, ...]] = (*SETTINGS, *BURNS)
    core: ClassVar[Callable[[Scenario, Landscape], Core]] = Core
    met: ClassVar[Counter[str]] = Counter()
    stories: ClassVar[dict[str, str] | None] = None  # stories of violations; None to raise them
    only: ClassVar[str] = ""  # raise only for this kind

    flights: Flights

    @initialize(data=st.data())
    def begin(self, data: st.DataObject) -> None:
        site = data.draw(st.sampled_from(type(self).sites))
        self.flights = Flights(site, type(self).met, self._found, type(self).core)
        self.flights.all_goes_well(data.draw(st.sampled_from([0, 3, 30, 60])))

    def _found(self, violation: Violation, story: str) -> None:
        cls = type(self)
        cls.met[f"violation: {violation.kind}"] += 1
        words = f"{violation.kind}: {violation.words}\n{story}"
        if cls.stories is not None:
            cls.stories.setdefault(violation.kind, words)
        elif cls.only in ("", violation.kind):
            raise AssertionError(words)

    def _name(self, which: int) -> str:
        """Count a step, and return the name of the vehicle."""
        type(self).met["steps"] += 1
        return self.flights.names[which % len(self.flights.names)]

    @rule(seconds=st.sampled_from(STEPS_S))
    def flies(self, seconds: float) -> None:
        self._name(0)
        self.flights.fly(seconds)

    @rule(seconds=st.sampled_from([1, 3, 20]))
    def all_goes_well(self, seconds: int) -> None:
        self._name(0)
        self.flights.all_goes_well(seconds)

    @rule(which=WHICH, mode=st.sampled_from(PILOT_MODES))
    def pilot_switches(self, which: int, mode: str) -> None:
        self.flights.pilot(self._name(which), mode)

    @rule(which=WHICH, armed=st.booleans())
    def pilot_arms(self, which: int, armed: bool) -> None:
        self.flights.arm(self._name(which), armed)

    @rule(which=WHICH, mode=st.sampled_from(["manual", "altitude", "hold", "mission"]))
    def pilot_takes_off(self, which: int, mode: str) -> None:
        self.flights.takes_off_manually(self._name(which), mode)

    @rule(which=WHICH, seconds=st.sampled_from(STEPS_S))
    def estimator_fails(self, which: int, seconds: float) -> None:
        self.flights.estimator_fails(self._name(which), seconds)

    @rule(which=WHICH, kind=st.sampled_from(sorted(FAILSAFES)))
    def failsafe(self, which: int, kind: str) -> None:
        self.flights.failsafe(self._name(which), kind)

    @rule(which=WHICH, reported=st.booleans())
    def lands(self, which: int, reported: bool) -> None:
        self.flights.lands(self._name(which), reported)

    @rule(which=WHICH, keeps_flying=st.booleans(), heartbeat_first=st.booleans())
    def reboots(self, which: int, keeps_flying: bool, heartbeat_first: bool) -> None:
        self.flights.reboot(self._name(which), keeps_flying, heartbeat_first)

    @rule(which=WHICH, works=st.booleans())
    def link(self, which: int, works: bool) -> None:
        self.flights.link(self._name(which), works)

    @rule(which=WHICH, refused=st.sampled_from(REFUSALS), answers=st.booleans())
    def command_arrives(self, which: int, refused: str, answers: bool) -> None:
        self.flights.deliver(self._name(which), refused, answers)

    @rule(which=WHICH, number=st.integers(0, 2))
    def answer_comes(self, which: int, number: int) -> None:
        self.flights.answer(self._name(which), number)

    @rule(which=WHICH, number=st.integers(0, 2))
    def no_answer(self, which: int, number: int) -> None:
        self.flights.unanswered(self._name(which), number)

    @rule(which=WHICH)
    def upload_begins(self, which: int) -> None:
        self.flights.upload_begins(self._name(which))

    @rule(which=WHICH, outcome=st.sampled_from(OUTCOMES), on_board=st.booleans())
    def upload_ends(self, which: int, outcome: str, on_board: bool) -> None:
        self.flights.upload_ends(self._name(which), outcome, on_board)

    @rule(which=WHICH, word=st.sampled_from(WORDS), confirmed=st.booleans())
    def people_order(self, which: int, word: str, confirmed: bool) -> None:
        name = self._name(which)
        order, _, how = word.partition(" ")
        if order == "abort":
            self.flights.abort()
        else:
            override = "it must fly" if how == "over" else ""
            self.flights.order("" if how == "all" else name, order, confirmed, override)  # type: ignore[arg-type]

    @rule()
    def operators_fly_on(self) -> None:
        self._name(0)
        self.flights.operators_fly_on()

    @rule(which=WHICH)
    def renew(self, which: int) -> None:
        self.flights.renew(self._name(which))

    @rule(which=WHICH, accepts=st.booleans(), newest=st.booleans())
    def word_on_mission(self, which: int, accepts: bool, newest: bool) -> None:
        self.flights.word_on_mission(self._name(which), accepts, newest)

    @rule(down_s=st.sampled_from([1.0, 30.0, 600.0]), killed=st.booleans(), read=READ)
    def restart(self, down_s: float, killed: bool, read: str) -> None:
        self._name(0)
        self.flights.restart(down_s, killed, read)

    @rule(which=WHICH, order=st.sampled_from(["hold", "resume", "return", "start"]))
    def killed_before_sending(self, which: int, order: str) -> None:
        self.flights.kill_before_sending(self._name(which), order)  # type: ignore[arg-type]

    @rule(read=READ)
    def read_back(self, read: str) -> None:
        self._name(0)
        self.flights.read_back(read)

    @rule(which=WHICH, speed_m_s=st.sampled_from([0.0, 5.0, 14.0]))
    def wind(self, which: int, speed_m_s: float) -> None:
        self.flights.wind(self._name(which), speed_m_s)

    @rule(there=st.booleans())
    def operators_of_a_burn(self, there: bool) -> None:
        self._name(0)
        self.flights.operators_present = there

    @rule()
    def restore(self) -> None:
        self._name(0)
        self.flights.restore()


def run(
    machine: type[VehicleMachine], examples: int, steps: int, seed: int, shrinks: bool = False
) -> None:
    """Run a machine from a seed; raises AssertionError with the steps to the first violation."""
    phases = (Phase.generate, Phase.shrink) if shrinks else (Phase.generate,)
    run_state_machine_as_test(
        seeded(seed)(machine),
        settings=settings(
            max_examples=examples,
            stateful_step_count=steps,
            phases=phases,
            database=None,
            deadline=None,
            print_blob=False,
            suppress_health_check=list(HealthCheck),
        ),
    )
