"""Account of the spheres: ordered, fallen or refused, and how far off their places."""

import math
from dataclasses import dataclass

from mission_service.events import DropFinished

PointXY = tuple[float, float]


@dataclass(slots=True)
class Sphere:
    """One that was ordered to fall. ``outcome``: ordered, done, unknown or refused."""

    plan_hash: str
    number: int
    at_us: int
    target_m: PointXY
    falls_m: PointXY  # by what was known when it was let go
    outcome: str = "ordered"

    @property
    def miss_m(self) -> float:
        """How far from its place it falls."""
        return math.dist(self.target_m, self.falls_m)

    @property
    def counts(self) -> bool:
        """Whether it must be taken to have fallen."""
        return self.outcome != "refused"


class SphereAccount:
    """All spheres of a burn, in the order of their fall; ``loaded`` are on board at the start."""

    def __init__(self, loaded: int) -> None:
        self.spheres: list[Sphere] = []
        self.left = loaded
        self.last_at_us: int | None = None

    def order(self, sphere: Sphere) -> None:
        """It is let go now."""
        self.spheres.append(sphere)
        self.left -= 1
        self.last_at_us = sphere.at_us

    def finish(self, event: DropFinished) -> Sphere | None:
        """What became of it; None for one that was not ordered, or is settled."""
        for sphere in reversed(self.spheres):
            if (sphere.plan_hash, sphere.number) == (event.plan_hash, event.number):
                if sphere.outcome != "ordered":
                    return None
                sphere.outcome = event.outcome
                if not sphere.counts:
                    self.left += 1
                return sphere
        return None

    def of_plan(self, plan_hash: str) -> list[Sphere]:
        """Those of one plan that must be taken to have fallen."""
        return [each for each in self.spheres if each.plan_hash == plan_hash and each.counts]

    def fallen_m(self) -> list[PointXY]:
        """Where all lie that must be taken to have fallen."""
        return [each.falls_m for each in self.spheres if each.counts]

    def load(self, spheres: int) -> None:
        """Filled up on the ground."""
        self.left = spheres
