"""Routes of a prescribed burn: its state, approvals, the checklist and reports of the crew."""

from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import APIRouter, Request, Response

from mission_service.core import requests
from mission_service.interfaces.api import examples
from mission_service.interfaces.api.access.auth import Role
from mission_service.interfaces.api.answers import ApiError, answer
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, body, json, route, struct
from mission_service.interfaces.api.states import Told

# Presence, the unit and the checklist permit drops: they require the role approve as well.
WORDS: dict[str, tuple[Role, type[requests.Request], str, dict[str, Any]]] = {
    "plan": ("fly", requests.Plan, "Plan the next line.", {}),
    "approve": (
        "approve",
        requests.Approve,
        "Approve exactly the plan of this hash.",
        {"hash": examples.HASH},
    ),
    "reject": ("approve", requests.Reject, "Have a plan not flown.", {"hash": examples.HASH}),
    "go": ("approve", requests.Go, "GO to an item of the list.", {"item": "crew briefed"}),
    "no-go": ("approve", requests.NoGo, "NO-GO to an item.", {"item": "crew briefed"}),
    "present": ("approve", requests.Present, "Somebody watches; each few seconds.", {}),
    "unit": (
        "approve",
        requests.Unit,
        "The burn unit's corners.",
        {"points": [[36.35, -84.16], [36.35, -84.15], [36.36, -84.15]]},
    ),
    "person": (
        "correct",
        requests.Person,
        "Somebody is at a place; radius 0: no longer.",
        {"name": "Ben", **examples.PLACE, "radius_m": 30.0},
    ),
    "lit": (
        "correct",
        requests.Lit,
        "A point or a line was lit.",
        {"points": [[36.35, -84.16]], "ago_s": 20.0},
    ),
}


def add(routes: APIRouter, api: Api) -> None:
    """Add ``/burn`` and a route for each of ``WORDS``."""
    shown = json({"schema": "burn/1", "at_us": 1830000000, "plan_hash": ""}, what="A burn.")

    @routes.get(f"{V1}/burn", **route("look", "Where a burn stands.", shown))
    async def burn() -> Response:
        found = api.hub.burn()
        if found is None:
            raise ApiError(404, "this run is no burn")
        return answer(found)

    def asking(do: str) -> Callable[[Request], Awaitable[Response]]:
        async def ask(request: Request) -> Response:
            return await api.ask(request, do)

        return ask

    for do, (role, kind, summary, example) in WORDS.items():
        told = struct(Told, {**examples.TOLD, "event": "Answered"})
        described = route(role, summary, told, body(kind, example))
        routes.add_api_route(
            f"{V1}/burn/{do}", asking(do), methods=["POST"], operation_id=f"burn_{do}", **described
        )
