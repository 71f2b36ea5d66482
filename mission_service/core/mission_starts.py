"""Decides when a vehicle may start its mission, and when a refused start is repeated."""

from mission_service import events
from mission_service.commands import AnyCommand, StartMission
from mission_service.config.scenario import Scenario
from mission_service.core.preflight import Preflight
from mission_service.guidance.protocol import Guidance
from mission_service.vehicles.traffic import TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle, announce

CHECK_EVERY_S = 2.0
TAKEOFF_EVERY_S = 20.0
WAITS = "on the ground: it waits for an operator's order to start"


class MissionStarts:
    """Decides when missions are started."""

    def __init__(
        self,
        scenario: Scenario,
        traffic: TrafficManager,
        guidance: Guidance,
        preflight: Preflight,
    ) -> None:
        self._preflight = preflight
        self.scenario = scenario
        self.traffic = traffic
        self.guidance = guidance

    def is_due(self, vehicle: Vehicle, at_s: float) -> bool:
        """Return whether a start that was refused or waited for a mission is due now."""
        again_at_s = vehicle.start_again_at_s
        return again_at_s is not None and at_s >= again_at_s and vehicle.flown_line is not None

    def start_mission(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Start the mission. A takeoff is subject to separation and the pre-flight checks.

        After a landing, a takeoff also requires an order.
        """
        vehicle.start_again_at_s = None
        if vehicle.availability.taken_over:
            return []
        if vehicle.waits_for_operator and not vehicle.availability.airborne:
            return [announce(vehicle, WAITS, warning=True)]
        if vehicle.availability.airborne:
            permitted, announced = vehicle.availability.position_good, list[AnyCommand]()
        else:
            permitted, announced = self._preflight.permits_start(vehicle, at_s)
            waits = self._takeoff_obstacle(vehicle, at_s) if permitted else ""
            if waits and waits != vehicle.takeoff_waits:
                announced = [*announced, announce(vehicle, f"waits to take off: {waits}")]
            vehicle.takeoff_waits = waits
            permitted = permitted and not waits
        if permitted:
            return [*announced, StartMission(vehicle.name)]
        if vehicle.availability.airborne or not vehicle.waits_for_operator:
            vehicle.start_again_at_s = at_s + CHECK_EVERY_S
        return announced

    def _takeoff_obstacle(self, vehicle: Vehicle, at_s: float) -> str:
        """Return why a vehicle on the ground must not take off now, or "".

        The vehicles of other processes report no positions during takeoff, so each vehicle has its
        own earliest takeoff time.
        """
        if self.scenario.only is not None:
            number = [section.name for section in self.scenario.vehicles].index(vehicle.name)
            if at_s < self.scenario.start_s + number * TAKEOFF_EVERY_S:
                return "the vehicles of other processes take off first"
        return self.traffic.takeoff_obstacle(vehicle.name, at_s)

    def may_repeat(self, vehicle: Vehicle) -> bool:
        """Return whether to repeat a start that the autopilot has refused.

        On the ground, a start is repeated because autopilots refuse to arm until they have a
        position. In the air, it is repeated only for a vehicle that is flown by its mission.
        """
        availability = vehicle.availability
        if availability.taken_over or availability.recalled or vehicle.ordered:
            return False
        return self.guidance.in_mission(vehicle.name) or not availability.airborne

    def was_announced(self, vehicle: Vehicle, event: events.CommandFinished) -> bool:
        """Return whether a start in flight was announced earlier and nothing has ended it since."""
        announced = vehicle.start_confirmed and vehicle.availability.airborne
        if event.command in ("start mission", "hold", "return"):
            vehicle.start_confirmed = event.command == "start mission"
        return announced and event.command == "start mission"
