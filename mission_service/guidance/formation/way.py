"""The way of flying in a formation: fixed wings that loiter around the fire."""

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.guidance.protocol import Guidance, WayOfFlying
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import Spacing


def _check(scenario: Scenario) -> None:
    """Raise ValueError unless all vehicles can fly in a formation."""
    for vehicle in scenario.vehicles:
        if vehicle.kind != "plane":
            raise ValueError(f'{vehicle.name}: rule = "formation" is for planes, not a copter')
        if vehicle.backend != "native":
            raise ValueError(
                f'{vehicle.name}: rule = "formation" needs backend = "native"; through MAVSDK '
                "vehicles fly missions only, no orbits"
            )


def _guidance(
    scenario: Scenario, landscape: Landscape, spacing: Spacing, missions: MissionsSent
) -> Guidance:
    from mission_service.guidance.formation.controller import FormationFlight
    from mission_service.guidance.formation.seats import Formation

    return FormationFlight(scenario, landscape, Formation(scenario, landscape), missions)


def _warm_up(scenario: Scenario, landscape: Landscape) -> None:
    from mission_service.guidance.formation.warm_up import warm_up

    warm_up(scenario.formation.avoidance)


def _first_mission(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    from mission_service.guidance.formation.controller import mission_to_place

    return mission_to_place(scenario, section, landscape)


FORMATION = WayOfFlying(
    rules=("formation",),
    guidance=_guidance,
    warm_up=_warm_up,
    first_mission=_first_mission,
    check=_check,
    resumes_mission=True,
    messages_peers=True,
    changes_airspeed=True,
)
