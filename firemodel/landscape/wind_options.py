"""Define the names of units, heights and north in files of wind."""

from typing import Literal

Unit = Literal["m_s", "mph", "kmh", "kts"]
Height = Literal["20ft", "10m"]
North = Literal["grid", "true"]
