"""Which forecasts are those of a run."""

from typing import TYPE_CHECKING

from mission_service.maps.forecast import Forecasts
from mission_service.planning import BURN

if TYPE_CHECKING:
    from mission_service.hub import Hub
    from mission_service.maps.believed import BelievedForecasts


def forecasts_of(hub: "Hub") -> "Forecasts | BelievedForecasts":
    """Of the fire that burns; in a burn of the one that its plans are made on."""
    if hub.scenario.planner.rule == BURN:
        from mission_service.burn_flight import BurnFlight  # not for all who start
        from mission_service.maps.believed import BelievedForecasts

        leader = hub.core.leader
        assert isinstance(leader, BurnFlight)
        return BelievedForecasts(leader.state.fire, hub.landscape, lambda: hub.clock.now_us / 1e6)
    return Forecasts(lambda: hub.world.fire, lambda: hub.picture.fire_version, hub.scenario.seed)
