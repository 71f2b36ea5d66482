"""The account of the ignition spheres: outcomes of drops, targets and impact points."""

import math
from dataclasses import dataclass

from mission_service.events import DropFinished

PointXY = tuple[float, float]


@dataclass(slots=True)
class Sphere:
    """The sphere of a commanded drop; ``outcome`` is ordered, done, unknown or refused."""

    plan_hash: str
    number: int
    at_us: int
    target_m: PointXY
    falls_m: PointXY  # impact point predicted at release
    outcome: str = "ordered"

    @property
    def max_miss_m(self) -> float:
        """Return the distance between the target and the predicted impact point."""
        return math.dist(self.target_m, self.falls_m)

    @property
    def counts(self) -> bool:
        """Return whether the sphere counts as dropped; only a refused drop does not count."""
        return self.outcome != "refused"


class SphereAccount:
    """The account of a burn's spheres, in the order of their drops.

    ``loaded`` is the number of spheres on board at the start.
    """

    def __init__(self, loaded: int) -> None:
        self.spheres: list[Sphere] = []
        self.left = loaded
        self.last_at_us: int | None = None

    def order(self, sphere: Sphere) -> None:
        """Add a sphere for a drop that is ordered now."""
        self.spheres.append(sphere)
        self.left -= 1
        self.last_at_us = sphere.at_us

    def finish(self, event: DropFinished) -> Sphere | None:
        """Set the outcome of a drop; return its sphere, or None if no such drop is pending."""
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
        """Return the spheres dropped under one plan, including those with an unknown outcome."""
        return [each for each in self.spheres if each.plan_hash == plan_hash and each.counts]

    def fallen_m(self) -> list[PointXY]:
        """Return the impact points of all spheres that count as dropped."""
        return [each.falls_m for each in self.spheres if each.counts]

    def load(self, spheres: int) -> None:
        """Set the number of spheres on board after a reload on the ground."""
        self.left = spheres
