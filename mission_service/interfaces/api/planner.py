"""Routes of the planners' settings."""

from typing import Any

from fastapi import APIRouter, Request, Response

from mission_service.core.requests import Settings
from mission_service.events import TUNED
from mission_service.guidance.front.perimeter import PerimeterPlanner
from mission_service.interfaces.api import examples
from mission_service.interfaces.api.answers import answer
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, body, json, route, struct
from mission_service.interfaces.api.states import Told
from mission_service.runtime.hub import Hub


def planner_of(hub: Hub) -> dict[str, Any]:
    """The planners' present settings: those of the scenario with the operators' changes."""
    told = hub.scenario.planner.model_dump(mode="json")
    planners = getattr(hub.core.leader, "planners", {})
    for planner in planners.values():
        if isinstance(planner, PerimeterPlanner):
            told |= {name: getattr(planner.settings, name) for name in TUNED}
    return told


def add(routes: APIRouter, api: Api) -> None:
    """Add ``/planner``."""
    shown = json(examples.STATE["planner"], what="The table [planner] of the scenario, as it is.")

    @routes.get(f"{V1}/planner", **route("look", "The planners' settings now.", shown))
    async def planner() -> Response:
        return answer(planner_of(api.hub))

    @routes.patch(
        f"{V1}/planner",
        **route(
            "fly",
            "Other settings from now on, for planners that have them.",
            struct(Told, {**examples.TOLD, "event": "SettingsTold"}),
            body(Settings, {"alpha": 1.5}),
        ),
    )
    async def settings(request: Request) -> Response:
        return await api.ask(request, "settings")
