"""What the interfaces of a live run get; HTTP, MQTT, metrics and feeds see nothing else."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.landscape import Landscape
from mission_service.config import Scenario
from mission_service.control import Desk
from mission_service.core import Core
from mission_service.front_flight import FrontFlight
from mission_service.gateway import MissionClock
from mission_service.links import Link
from mission_service.mission_figures import figures_of
from mission_service.picture import Mission, Picture, item_state, mission_hash
from mission_service.record import Record
from mission_service.service import Service
from mission_service.service_config import ServiceSection
from mission_service.world import FireWorld


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
        self.gauges: dict[str, Callable[[], float]] = {}  # what only an interface knows: metrics.py
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
        return [f"{what}: {why}" for what, why in self.not_ready.items()]

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
        fire = self.world.fire
        burned = int(np.count_nonzero(fire.arrival_time_s <= fire.time_s))
        area_ha = burned * self.landscape.cell_size_m**2 / 1e4
        return self.picture.fire(area_ha, self.world.corrections())

    def preview(self, vehicle: str) -> dict[str, Any] | None:
        """The mission a vehicle would be sent now, in figures; nothing is changed by asking.

        None where there is nothing to preview: it was not heard, or its rule makes no missions.
        """
        leader, known = self.core.leader, self.core.vehicles[vehicle]
        here = known.presence.here
        if here is None or not isinstance(leader, FrontFlight):
            return None
        items = leader.preview(known, here)
        if items is None:
            return None
        start_m = (here.x_m, here.y_m) if known.presence.airborne else None
        states = tuple(item_state(item) for item in items)
        named = mission_hash(items)
        at_us, why = self.picture.at_us, "preview"
        mission = Mission(0, at_us, why, why, "", named, states)
        return {
            "mission": mission,
            "figures": figures_of(items, self.landscape, known.section, start_m),
        }

    def burn(self) -> dict[str, Any] | None:
        """Where a burn stands: the leader, the interlock, unit, plan and drops; None without."""
        burn = self.scenario.burn
        if burn is None or self.scenario.planner.rule != "burn":
            return None
        picture = self.picture
        return {
            "schema": "burn/1",
            "at_us": self.clock.now_us,
            **self.service.status(),
            "leader": self.core.leader.status(),
            "go_items": list(burn.go_items),
            "stations": [station.model_dump() for station in burn.stations],
            "plan": picture.plan,
            "plan_hash": picture.plan_hash,
            "drops": picture.drops,
        }
