"""Defines the routes of the planners' settings."""

from typing import Any

from fastapi import APIRouter, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, json, route
from mission_service.interfaces.api.responses import answer
from mission_service.runtime.run_context import RunContext


def planner_of(context: RunContext) -> dict[str, Any]:
    """Return the planners' current settings: the scenario's, with the operators' changes."""
    return context.scenario.planner.model_dump(mode="json") | context.core.guidance.settings()


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/planner``."""
    shown = json(examples.PLANNER, what="The current table [planner] of the scenario.")

    @routes.get(f"{V1}/planner", **route("look", "Current settings of the planners.", shown))
    async def planner() -> Response:
        return answer(planner_of(api.context))
