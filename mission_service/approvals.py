"""Missions that wait for a person's word (``mission.approval = "each"``). Pure."""

from collections.abc import Iterable

from mission_service.commands import AnyCommand, ProposeMission, UploadMission
from mission_service.picture import mission_hash

GOOD_FOR_S = 60.0  # afterwards it is planned anew: the front has moved on


class MissionApprovals:
    """Holds back each mission until it is accepted, by its hash."""

    def __init__(self) -> None:
        self._proposed: dict[str, tuple[float, UploadMission]] = {}

    def held_back(self, commands: Iterable[AnyCommand], at_s: float) -> list[AnyCommand]:
        """The same commands with each mission proposed instead of sent."""
        found: list[AnyCommand] = []
        for command in commands:
            if isinstance(command, UploadMission):
                self._proposed[command.vehicle] = (at_s, command)
                proposal = (command.mission_id, command.why, command.items)
                command = ProposeMission(command.vehicle, *proposal, mission_hash(command.items))
            found.append(command)
        return found

    def accepted(self, vehicle: str, named: str) -> UploadMission | None:
        """The mission of this hash, to be sent; None: another one, or none, is proposed."""
        return self._taken(vehicle, named)

    def refused(self, vehicle: str, named: str) -> bool:
        """Whether the mission of this hash was proposed; it is no more."""
        return self._taken(vehicle, named) is not None

    def lapsed(self, vehicle: str, at_s: float) -> bool:
        """Whether what was proposed has waited too long; it is proposed no more."""
        proposed = self._proposed.get(vehicle)
        if proposed is None or at_s - proposed[0] < GOOD_FOR_S:
            return False
        del self._proposed[vehicle]
        return True

    def waits(self, vehicle: str) -> bool:
        """Whether a mission is proposed for it, and has not gone to it."""
        return vehicle in self._proposed

    def forget(self, vehicle: str) -> None:
        """Nothing is proposed for a vehicle any more."""
        self._proposed.pop(vehicle, None)

    def _taken(self, vehicle: str, named: str) -> UploadMission | None:
        proposed = self._proposed.get(vehicle)
        if proposed is None or mission_hash(proposed[1].items) != named:
            return None
        del self._proposed[vehicle]
        return proposed[1]
