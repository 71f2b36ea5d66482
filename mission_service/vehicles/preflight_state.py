"""Defines the state of one vehicle that relates to its next takeoff. Pure."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.commands import PreflightCheck


class SignOff(NamedTuple):
    """A person's sign-off of the pre-flight checks, which ends with the takeoff.

    ``overridden`` contains the names of the failed checks that the person overrode.
    """

    by: str
    overridden: tuple[str, ...] = ()


@dataclass(slots=True)
class PreflightState:
    """The checks as last computed and as last reported, and the alarm about them."""

    checks: tuple[PreflightCheck, ...] = ()
    computed_at_s: float = -math.inf
    reported: tuple[tuple[PreflightCheck, ...], bool, str] = ((), False, "")
    reported_at_s: float = -math.inf
    alarm: str = ""  # why an automatic start is delayed; empty without an alarm
