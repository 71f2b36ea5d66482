"""Defines the route for the state of a prescribed burn."""

from fastapi import APIRouter, Response

from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, json, route
from mission_service.interfaces.api.responses import ApiError, answer


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/burn``."""
    shown = json({"schema": "burn/1", "at_us": 1830000000, "plan_hash": ""}, what="A burn.")

    @routes.get(f"{V1}/burn", **route("look", "State of the burn.", shown))
    async def burn() -> Response:
        found = api.context.burn()
        if found is None:
            raise ApiError(404, "this run is not a burn")
        return answer(found)
