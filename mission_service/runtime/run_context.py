"""The context of a live run: all that HTTP, MQTT, metrics and Cursor on Target may use."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot_bridge.items import Items
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from mission_service.config.scenario import Scenario
from mission_service.config.service import ServiceSection
from mission_service.core.core import Core
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.missions.mission_figures import Figures, figures_of
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.request_handler import RequestHandler
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView
from mission_service.runtime.vehicle_links import Link

if TYPE_CHECKING:
    from mission_service.fire.estimated_fire import EstimatedFire


class RunContext:
    """One live run: scenario, state for interfaces, and the handler of operators' requests."""

    def __init__(
        self,
        scenario: Scenario,
        settings: ServiceSection,
        service: Engine,
        state_view: StateView,
        request_handler: RequestHandler,
        clock: MissionClock,
        links: dict[str, Link],
        journal_path: Path,
    ) -> None:
        self.scenario = scenario
        self.settings = settings
        self.service = service
        self.state_view = state_view
        self.request_handler = request_handler
        self.clock = clock
        self.links = links
        self.journal_path = journal_path
        self.not_ready: dict[str, str] = {}  # what the service lacks, and why
        self.stopping = False
        self.gauges: dict[
            str, Callable[[], float]
        ] = {}  # of single interfaces, for interfaces/metrics.py
        self.replay: Callable[[], ReplayState] | None = None  # in a replay of a logged flight
        self._bell = asyncio.Event()

    @property
    def out(self) -> Path:
        """The folder of the run."""
        return self.journal_path.parent

    @property
    def core(self) -> Core:
        """The core."""
        return self.service.core

    @property
    def world(self) -> SimulatedFire:
        """The simulated fire."""
        return self.service.world

    @property
    def landscape(self) -> Landscape:
        """The landscape of the fire."""
        return self.service.world.landscape

    @property
    def record(self) -> RunStatistics:
        """Tracks and figures of the vehicles."""
        return self.service.record

    def ready(self) -> list[str]:
        """What the service lacks for its work, a line each; empty if it is ready."""
        lacks = [f"{what}: {why}" for what, why in self.not_ready.items()]
        trouble = self.service.recording.trouble
        return [*lacks, f"journal: {trouble}"] if trouble else lacks

    def ring(self) -> None:
        """Wake the tasks that wait for changes."""
        bell, self._bell = self._bell, asyncio.Event()
        bell.set()

    async def changed(self, version: int) -> None:
        """Wait until the state view is newer than this version."""
        while self.state_view.version <= version:
            await self._bell.wait()

    def fire(self) -> dict[str, Any]:
        """Return the figures of the fire."""
        return self.state_view.fire(self.world.fire.burned_ha, self.world.corrections())

    @property
    def estimated_fire(self) -> "EstimatedFire | None":
        """The estimated fire that a burn's plans use; None without a burn."""
        return self.core.guidance.estimated_fire

    def weather(self) -> Weather:
        """Return the weather now, of the scenario or as operators set it."""
        at_s, believed = self.clock.now_us / 1e6, self.estimated_fire
        return self.world.fire.weather.at(at_s) if believed is None else believed.weather_at(at_s)

    def preview(self, vehicle: str) -> Items | None:
        """Return the mission that the vehicle would be sent now, without any effect.

        None before the vehicle is connected, and where its rule makes no missions.
        """
        known = self.core.vehicles[vehicle]
        fix = known.availability.fix
        return None if fix is None else self.core.guidance.preview(known, fix)

    def figures(self, vehicle: str, items: Items) -> Figures:
        """Return the figures of a mission, flown from the vehicle's present position."""
        known = self.core.vehicles[vehicle]
        fix = known.availability.fix if known.availability.airborne else None
        start_m = None if fix is None else (fix.x_m, fix.y_m)
        return figures_of(items, self.landscape, known.section, start_m)

    def burn(self) -> dict[str, Any] | None:
        """Return guidance, interlock, unit, plan and drops of a burn; None without a burn."""
        burn = self.scenario.burn_flown
        if burn is None:
            return None
        state_view = self.state_view
        drops = [drop for vehicle in self.record.vehicles.values() for drop in vehicle.drops]
        return {
            "schema": "burn/1",
            "at_us": self.clock.now_us,
            **self.service.status(),
            "guidance": self.core.guidance.status(),
            "go_items": list(burn.go_items),
            "stations": [station.model_dump() for station in burn.stations],
            "plan": state_view.plan,
            "plan_hash": state_view.plan_hash,
            "drops": drops,
        }
