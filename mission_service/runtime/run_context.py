"""Holds the objects of a run that HTTP, MQTT, metrics and Cursor on Target may use."""

import asyncio
import math
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import mapping

from autopilot_bridge.items import Items
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from mission_service.airspace.operational_intent import (
    IntentFrame,
    OperationalIntents,
    intent_of,
)
from mission_service.airspace.volumes import Volume
from mission_service.config.scenario import Scenario
from mission_service.config.service_section import ServiceSection
from mission_service.core.core import Core
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire_arrival.people import People
from mission_service.missions.mission_figures import Figures, figures_of
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.published_states import AirspaceStatus, VolumeState
from mission_service.runtime.request_handler import RequestHandler
from mission_service.runtime.state_view import StateView
from mission_service.runtime.vehicle_links import Link

if TYPE_CHECKING:
    from mission_service.fire.burn_forecast import EstimatedForecasts
    from mission_service.fire.estimated_fire import EstimatedFire
    from mission_service.fire.forecast import Forecasts
    from mission_service.fire_arrival.arrival_times import FireArrival

Floats = NDArray[np.float64]


class RunContext:
    """The scenario, states and request handler of a run, for interfaces."""

    def __init__(
        self,
        scenario: Scenario,
        settings: ServiceSection,
        service: Engine,
        request_handler: RequestHandler,
        clock: MissionClock,
        links: dict[str, Link],
        journal_path: Path,
    ) -> None:
        self.scenario = scenario
        self.settings = settings
        self.service = service
        self.request_handler = request_handler
        self.clock = clock
        self.links = links
        self.journal_path = journal_path
        self.not_ready: dict[str, str] = {}  # unmet conditions by name, with the reasons
        self.stopping = False
        self.gauges: dict[str, Callable[[], float]] = {}  # further metrics, by name
        self.replay: Callable[[], ReplayState] | None = None  # set in a replay of a logged flight
        self.people = People()
        self.arrivals: list[FireArrival] = []  # the fire's arrival at people and values at risk
        self._bell = asyncio.Event()

    @property
    def out(self) -> Path:
        """The folder of the run."""
        return self.journal_path.parent

    @property
    def core(self) -> Core:
        """The core, which makes the decisions of the run."""
        return self.service.core

    @property
    def estimate(self) -> RunEstimate:
        """The estimated fire, which all interfaces show."""
        return self.service.estimate

    @property
    def landscape(self) -> Landscape:
        """The landscape of the fire."""
        return self.service.estimate.landscape

    @property
    def state_view(self) -> StateView:
        """The state for interfaces."""
        return self.service.state_view

    def ready(self) -> list[str]:
        """Return the operating conditions that are not met, one line each."""
        missing = [f"{name}: {why}" for name, why in self.not_ready.items()]
        trouble = self.service.recording.trouble
        return [*missing, f"journal: {trouble}"] if trouble else missing

    def ring(self) -> None:
        """Wake the tasks that wait for changes."""
        bell, self._bell = self._bell, asyncio.Event()
        bell.set()

    async def changed(self, version: int) -> None:
        """Wait until the state view is newer than this version."""
        while self.state_view.version <= version:
            await self._bell.wait()

    def fire(self) -> dict[str, Any]:
        """Return the burned area, the wind and the corrections of the fire (``StateView.fire``)."""
        return self.state_view.fire(self.estimate.fire.burned_ha, self.estimate.corrections())

    @cached_property
    def forecasts(self) -> "Forecasts | EstimatedForecasts":
        """The forecasts of the run's estimate or, in a burn, of the burn's estimated fire.

        All interfaces share them, so that each forecast is computed once.
        """
        if self.estimated_fire is not None:
            from mission_service.fire.burn_forecast import EstimatedForecasts

            def estimated() -> "EstimatedFire":
                assert self.estimated_fire is not None
                return self.estimated_fire

            return EstimatedForecasts(estimated, self.landscape, lambda: self.clock.now_us / 1e6)
        from mission_service.fire.forecast import Forecasts

        return Forecasts(lambda: self.estimate, lambda: self.state_view.fire_version)

    def close(self) -> None:
        """Cancel the forecasts that are being computed; a later use starts new ones."""
        forecasts = self.__dict__.pop("forecasts", None)  # the value of the cached property
        if forecasts is not None:
            forecasts.close()

    @property
    def estimated_fire(self) -> "EstimatedFire | None":
        """The estimated fire used by a burn's plans; None without a burn."""
        return self.core.guidance.estimated_fire

    def weather(self) -> Weather:
        """Return the current weather, from the scenario or as set by operators."""
        at_s, of_burn = self.clock.now_us / 1e6, self.estimated_fire
        return (
            self.estimate.fire.weather.weather_at(at_s)
            if of_burn is None
            else of_burn.weather_at(at_s)
        )

    def airspace(self) -> AirspaceStatus:
        """Return the closed volumes of the run, and the progress of clearing the airspace."""
        volumes = [_volume_state(volume, self.landscape) for volume in self.core.airspace.volumes]
        limit_m = self.scenario.airspace.max_altitude_agl_m
        clearing = self.state_view.clearing
        return AirspaceStatus(self.clock.now_us, volumes, limit_m, clearing)

    def operational_intents(
        self, geoid_height_m: float, for_s: float, unix_us: int
    ) -> OperationalIntents:
        """Return the operational intents of all vehicles, from now until they have landed.

        Args:
            geoid_height_m: Height of the geoid above the WGS84 ellipsoid.
            for_s: Time until the landing of a vehicle without an energy estimate.
            unix_us: The present time in microseconds since 1970.
        """
        section, now_us = self.scenario.airspace, self.clock.now_us
        found = []
        for name, state in self.state_view.vehicles.items():
            must_us = state.must_land_at_us
            left_us = round(for_s * 1e6) if must_us is None else max(must_us - now_us, 0)
            end_us = unix_us + left_us + round(section.lead_s * 1e6)
            margins_m = (section.margin_m, section.vertical_margin_m)
            frame = IntentFrame(*margins_m, geoid_height_m, unix_us, end_us)
            flight = self.core.airspace.intended(name)
            if flight:
                found.append(intent_of(name, flight, frame, self.landscape))
        stated = (geoid_height_m, section.margin_m, section.vertical_margin_m, section.lead_s)
        return OperationalIntents(now_us, *stated, found)

    def preview(self, vehicle: str) -> Items | None:
        """Return the mission that the service would send to the vehicle now, without sending it.

        Returns None before the vehicle's first position, and for a rule without missions.
        """
        state = self.core.vehicles[vehicle]
        fix = state.availability.fix
        return None if fix is None else self.core.guidance.preview(state, fix)

    def figures(self, vehicle: str, items: Items) -> Figures:
        """Return a mission's figures, such as its length, from the vehicle's position."""
        state = self.core.vehicles[vehicle]
        fix = state.availability.fix if state.availability.airborne else None
        start_m = None if fix is None else (fix.x_m, fix.y_m)
        return figures_of(items, self.landscape, state.section, start_m)

    def burn(self) -> dict[str, Any] | None:
        """Return the state of a burn: guidance, interlock, plan and drops; None without a burn."""
        burn = self.scenario.burn_flown
        if burn is None:
            return None
        state_view = self.state_view
        drops = [
            drop for vehicle in state_view.statistics.vehicles.values() for drop in vehicle.drops
        ]
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


def _volume_state(volume: Volume, landscape: Landscape) -> VolumeState:
    def lon_lat(places_m: Floats) -> Floats:
        lat_deg, lon_deg = landscape.lat_lon_of(places_m[:, 0], places_m[:, 1])
        return np.round(np.column_stack([lon_deg, lat_deg]), 7)

    floor_m = volume.floor_m if math.isfinite(volume.floor_m) else None
    ceiling_m = volume.ceiling_m if math.isfinite(volume.ceiling_m) else None
    until_us = round(volume.until_s * 1e6) if math.isfinite(volume.until_s) else None
    geometry = mapping(shapely.transform(volume.area_m, lon_lat))
    return VolumeState(
        volume.name, geometry, floor_m, ceiling_m, round(volume.from_s * 1e6), until_us
    )
