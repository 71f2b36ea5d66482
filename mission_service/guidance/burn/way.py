"""The way of flying a prescribed burn: a copter drops lines that people approve one by one."""

from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.orders import Dropper, drop
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.guidance.front.way import to_the_fire
from mission_service.guidance.protocol import Guidance, WayOfFlying
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import Spacing

if TYPE_CHECKING:
    from mission_service.guidance.burn.interlock import Interlock


def _check(scenario: Scenario) -> None:
    """Raise ValueError unless there is a burn and one vehicle that can drop its lines."""
    burn, vehicles = scenario.burn, scenario.vehicles
    if burn is None:
        raise ValueError('rule = "burn" needs a table [burn]')
    for vehicle in vehicles:
        if vehicle.kind != "copter" or vehicle.backend != "native":
            raise ValueError(f'{vehicle.name}: rule = "burn" is for a copter with backend "native"')
        try:
            drop(stack_named(vehicle.stack, vehicle.kind), Dropper(*burn.dropper.output))
        except BridgeError as error:
            raise ValueError(f"{vehicle.name}: burn.dropper: {error}") from None
    if len(vehicles) > 1:
        raise ValueError('rule = "burn" is for one vehicle: others would fly in each other\'s fire')


def _guidance(
    scenario: Scenario, landscape: Landscape, spacing: Spacing, missions: MissionsSent
) -> Guidance:
    from mission_service.guidance.burn.controller import BurnFlight

    return BurnFlight(scenario, landscape, missions)


def _warm_up(scenario: Scenario, landscape: Landscape) -> None:
    from mission_service.guidance.burn.warm_up import warm_up

    warm_up(scenario, landscape)


def _return_height_m(scenario: Scenario, landscape: Landscape) -> float | None:
    from mission_service.guidance.burn.mission import return_height_m

    return return_height_m(scenario, landscape)


def interlock_of(scenario: Scenario, landscape: Landscape) -> "Interlock | None":
    """The last lock of a burn; it knows the unit from the scenario, or from its file."""
    burn = scenario.burn
    if burn is None:
        return None
    from mission_service.guidance.burn.interlock import Interlock

    if burn.unit_file is None:
        return Interlock(burn)
    from firemodel.landscape.readers.shapes import read_shapes

    def lon_lat(places: NDArray[np.float64]) -> NDArray[np.float64]:
        lat, lon = landscape.lat_lon_of(places[:, 0], places[:, 1])
        return np.column_stack([lon, lat])

    unit = shapely.union_all(read_shapes(burn.unit_file, landscape))
    return Interlock(burn, shapely.transform(unit, lon_lat))


BURN = WayOfFlying(
    rules=("burn",),
    guidance=_guidance,
    warm_up=_warm_up,
    first_mission=to_the_fire,
    check=_check,
    prescribed=True,
    rates_hz={
        # At 5 m/s half a metre: what is dropped is dropped when a position comes.
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    },
    return_height_m=_return_height_m,
    lock=interlock_of,
)
