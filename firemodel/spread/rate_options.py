"""Define the spread rate options, without importing compiled code."""

from typing import NamedTuple

from firemodel.physics import CrownMethod


class RateOptions(NamedTuple):
    """The spread rate options, which have the same names in scenarios and schemes."""

    wind_limit: bool = False  # Rothermel's limit of the effective wind (see ``rothermel``)
    crown: CrownMethod = "none"  # the method of ``crown_fire``
    foliar_moisture_pct: float = 100.0  # moisture of the needles, for the ignition of crowns


SURFACE_ONLY = RateOptions()
