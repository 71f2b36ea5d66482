"""The interface of a way of flying; each folder of ``guidance`` defines one in ``way.py``.

Every check of a scenario imports this module. To keep the import fast, flight code is imported only
when it is called.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from mission_service.requests import OF_VEHICLES, Request

if TYPE_CHECKING:
    from autopilot_bridge.items import MissionItem
    from firemodel.landscape.landscape import Landscape
    from mission_service.config.scenario import Scenario
    from mission_service.config.sections import VehicleSection
    from mission_service.guidance.protocol import Guidance, Lock
    from mission_service.vehicles.missions_sent import MissionsSent
    from mission_service.vehicles.traffic import TrafficManager


def later(address: str) -> Callable[..., Any]:
    """Return a function that, when called, imports and calls the function at ``module:name``."""
    return lambda *given: resolve_name(address)(*given)


# The mission to the fire.
FIRST_MISSION = later("mission_service.missions.first_mission:approach_mission")


@dataclass(frozen=True, slots=True)
class WayOfFlying:
    """A way of flying, with the functions that create its parts.

    Attributes:
        rules: The values of ``planner.rule`` that select this way of flying.
        guidance: Creates the guidance of a run.
        warm_up: Compiles all kernels before the first flight.
        section: The model of the scenario table named after the rule.
        check: Raises ValueError for a scenario that cannot be flown.
        first_mission: Creates the first mission of a vehicle that is at home.
        along_front: Whether planners decide the direction, and missions are replaced as the front
            moves.
        reads_fronts: Whether planners use the fronts of the estimated fire (``FrontsEstimated``).
        prescribed: Whether vehicles ignite the unit in the table ``[burn]``. Operators then approve
            each plan, and their corrections change the estimated fire, not the simulated fire.
        resumes_mission: Whether a vehicle that is ordered to resume flies the mission on board
            instead of a new mission.
        messages_peers: Whether vehicles exchange messages with vehicles of other processes.
        changes_airspeed: Whether guidance commands airspeeds up to a vehicle's
            ``max_airspeed_m_s``.
        requests: The operator requests that are possible in addition to ``OF_EVERY_RUN``.
        rates_hz: The message rates that differ from the defaults, by message id.
        relieves: Whether vehicles may relieve each other: each has a separate planner, which one
            vehicle hands over to the next.
        return_height_m: Computes the safe height above home for a return. None keeps the
            autopilot's setting.
        lock: Creates the lock, the last check of commands, if the scenario's tables need one.
    """

    rules: tuple[str, ...]
    guidance: "Callable[[Scenario, Landscape, TrafficManager, MissionsSent], Guidance]"
    warm_up: "Callable[[Scenario, Landscape], None]"
    section: type[BaseModel] | None = None
    check: "Callable[[Scenario], None]" = lambda scenario: None
    first_mission: "Callable[[Scenario, VehicleSection, Landscape], tuple[MissionItem, ...]]" = (
        FIRST_MISSION
    )
    along_front: bool = False
    reads_fronts: bool = False
    prescribed: bool = False
    resumes_mission: bool = False
    messages_peers: bool = False
    changes_airspeed: bool = False
    relieves: bool = False
    requests: tuple[type[Request], ...] = OF_VEHICLES
    rates_hz: Mapping[int, float] = field(default_factory=dict)
    return_height_m: "Callable[[Scenario, Landscape], float | None]" = lambda scenario, land: None
    lock: "Callable[[Scenario, Landscape], Lock | None]" = lambda scenario, land: None
