"""Which plan is proposed, and whether it is approved: by whom, from where, for how long."""

from dataclasses import dataclass

from mission_service.burn.plan import IgnitionPlan, plan_hash
from mission_service.config_sections import BurnSection
from mission_service.events import Approved, Crew, Resumed


@dataclass(frozen=True, slots=True)
class Approval:
    """A person's word for exactly one plan."""

    plan_hash: str
    by: str
    station: str
    at_us: int


class Approvals:
    """One plan at a time, and the crew's word for it."""

    def __init__(self, burn: BurnSection) -> None:
        self.plan: IgnitionPlan | None = None
        self.plan_hash = ""
        self.approval: Approval | None = None
        self._stations = {station.name for station in burn.stations}
        self._approval_us = round(burn.approval_s * 1e6)
        self._silent_us = round(burn.crew_silent_s * 1e6)
        self._heard_us: dict[str, int] = {}

    def heard(self, event: Crew) -> None:
        """Somebody at a station did or said something, so is there."""
        if not isinstance(event, Resumed):
            self._heard_us[event.station] = event.at_us

    def propose(self, plan: IgnitionPlan) -> str:
        """Take the place of any plan before; returns its hash."""
        self.plan, self.plan_hash, self.approval = plan, plan_hash(plan), None
        return self.plan_hash

    def approve(self, event: Approved) -> str | None:
        """Take somebody's word; returns why it does not count, or None."""
        if event.station not in self._stations:
            known = ", ".join(sorted(self._stations))
            return f"{event.station!r} is no station from which plans are approved ({known})"
        if self.plan is None:
            return "no plan is proposed"
        if event.plan_hash != self.plan_hash:
            return f"the plan proposed is {self.plan_hash[:12]}, not {event.plan_hash[:12]}"
        if event.at_us > self.plan.valid_until_us:
            return "the plan is out of date"
        self.approval = Approval(event.plan_hash, event.by, event.station, event.at_us)
        return None

    def lapsed(self, at_us: int) -> str | None:
        """Why what was approved no longer is, by the time alone; None: it is, or never was."""
        approval = self.approval
        if approval is None or self.plan is None:
            return None
        if at_us - approval.at_us > self._approval_us:
            return f"the approval is older than {self._approval_us / 1e6:.0f} s"
        silent_us = at_us - self._heard_us[approval.station]
        if silent_us > self._silent_us:
            return (
                f"nothing heard of {approval.by} at {approval.station} for {silent_us / 1e6:.0f} s"
            )
        return None

    def void(self) -> None:
        """Nothing is proposed or approved from now on."""
        self.plan, self.plan_hash, self.approval = None, "", None
