"""Vehicles of a formation whose link is lost: others go on minding them for a while.

A vehicle that hears nothing more circles on where its last orbit was ordered, at the height of the
others. Nobody else can tell where it is, so that is said in its place.
"""

from dataclasses import dataclass

from mission_service.formation.messages import State
from mission_service.formation.silent import MINDED_FOR_US

SAID_EVERY_US = 500_000


@dataclass
class Lost:
    """The last that a vehicle said, and when something was last said in its place."""

    state: State
    said_at_us: int

    def due(self, at_us: int) -> bool:
        """Whether it is time to say something again."""
        return at_us - self.said_at_us >= SAID_EVERY_US

    def over(self, at_us: int) -> bool:
        """Whether nobody needs to mind it any more: where it is now is anybody's guess."""
        return at_us - self.state.at_us > MINDED_FOR_US
