"""The way of flying a burn: a copter ignites lines that operators approve one by one."""

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.message_rates import DROP_RATES_HZ
from autopilot_bridge.vehicle.orders import Dropper, drop
from mission_service.config.scenario import Scenario
from mission_service.guidance.burn.requests import REQUESTS
from mission_service.guidance.way_of_flying import WayOfFlying, later


def _check(scenario: Scenario) -> None:
    """Raise ValueError unless the scenario has a burn and one vehicle that can ignite lines."""
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
        raise ValueError('rule = "burn" is for one vehicle; remove the other vehicles')


FOLDER = __package__
INTERLOCK = later(f"{FOLDER}.interlock:interlock_of")
BURN = WayOfFlying(
    rules=("burn",),
    guidance=later(f"{FOLDER}.controller:BurnFlight"),
    warm_up=later(f"{FOLDER}.warm_up:warm_up"),
    check=_check,
    prescribed=True,
    requests=REQUESTS,
    rates_hz=DROP_RATES_HZ,
    return_height_m=later(f"{FOLDER}.plan_mission:return_height_m"),
    lock=lambda scenario, land: None if scenario.burn is None else INTERLOCK(scenario.burn, land),
)
