"""The way of flying in a formation, in which fixed-wing UAVs loiter around the fire."""

from mission_service.config.scenario import Scenario
from mission_service.guidance.way_of_flying import WayOfFlying, later


def _check(scenario: Scenario) -> None:
    """Raise ValueError unless all vehicles can fly in a formation."""
    for vehicle in scenario.vehicles:
        if vehicle.kind != "plane":
            raise ValueError(f'{vehicle.name}: rule = "formation" is for planes, not for a copter')
        if vehicle.backend != "native":
            raise ValueError(
                f'{vehicle.name}: rule = "formation" needs backend = "native"; with MAVSDK, '
                "vehicles fly only missions and no orbits"
            )


FOLDER = __package__
FORMATION = WayOfFlying(
    rules=("formation",),
    guidance=later(f"{FOLDER}.controller:FormationFlight"),
    warm_up=later(f"{FOLDER}.warm_up:warm_up"),
    first_mission=later(f"{FOLDER}.waiting_places:mission_to_place"),
    check=_check,
    resumes_mission=True,
    messages_peers=True,
    changes_airspeed=True,
)
