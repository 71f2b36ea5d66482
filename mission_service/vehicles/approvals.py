"""Withholds missions until an operator approves them (``mission.approval = "each"``). Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from mission_service.commands import (
    Announce,
    AnyCommand,
    ProposeMission,
    UploadMission,
    WithdrawMission,
)
from mission_service.missions.mission_hash import mission_hash
from mission_service.vehicles.vehicle_state import (
    MissionPhase,
    Pending,
    Refusal,
    Vehicle,
    announce,
)

SAMPLED_EVERY_M = 20.0
# Validity of a proposal; afterwards a new mission is planned, because the front moves.
GOOD_FOR_S = 60.0
# A mission differs if it extends beyond a refused mission by this fraction of the horizon.
AHEAD_SHARE = 0.5


@dataclass(frozen=True)
class Proposal:
    """A mission that was proposed to the operators at ``at_s``."""

    at_s: float
    command: UploadMission
    pending: Pending


class MissionApprovals:
    """The proposed missions; each is sent when an operator accepts its hash.

    A mission that separates two vehicles, or only lands, is sent at once and replaces a proposal.
    """

    def __init__(self, path_tolerance_m: float, horizon_m: float) -> None:
        """Set the distances beyond which a mission differs from a refused mission.

        These are ``path_tolerance_m`` perpendicular to the refused mission's path, and a fraction
        of ``horizon_m`` beyond the end of the path.
        """
        self._proposals: dict[str, Proposal] = {}
        self._announced: set[str] = set()  # vehicles with a proposal that awaits an answer
        self._path_tolerance_m = path_tolerance_m
        self._max_beyond_m = AHEAD_SHARE * horizon_m

    def held_back(
        self, commands: Iterable[AnyCommand], vehicles: Mapping[str, Vehicle], at_s: float
    ) -> list[AnyCommand]:
        """Replace each upload by a proposal; drop uploads that are similar to refused missions."""
        found: list[AnyCommand] = []
        for command in commands:
            if not isinstance(command, UploadMission):
                found.append(command)
            elif command.keeps_apart or command.lands:
                vehicle = vehicles[command.vehicle]
                why = "the vehicle lands" if command.lands else "the vehicle gives way to another"
                found += [*self.withdraw(vehicle, why), command]
            else:
                found += self._propose(command, vehicles[command.vehicle], at_s)
        return found

    def _propose(
        self, command: UploadMission, vehicle: Vehicle, at_s: float
    ) -> list[ProposeMission | Announce]:
        pending, earlier = vehicle.pending, self._proposals.get(vehicle.name)
        assert pending is not None  # set by ``MissionsSent``
        why = command.why
        if vehicle.refusal is not None:
            if not self._differs(vehicle.refusal, pending):
                vehicle.due = pending.due
                if earlier is None:
                    vehicle.enter(MissionPhase.REFUSED)
                else:
                    vehicle.enter(MissionPhase.PROPOSED, earlier.pending)
                return []
            why = f"{why}; different from the mission that {vehicle.refusal.by} refused"
        vehicle.enter(MissionPhase.PROPOSED, pending)
        self._proposals[vehicle.name] = Proposal(at_s, command, pending)
        mission = (command.mission_id, why, command.items, mission_hash(command.items))
        proposed = ProposeMission(vehicle.name, *mission)
        if vehicle.name in self._announced:
            return [proposed]
        self._announced.add(vehicle.name)
        words = f"mission {command.mission_id} waits for approval: {why}"
        return [proposed, announce(vehicle, words)]

    def _differs(self, refusal: Refusal, pending: Pending) -> bool:
        """Return whether a mission differs from a refused mission in its path or its reason."""
        if pending.due not in ("", refusal.due):
            return True
        line = shapely.segmentize(pending.line, SAMPLED_EVERY_M)
        points = shapely.points(shapely.get_coordinates(line))
        apart_m = shapely.distance(points, refusal.line)
        along_m = shapely.line_locate_point(refusal.line, points)
        beyond = along_m >= refusal.line.length
        max_m = np.where(beyond, self._max_beyond_m, self._path_tolerance_m)
        return bool((apart_m > max_m).any())

    def accepted(self, vehicle: Vehicle, named: str) -> UploadMission | None:
        """Return the proposed mission with this hash, to be sent; None without such a proposal."""
        proposal = self._take_proposal(vehicle, named)
        if proposal is None:
            return None
        vehicle.enter(MissionPhase.UPLOADING, proposal.pending)
        vehicle.refusal = None
        return proposal.command

    def refused(self, vehicle: Vehicle, named: str, by: str) -> bool:
        """Refuse the mission proposed with this hash, and similar ones; False if there is none."""
        proposal = self._take_proposal(vehicle, named)
        if proposal is None:
            return False
        vehicle.enter(MissionPhase.REFUSED)
        vehicle.refusal = Refusal(by, proposal.pending.due, proposal.pending.line)
        return True

    def lapsed(self, vehicle: Vehicle, at_s: float) -> list[WithdrawMission]:
        """Withdraw an expired proposal; a new mission remains due for the same reason."""
        proposal = self._proposals.get(vehicle.name)
        if proposal is None or at_s - proposal.at_s < GOOD_FOR_S:
            return []
        vehicle.due = vehicle.due or proposal.pending.due
        why = f"no answer for {GOOD_FOR_S:.0f} s: a new mission is planned"
        withdrawn = self.withdraw(vehicle, why)
        self._announced.add(vehicle.name)  # the new proposal is not announced
        return withdrawn

    def withdraw(self, vehicle: Vehicle, why: str) -> list[WithdrawMission]:
        """Withdraw the proposal of a vehicle, if any."""
        self._announced.discard(vehicle.name)
        proposal = self._proposals.pop(vehicle.name, None)
        if proposal is None:
            return []
        if vehicle.proposed is not None:  # unless another proposal has replaced it
            vehicle.enter(MissionPhase.WITHDRAWN)
        return [WithdrawMission(vehicle.name, proposal.command.mission_id, why)]

    def _take_proposal(self, vehicle: Vehicle, named: str) -> Proposal | None:
        proposal = self._proposals.get(vehicle.name)
        if proposal is None or mission_hash(proposal.command.items) != named:
            return None
        self._announced.discard(vehicle.name)
        return self._proposals.pop(vehicle.name)

    def validate_state(self, vehicles: Mapping[str, Vehicle]) -> None:
        """Check the invariants between two events; raises AssertionError. For tests."""
        for name, vehicle in vehicles.items():
            proposal = self._proposals.get(name)
            assert vehicle.proposed is (proposal and proposal.pending), name
