"""Where a prescribed burn stands."""

from fastapi import APIRouter, Response

from mission_service.interfaces.api.answers import ApiError, answer
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, json, route


def add(routes: APIRouter, api: Api) -> None:
    """``/burn``."""
    shown = json({"schema": "burn/1", "at_us": 1830000000, "plan_hash": ""}, what="A burn.")

    @routes.get(f"{V1}/burn", **route("look", "Where a burn stands.", shown))
    async def burn() -> Response:
        found = api.hub.burn()
        if found is None:
            raise ApiError(404, "this run is no burn")
        return answer(found)
