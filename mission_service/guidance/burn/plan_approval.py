"""Tracks the proposed plan and its approval, with the approver, the station and the time limit."""

from collections import deque
from dataclasses import dataclass
from enum import Enum

from autopilot_bridge.transitions import enter
from mission_service.config.sections import BurnSection
from mission_service.events import Approved, HostTime, OperatorEvent, Resumed
from mission_service.ignition_plan import IgnitionPlan, plan_hash
from mission_service.vehicles.vehicle_state import HISTORY_LENGTH


class PlanPhase(Enum):
    """The phase of a plan."""

    NONE = "none"
    PROPOSED = "proposed"
    APPROVED = "approved"


_ANY = tuple(PlanPhase)
PLAN_TRANSITIONS: dict[PlanPhase, tuple[PlanPhase, ...]] = {
    PlanPhase.NONE: (PlanPhase.PROPOSED,),
    PlanPhase.PROPOSED: _ANY,
    PlanPhase.APPROVED: _ANY,
}


@dataclass(frozen=True, slots=True)
class PlanApproval:
    """An operator's approval of exactly one plan."""

    plan_hash: str
    by: str
    station: str
    at_us: int
    host_us: int  # time of the approval on the host's clock


class ApprovalTracker:
    """The tracker of the current plan and of the crew's approval.

    A time limit applies both in mission time and on the host's clock; the earlier expiry counts.
    """

    def __init__(self, burn: BurnSection) -> None:
        self.phases = deque([PlanPhase.NONE], HISTORY_LENGTH)
        self.plan: IgnitionPlan | None = None
        self.plan_hash = ""
        self.approval: PlanApproval | None = None
        self._stations = {station.name for station in burn.stations}
        self._approval_us = round(burn.approval_s * 1e6)
        self._timeout_us = round(burn.approver_timeout_s * 1e6)
        self._host_us = 0  # the current time on the host's clock
        self._proposed_host_us = 0
        self._approver_us = self._approver_host_us = 0  # last input of an approver, on both clocks

    def host_time(self, event: HostTime) -> None:
        """Set the current time on the host's clock."""
        self._host_us = event.monotonic_us

    def on_operator_input(self, event: OperatorEvent) -> None:
        """Record that an approver is present, if an approver made this input.

        Only input from the station of the approval counts.
        """
        approval = self.approval
        if approval is None or isinstance(event, Resumed) or event.station != approval.station:
            return
        if event.by == approval.by or event.may_approve:
            self._approver_us, self._approver_host_us = event.at_us, self._host_us

    def propose(self, plan: IgnitionPlan) -> str:
        """Propose a plan, which replaces any earlier plan; return the hash of the new plan."""
        self._enter(PlanPhase.PROPOSED)
        self.plan, self.plan_hash, self.approval = plan, plan_hash(plan), None
        self._proposed_host_us = self._host_us
        return self.plan_hash

    def refusal(self, event: Approved) -> str | None:
        """Return why an approval is rejected, or None if it is accepted."""
        if event.station not in self._stations:
            stations = ", ".join(sorted(self._stations))
            return f"{event.station!r} is not an approval station ({stations})"
        if self.plan is None:
            return "no plan is proposed"
        if event.plan_hash != self.plan_hash:
            return f"the proposed plan is {self.plan_hash[:12]}, not {event.plan_hash[:12]}"
        if self.is_expired(event.at_us):
            return "the plan has expired"
        return None

    def approve(self, event: Approved) -> None:
        """Apply an approval that is not rejected."""
        self._enter(PlanPhase.APPROVED)
        self.approval = PlanApproval(
            event.plan_hash, event.by, event.station, event.at_us, self._host_us
        )
        self._approver_us, self._approver_host_us = event.at_us, self._host_us

    def is_expired(self, at_us: int) -> bool:
        """Return whether the current plan has expired; False without a plan."""
        if self.plan is None:
            return False
        valid_for_us = self.plan.valid_until_us - self.plan.made_at_us
        host_us = self._host_us - self._proposed_host_us
        return at_us > self.plan.valid_until_us or host_us > valid_for_us

    def expiry_reason(self, at_us: int) -> str | None:
        """Return why the approval has expired; None if it is valid, or if there is no approval."""
        approval = self.approval
        if approval is None or self.plan is None:
            return None
        if max(at_us - approval.at_us, self._host_us - approval.host_us) > self._approval_us:
            return f"the approval is older than {self._approval_us / 1e6:.0f} s"
        absent_us = max(at_us - self._approver_us, self._host_us - self._approver_host_us)
        if absent_us > self._timeout_us:
            return f"no input from {approval.by} at {approval.station} for {absent_us / 1e6:.0f} s"
        return None

    def withdraw(self) -> None:
        """Withdraw the plan and its approval, if there is a plan."""
        if self.plan is not None:
            self._enter(PlanPhase.NONE)
        self.plan, self.plan_hash, self.approval = None, "", None

    def _enter(self, phase: PlanPhase) -> None:
        enter(self.phases, phase, PLAN_TRANSITIONS, "plan")

    def validate_state(self) -> None:
        """Check the invariants that hold between events, for tests; raises AssertionError."""
        phase = self.phases[-1]
        assert (self.plan is None) == (phase is PlanPhase.NONE) == (not self.plan_hash), phase
        approval = self.approval
        assert (approval is not None) == (phase is PlanPhase.APPROVED), phase
        assert approval is None or approval.plan_hash == self.plan_hash, approval
