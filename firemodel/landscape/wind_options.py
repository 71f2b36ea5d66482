"""Define the names of units, heights and norths in wind files."""

from typing import Literal

Unit = Literal["m_s", "mph", "kmh", "kts"]
Height = Literal["20ft", "10m"]
North = Literal["grid", "true"]
