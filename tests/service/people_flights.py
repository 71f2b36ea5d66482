"""A simulated flight with operators' orders; its journal is closed at the end of a test."""

from collections.abc import Callable, Iterator
from pathlib import Path

from mission_service.commands import (
    AnyCommand,
)
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.replay.verification import verify
from mission_service.simulation.sim import Simulation

Fly = Callable[..., "Flight"]
ANN = ("ann", "desk")
START_S = 3600.0


class Flight:
    """A simulation with operator requests."""

    def __init__(self, path: Path, *overrides: str, rule: str = "islam_hu_damped") -> None:
        settings = ("vehicles.0.airspeed_m_s=18", f'planner.rule="{rule}"', "seed=3", *overrides)
        loaded = load_scenario("demo", settings)
        vehicles = loaded.vehicles if rule.startswith("team.") else loaded.vehicles[:1]
        self.scenario: Scenario = loaded.model_copy(update={"vehicles": vehicles})
        self.landscape = landscape_of(self.scenario)
        header = header_of(self.scenario, self.landscape.digest(), "")
        self.journal = Journal(path, header, durable=False)
        self.sim = Simulation(self.scenario, self.journal, self.landscape)
        self.state_view = self.sim.service.state_view
        self.path = path

    def run(self, seconds: float) -> None:
        self.sim.run_until(self.now_s + seconds)

    @property
    def now_s(self) -> float:
        return self.sim.clock.now_us / 1e6

    @property
    def now_us(self) -> int:
        return self.sim.clock.now_us

    def submit(self, event: AnyOperatorEvent) -> list[str]:
        before = self.state_view.announcement_id
        self.sim.service.submit(event, self.sim.link_us)
        return [line.text for line in self.state_view.announcements_after(before)]

    @property
    def mode(self) -> str:
        return self.state_view.vehicles["hawk"].mode

    def over(self) -> list[AnyEvent | AnyCommand]:
        self.journal.close()
        result = verify(self.path)
        assert result.difference is None, result.difference
        return [entry.content for entry in SegmentReader(self.path)]


def flights_in(folder: Path) -> Iterator[Fly]:
    """Return a function that creates flights, for a fixture; journals are closed at the end."""
    made: list[Flight] = []

    def flight(*overrides: str, rule: str = "islam_hu_damped") -> Flight:
        made.append(Flight(folder / f"{len(made)}.jsonl", *overrides, rule=rule))
        return made[-1]

    yield flight
    for each in made:
        each.journal.close()
