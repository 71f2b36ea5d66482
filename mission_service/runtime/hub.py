"""What the interfaces of a live run get; HTTP, MQTT, metrics and feeds see nothing else."""

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
from mission_service.fire.simulated import FireWorld
from mission_service.guidance.front.controller import FrontFlight
from mission_service.missions.mission_figures import Figures, figures_of
from mission_service.runtime.engine import Service
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.links import Link
from mission_service.runtime.picture import DropState, Picture
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.record import Record
from mission_service.runtime.request_handler import Desk

if TYPE_CHECKING:
    from mission_service.fire.estimated import BelievedFire


class Hub:
    """One live run: what it flies, what is known of it, and where people's requests go."""

    def __init__(
        self,
        scenario: Scenario,
        settings: ServiceSection,
        service: Service,
        picture: Picture,
        desk: Desk,
        clock: MissionClock,
        links: dict[str, Link],
        out: Path,
        journal_path: Path,
    ) -> None:
        self.scenario = scenario
        self.settings = settings
        self.service = service
        self.picture = picture
        self.desk = desk
        self.clock = clock
        self.links = links
        self.out = out
        self.journal_path = journal_path
        self.not_ready: dict[str, str] = {}  # what is still missing, and why
        self.stopping = False
        self.gauges: dict[
            str, Callable[[], float]
        ] = {}  # what only an interface knows: interfaces/metrics.py
        self.replay: Callable[[], ReplayState] | None = None  # in a replay of a logged flight
        self._bell = asyncio.Event()

    @property
    def core(self) -> Core:
        """What decides."""
        return self.service.core

    @property
    def world(self) -> FireWorld:
        """The fire."""
        return self.service.world

    @property
    def landscape(self) -> Landscape:
        """Where it burns."""
        return self.service.world.landscape

    @property
    def record(self) -> Record:
        """Tracks and counts."""
        return self.service.record

    def ready(self) -> list[str]:
        """What is still missing before the service does its work; empty: nothing."""
        lacks = [f"{what}: {why}" for what, why in self.not_ready.items()]
        trouble = self.service.recording.trouble
        return [*lacks, f"journal: {trouble}"] if trouble else lacks

    def ring(self) -> None:
        """Wake those who wait for changes, if there are any."""
        bell, self._bell = self._bell, asyncio.Event()
        bell.set()

    async def changed(self, version: int) -> None:
        """Return when the picture is newer than this."""
        while self.picture.version <= version:
            await self._bell.wait()

    def fire(self) -> dict[str, Any]:
        """The fire in figures."""
        return self.picture.fire(self.world.fire.burned_ha, self.world.corrections())

    @property
    def believed(self) -> "BelievedFire | None":
        """The fire that a burn's plans are made on; None where nothing is burned on purpose."""
        if self.scenario.burn_flown is None:
            return None
        from mission_service.guidance.burn.controller import BurnFlight  # not for all who start

        leader = self.core.leader
        assert isinstance(leader, BurnFlight)
        return leader.state.fire

    def weather(self) -> Weather:
        """What is reckoned with now, as the scenario has it or people have told."""
        at_s, believed = self.clock.now_us / 1e6, self.believed
        return self.world.fire.weather.at(at_s) if believed is None else believed.weather_at(at_s)

    def preview(self, vehicle: str) -> Items | None:
        """The mission a vehicle would be sent now; asking changes nothing.

        None where there is nothing to preview: it was not heard, or its rule makes no missions.
        """
        leader, known = self.core.leader, self.core.vehicles[vehicle]
        here = known.presence.here
        if here is None or not isinstance(leader, FrontFlight):
            return None
        return leader.preview(known, here)

    def figures(self, vehicle: str, items: Items) -> Figures:
        """What a mission of a vehicle leads to, from where it is now."""
        known = self.core.vehicles[vehicle]
        here = known.presence.here if known.presence.airborne else None
        start_m = None if here is None else (here.x_m, here.y_m)
        return figures_of(items, self.landscape, known.section, start_m)

    def burn(self) -> dict[str, Any] | None:
        """Where a burn stands: the leader, the interlock, unit, plan and drops; None without."""
        burn = self.scenario.burn_flown
        if burn is None:
            return None
        picture = self.picture
        drops = [
            DropState(drop.at_us, name, drop.plan_hash, drop.number, *drop.place, drop.outcome)
            for name, vehicle in self.record.vehicles.items()
            for drop in vehicle.drops
        ]
        return {
            "schema": "burn/1",
            "at_us": self.clock.now_us,
            **self.service.status(),
            "leader": self.core.leader.status(),
            "go_items": list(burn.go_items),
            "stations": [station.model_dump() for station in burn.stations],
            "plan": picture.plan,
            "plan_hash": picture.plan_hash,
            "drops": drops,
        }
