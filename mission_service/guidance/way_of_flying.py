"""The interface of a way of flying; each folder defines its own in ``way.py``.

Fast to import, since every scenario is checked with it: flight code is imported when called.
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
    """Return the function at ``module:name``, imported when it is called for the first time."""
    return lambda *given: resolve_name(address)(*given)


FIRST_MISSION = later("mission_service.missions.approach:approach_mission")  # to the fire


@dataclass(frozen=True, slots=True)
class WayOfFlying:
    """A way of flying.

    Attributes:
        rules: the values of ``planner.rule``.
        guidance: makes the guidance of a run.
        warm_up: compiles all kernels before the first flight.
        section: the model of the table in the scenario that has the rule's name.
        check: raises ValueError for a scenario that cannot be flown.
        first_mission: the first mission of a vehicle that stands at home.
        along_front: its planners decide which way to fly, and missions are renewed as the front
            moves.
        prescribed: it burns the unit of the table ``[burn]``: operators approve each plan, and
        their corrections change the estimated fire, not the real one. resumes_mission: on a resume
        command a vehicle flies the mission on board, not a new one. messages_peers: its vehicles
        exchange messages with those of other processes. changes_airspeed: it orders airspeeds up to
        a vehicle's ``max_airspeed_m_s``. requests: what operators may request beside
        ``OF_EVERY_RUN``. rates_hz: message rates other than the usual ones, by the message's id.
        return_height_m: safe height above home of a return; None: the autopilot's own setting.
        lock: the last check of commands, if the scenario's tables need one.
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
    prescribed: bool = False
    resumes_mission: bool = False
    messages_peers: bool = False
    changes_airspeed: bool = False
    requests: tuple[type[Request], ...] = OF_VEHICLES
    rates_hz: Mapping[int, float] = field(default_factory=dict)
    return_height_m: "Callable[[Scenario, Landscape], float | None]" = lambda scenario, land: None
    lock: "Callable[[Scenario, Landscape], Lock | None]" = lambda scenario, land: None
