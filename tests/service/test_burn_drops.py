"""The count of ignition spheres."""

from mission_service.events import DropFinished
from mission_service.guidance.burn.sphere_account import Sphere, SphereAccount


def ordered(account: SphereAccount, number: int) -> Sphere:
    sphere = Sphere("abc", number, number * 1_000_000, (0.0, 0.0), (3.0, 4.0))
    account.order(sphere)
    return sphere


def finished(number: int, done: bool, refused: bool = False) -> DropFinished:
    return DropFinished(9_000_000, "kestrel", "abc", number, done, refused, "")


def test_what_is_refused_is_still_on_board() -> None:
    account = SphereAccount(10)
    sphere = ordered(account, 0)
    assert account.left == 9
    account.finish(finished(0, done=False, refused=True))
    assert account.left == 10
    assert not sphere.counts
    assert account.fallen_m() == []


def test_a_drop_without_a_result_is_assumed_to_have_fallen() -> None:
    account = SphereAccount(10)
    ordered(account, 0)
    sphere = account.finish(finished(0, done=False))
    assert sphere is not None
    assert sphere.outcome == "unknown"
    assert account.left == 9
    assert account.fallen_m() == [(3.0, 4.0)]
    assert sphere.max_miss_m == 5.0


def test_an_outcome_reported_twice_counts_once() -> None:
    account = SphereAccount(10)
    ordered(account, 0)
    account.finish(finished(0, done=False, refused=True))
    assert account.finish(finished(0, done=False, refused=True)) is None
    assert account.left == 10


def test_of_an_order_repeated_the_last_is_meant() -> None:
    account = SphereAccount(10)
    first = ordered(account, 0)
    account.finish(finished(0, done=False, refused=True))
    second = ordered(account, 0)
    account.finish(finished(0, done=True))
    assert (first.outcome, second.outcome) == ("refused", "done")
    assert account.of_plan("abc") == [second]
