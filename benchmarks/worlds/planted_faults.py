"""Faults that the checker of random worlds must find; they are injected into the core."""

from dataclasses import replace

import numpy as np

from benchmarks.worlds.light_flight import Fault
from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.core.core import Core
from mission_service.vehicles.vehicle_state import Vehicle

LOWER_M, LATE_S = 30.0, 60.0


def _with_airspace(scenario: Scenario, **changes: object) -> Scenario:
    airspace = scenario.airspace.model_copy(update=changes)
    return scenario.model_copy(update={"airspace": airspace})


def _lower(scenario: Scenario) -> Scenario:
    vehicles = tuple(
        vehicle.model_copy(update={"altitude_agl_m": vehicle.altitude_agl_m - LOWER_M})
        for vehicle in scenario.vehicles
    )
    return scenario.model_copy(update={"vehicles": vehicles})


def _level(landscape: Landscape) -> Landscape:
    """Return the landscape with level ground, at the mean height."""
    assert landscape.elevation_m is not None
    mean_m = float(np.mean(landscape.elevation_m))
    return replace(
        landscape,
        elevation_m=np.full_like(landscape.elevation_m, mean_m),
        gradient=np.zeros_like(landscape.gradient),
    )


def _unchecked(core: Core) -> None:
    """Send commands without a check."""
    core.airspace.checked = lambda commands, at_s, accepted=False: list(commands)  # type: ignore[method-assign]


def _unwatched(core: Core) -> None:
    """Do not check flights under way."""
    core.airspace.watch = lambda vehicle, at_s: []  # type: ignore[method-assign]


def _late(core: Core) -> None:
    """Check flights under way ``LATE_S`` late."""
    watch = core.airspace.watch
    since_s: dict[str, float] = {}

    def later(vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        alarmed = bool(core.airspace.flight_obstacle(vehicle, vehicle.availability.fix))  # type: ignore[arg-type]
        if not alarmed:
            since_s.pop(vehicle.name, None)
        elif at_s - since_s.setdefault(vehicle.name, at_s) < LATE_S:
            return []
        return watch(vehicle, at_s)

    core.airspace.watch = later  # type: ignore[method-assign]


def _straight_home(core: Core) -> None:
    """Do not compare returns with the ground."""
    core.return_ground.obstacle = lambda *_: None  # type: ignore[method-assign]


def _both(core: Core) -> None:
    _unchecked(core)
    _unwatched(core)


FAULTS = (
    Fault("no airspace checks", core=_both),
    Fault("commands not checked", core=_unchecked),
    Fault("flights under way not checked", core=_unwatched),
    Fault(f"evasions {LATE_S:.0f} s late", core=_late),
    Fault("margin 0", scenario=lambda scenario: _with_airspace(scenario, margin_m=0.0)),
    Fault(
        "vertical margin 0",
        scenario=lambda scenario: _with_airspace(scenario, vertical_margin_m=0.0),
    ),
    Fault("lead time 0", scenario=lambda scenario: _with_airspace(scenario, lead_s=0.0)),
    Fault(f"missions {LOWER_M:.0f} m lower", scenario=_lower),
    Fault("terrain ignored", landscape=_level),
    Fault("returns not compared with the ground", core=_straight_home),
)
