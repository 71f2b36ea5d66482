"""Define fuels and weather, and compute moistures and Rothermel's rates of spread."""

from typing import Literal

# The methods of computing crown fire (``crown_fire``).
CrownMethod = Literal["none", "rothermel", "scott_reinhardt", "cruz"]
