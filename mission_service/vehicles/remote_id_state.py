"""Defines the state of one vehicle's Remote ID module, as reported. Pure."""

from dataclasses import dataclass
from typing import Literal

NONE_RECEIVED = "no message was received from a Remote ID module"


@dataclass(slots=True)
class RemoteIdReport:
    """The last reported state, and the alarm about a required module that is not ready."""

    state: Literal["", "ready", "fails", "lost"] = ""  # empty before the first message
    text: str = ""  # the module's error, or how the state was determined
    problem_since_s: float | None = None  # in the air
    alarm: str = ""

    @property
    def state_in_words(self) -> str:
        """The state in words."""
        if not self.state:
            return NONE_RECEIVED
        return f"{self.state}: {self.text}" if self.text else self.state
