"""Approvals: which user may approve which plan, and for how long."""

import pytest

from autopilot_bridge.transitions import InvalidTransitionError
from mission_service.config.sections import BurnSection, Station
from mission_service.events import Approved, HostTime, OperatorHeartbeat, Resumed
from mission_service.guidance.burn.plan_approval import ApprovalTracker, PlanPhase
from mission_service.ignition_plan import IgnitionPlan, PathPoint, PlannedDrop, plan_hash

BURN = BurnSection(
    unit=((36.0, -84.0), (36.0, -83.99), (36.01, -83.99)),
    stations=(Station(name="boss", lat_deg=36.0, lon_deg=-84.01),),
    approval_s=100.0,
    approver_timeout_s=15.0,
)


def a_plan(line: int = 1, latitude_deg: float = 36.001) -> IgnitionPlan:
    point = PathPoint(latitude_deg, -83.995, 400.0, 15.0, 0.0)
    return IgnitionPlan(
        vehicle="kestrel",
        line=line,
        made_at_us=0,
        begin_us=15_000_000,
        valid_until_us=300_000_000,
        path=(point,),
        drops=(PlannedDrop(0, latitude_deg, -83.995, 5.0),),
        skipped=(),
        duration_s=10.0,
        speed_m_s=5.0,
        drop_height_m=15.0,
        safe_height_m=60.0,
        wind_speed_m_s=2.0,
        wind_from_deg=0.0,
        time_margin_s=60.0,
        distance_margin_m=10.0,
        min_time_margin_s=120.0,
        spheres_left=449,
        digest="unit",
    )


def approved(name: str, at_s: float = 1.0, station: str = "boss") -> Approved:
    return Approved(round(at_s * 1e6), "ada", station, name)


def proposing() -> ApprovalTracker:
    approvals = ApprovalTracker(BURN)
    approvals.propose(a_plan())
    approvals.on_operator_input(OperatorHeartbeat(0, "ada", "boss"))
    return approvals


def test_a_plan_that_differs_in_anything_has_another_hash() -> None:
    assert plan_hash(a_plan()) == plan_hash(a_plan())
    assert plan_hash(a_plan()) != plan_hash(a_plan(line=2))
    assert plan_hash(a_plan()) != plan_hash(a_plan(latitude_deg=36.0010001))


def test_a_word_for_the_plan_proposed_counts() -> None:
    approvals = proposing()
    event = approved(approvals.plan_hash)
    approvals.on_operator_input(event)
    assert approvals.refusal(event) is None
    approvals.approve(event)
    assert approvals.approval is not None
    assert approvals.approval.by == "ada"
    assert approvals.expiry_reason(2_000_000) is None


def test_a_word_for_another_plan_does_not() -> None:
    approvals = proposing()
    why = approvals.refusal(approved(plan_hash(a_plan(line=2))))
    assert why is not None
    assert "not" in why
    assert approvals.approval is None


def test_nor_a_word_from_elsewhere() -> None:
    approvals = proposing()
    why = approvals.refusal(approved(approvals.plan_hash, station="kitchen"))
    assert why == "'kitchen' is not an approval station (boss)"


def test_nor_one_that_comes_too_late() -> None:
    approvals = proposing()
    assert approvals.refusal(approved(approvals.plan_hash, at_s=301.0)) == "the plan has expired"


def test_nor_any_where_nothing_is_proposed() -> None:
    approvals = proposing()
    name = approvals.plan_hash
    approvals.withdraw()
    assert approvals.refusal(approved(name)) == "no plan is proposed"


def test_a_new_plan_ends_the_approval_of_the_old_one() -> None:
    approvals = proposing()
    approvals.approve(approved(approvals.plan_hash))
    approvals.propose(a_plan(line=2))
    assert approvals.approval is None


def test_an_approval_lapses_with_time() -> None:
    approvals = proposing()
    event = approved(approvals.plan_hash)
    approvals.approve(event)
    for second in range(0, 110, 5):
        approvals.on_operator_input(OperatorHeartbeat(second * 1_000_000, "ada", "boss"))
    assert approvals.expiry_reason(100_000_000) is None
    assert approvals.expiry_reason(102_000_000) == "the approval is older than 100 s"


def test_and_when_no_operator_is_at_the_station() -> None:
    approvals = proposing()
    approvals.on_operator_input(approved(approvals.plan_hash))
    approvals.approve(approved(approvals.plan_hash))
    approvals.on_operator_input(OperatorHeartbeat(14_000_000, "ada", "kitchen"))
    approvals.on_operator_input(OperatorHeartbeat(14_000_000, "bob", "boss"))  # has no role approve
    approvals.on_operator_input(Resumed(14_000_000, "service", "boss", 3.0))  # is not an operator
    assert approvals.expiry_reason(16_000_000) is None
    assert approvals.expiry_reason(17_000_000) == "no input from ada at boss for 16 s"
    approvals.on_operator_input(OperatorHeartbeat(17_000_000, "bob", "boss", may_approve=True))
    assert approvals.expiry_reason(17_000_000) is None


@pytest.mark.parametrize(
    ("host_s", "lapsed"),
    [(14.0, None), (16.0, "no input from ada at boss for 16 s"),
     (101.0, "the approval is older than 100 s")],
)  # fmt: skip
def test_by_the_hosts_clock_as_well(host_s: float, lapsed: str | None) -> None:
    """Mission time does not advance."""
    approvals = proposing()
    approvals.host_time(HostTime(0, "kestrel", 7_000_000))
    approvals.approve(approved(approvals.plan_hash))
    approvals.host_time(HostTime(0, "kestrel", round(7e6 + host_s * 1e6)))
    assert approvals.expiry_reason(1_000_000) == lapsed
    assert not approvals.is_expired(1_000_000)


def test_a_plan_is_out_of_date_by_the_hosts_clock_as_well() -> None:
    approvals = proposing()
    assert not approvals.is_expired(300_000_000)
    assert approvals.is_expired(300_000_001)
    approvals.host_time(HostTime(0, "kestrel", 300_000_001))
    assert approvals.is_expired(0)


def test_a_plan_withdrawn_is_in_no_phase_to_be_approved() -> None:
    approvals = proposing()
    approvals.withdraw()
    approvals.withdraw()
    approvals.validate_state()
    with pytest.raises(InvalidTransitionError, match="none, proposed, none"):
        approvals._enter(PlanPhase.APPROVED)
    approvals.phases.append(PlanPhase.APPROVED)
    with pytest.raises(AssertionError, match="APPROVED"):
        approvals.validate_state()
