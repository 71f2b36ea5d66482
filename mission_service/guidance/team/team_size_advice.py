"""What a team can keep up with, in words for its user; the numbers are those of ``team_size``."""

from dataclasses import dataclass

import numpy as np

from mission_service.guidance.team.ring import Floats, FrontRing
from mission_service.guidance.team.team_size import best_split, vehicles_for_age, vehicles_needed

AGAIN_S = 300.0


@dataclass(frozen=True, slots=True)
class CoverageTargets:
    """How well the front is to be kept: the worst age of a part, and its advance unseen."""

    worst_age_s: float | None = None
    unseen_advance_m: float | None = None


def team_size_advice(
    ring: FrontRing, speed_m_s: Floats, targets: CoverageTargets
) -> tuple[bool, str]:
    """Whether the team (speeds, k) is too small for the wishes, and what to tell its user.

    Of vehicles of the team's mean speed; without wishes only what the team can do.
    """
    vehicles, mean_m_s = speed_m_s.size, float(np.mean(speed_m_s))
    length_m, fastest_m_s = float(ring.step_m.sum()), float(ring.spread_rate_m_s.max())
    split = best_split(ring.step_m, ring.spread_rate_m_s, vehicles, mean_m_s)
    lapping = "" if not split.sweeping else f", {split.sweeping} of them sweeping the fastest part"
    text = (
        f"front of {length_m / 1e3:.1f} km, fastest {60.0 * fastest_m_s:.1f} m/min: "
        f"{_vehicles(vehicles)} can see every part every {length_m / mean_m_s / vehicles:.0f} s; "
        f"the front then gets {split.worst_advance_m:.0f} m further unseen at most{lapping}"
    )
    most = 0
    if targets.worst_age_s is not None:
        needed = vehicles_for_age(length_m, mean_m_s, targets.worst_age_s)
        most = max(most, needed)
        text += f"; every {targets.worst_age_s:g} s takes {_vehicles(needed)}"
    if targets.unseen_advance_m is not None:
        enough = vehicles_needed(
            ring.step_m, ring.spread_rate_m_s, mean_m_s, targets.unseen_advance_m
        )
        needed = enough.lapping + enough.sweeping
        most = max(most, needed)
        text += f"; no more than {targets.unseen_advance_m:g} m takes {_vehicles(needed)}"
    return most > vehicles, text


def _vehicles(count: int) -> str:
    return f"{count} vehicle" if count == 1 else f"{count} vehicles"


class TeamSizeAdviser:
    """Tells it when the team or what it needs has changed, at most every five minutes."""

    def __init__(self, targets: CoverageTargets) -> None:
        self._targets = targets
        self._last_advice: tuple[int, bool] | None = None
        self._next_s = -np.inf

    def is_due(self, vehicles: int, at_s: float) -> bool:
        """Whether to look again."""
        return at_s >= self._next_s or (
            self._last_advice is not None and self._last_advice[0] != vehicles
        )

    def at(self, ring: FrontRing, speed_m_s: Floats, at_s: float) -> tuple[bool, str] | None:
        """(too few, what to say) if there is something new to say."""
        self._next_s = at_s + AGAIN_S
        too_few, text = team_size_advice(ring, speed_m_s, self._targets)
        last, self._last_advice = self._last_advice, (speed_m_s.size, too_few)
        return None if last == self._last_advice else (too_few, text)
