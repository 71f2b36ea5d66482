"""The way of flying along estimated fronts of any shape, on routes that reduce the error."""

from dataclasses import replace

from mission_service.guidance.front.way import along_front
from mission_service.guidance.way_of_flying import later

INFORMATIVE = replace(
    along_front(("informative",), later(f"{__package__}.planner:planners_of")), reads_fronts=True
)
