"""Routes of the planners' settings."""

from typing import Any

from fastapi import APIRouter, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.answers import answer
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, json, route
from mission_service.runtime.hub import Hub


def planner_of(hub: Hub) -> dict[str, Any]:
    """The planners' present settings: those of the scenario with the operators' changes."""
    return hub.scenario.planner.model_dump(mode="json") | hub.core.leader.settings()


def add(routes: APIRouter, api: Api) -> None:
    """Add ``/planner``."""
    shown = json(examples.PLANNER, what="The table [planner] of the scenario, as it is.")

    @routes.get(f"{V1}/planner", **route("look", "The planners' settings now.", shown))
    async def planner() -> Response:
        return answer(planner_of(api.hub))
