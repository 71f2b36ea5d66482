"""Builds the OpenAPI description of a route: its role, request body, response and example.

Schemas are generated from the msgspec Structs.
"""

from collections.abc import Mapping
from typing import Any, get_origin

import msgspec
from fastapi import Depends, Request
from fastapi.routing import APIRoute

from mission_service import requests
from mission_service.interfaces import examples
from mission_service.interfaces.api.responses import ApiError
from mission_service.requests import Role

V1 = "/api/v1"
REF = "#/components/schemas/{name}"
REFUSALS = {
    400: "Malformed request.",
    401: "No valid token.",
    403: "Missing role, or a page of another origin.",
    404: "No such resource.",
    408: "The body arrived too slowly.",
    409: "Not available in this type of run, or not yet.",
    413: "Too large.",
    422: "Well-formed but invalid; the text contains the reason.",
    429: "Too many requests; Retry-After gives the waiting time.",
    503: "Not ready, or too many concurrent requests.",
    507: "The journal cannot be written (the disk is full), so the request was not carried out.",
}
ERROR = {
    "application/json": {
        "schema": {"$ref": REF.format(name="Error")},
        "example": {"error": "no vehicle 'hawk2'; the vehicles are hawk"},
    }
}
COMMON = {status: {"description": text, "content": ERROR} for status, text in REFUSALS.items()}
OPERATOR_FIELDS = {
    "by": {"type": "string", "description": "Name of the user, if the token is not personal."},
    "station": {
        "type": "string",
        "description": "Station of the user; default: the token's, or the only one.",
    },
}


class RequiredRole:
    """The dependency of a route that requires a role; with ``None`` no token is required."""

    def __init__(self, role: Role | None) -> None:
        self.role = role

    async def __call__(self, request: Request) -> None:
        # The guard has already carried out an abort, for which any valid token is sufficient.
        if self.role is None or hasattr(request.state, "aborted"):
            return
        user = request.state.user
        if user is None:
            raise ApiError(401, "a token is required", {"www-authenticate": "Bearer"})
        if not user.may(self.role):
            raise ApiError(403, f"requires the role {self.role}, which {user.name} does not have")


async def refuse_unknown_query(request: Request) -> None:
    """Raise ApiError 422 for a query parameter that the route does not define.

    A parameter that is given more than once, such as ``preview=true&preview=false``, is refused
    too, because the route would use only one of its values.

    The guard has already carried out an abort, so an abort is accepted with any parameter.
    """
    if hasattr(request.state, "aborted"):
        return
    route: APIRoute = request.scope["route"]
    parts = (route.dependant, *route.dependant.dependencies)
    fields = {each.alias: each for part in parts for each in part.query_params}
    names = list(fields)
    for name in request.query_params:
        if name not in names:
            known = f"the parameters are {', '.join(names)}" if names else "the route has none"
            raise ApiError(422, f"unknown query parameter {name[:40]!r}; {known}")
        many = get_origin(fields[name].field_info.annotation) in (list, tuple)
        if not many and len(request.query_params.getlist(name)) > 1:
            raise ApiError(422, f"query parameter {name!r} appears more than once; specify it once")


def route(
    role: Role | None,
    summary: str,
    answer: Mapping[str, Any],
    takes: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the keyword arguments of a route.

    ``answer`` and ``takes`` are the contents of the response and of the body, by media type.
    """
    extra: dict[str, Any] = {"x-role": role or "nobody"}
    if role is not None:
        extra["security"] = [{"token": []}]
    if takes is not None:
        extra["requestBody"] = {"required": False, "content": dict(takes)}
    success = {200: {"description": "Success.", "content": dict(answer)}}
    return {
        "dependencies": [Depends(RequiredRole(role)), Depends(refuse_unknown_query)],
        "summary": summary,
        "responses": {**success, **COMMON},
        "openapi_extra": extra,
    }


def struct(kind: type, example: Any = None) -> dict[str, Any]:
    """Return the description of a response that is a Struct of type ``kind``."""
    shown = examples.example_of(kind) if example is None else example
    return {"application/json": {"schema": _ref(kind), "example": shown}}


def structs(kind: type) -> dict[str, Any]:
    """Describe a response that is a list of Structs of type ``kind``."""
    schema = {"type": "array", "items": _ref(kind)}
    return {"application/json": {"schema": schema, "example": [examples.example_of(kind)]}}


def json(example: Any, media_type: str = "application/json", what: str = "") -> dict[str, Any]:
    """Return the description of a response that is a JSON object."""
    return {media_type: {"schema": {"type": "object", "description": what}, "example": example}}


def file(media_type: str) -> dict[str, Any]:
    """Return the description of a response that is a file."""
    return {media_type: {"schema": {"type": "string", "format": "binary"}}}


def body(kind: type[requests.Request], without: tuple[str, ...] = ()) -> dict[str, Any]:
    """Describe the body of a request of type ``kind``.

    ``without`` lists the keys that are in the path.
    """
    complete = msgspec.json.schema(kind)["$defs"][kind.__name__]
    omitted = ("do", "by", "station", *without)
    properties = {k: v for k, v in complete["properties"].items() if k not in omitted}
    schema = {
        "type": "object",
        "description": complete.get("description", ""),
        "properties": {**properties, **OPERATOR_FIELDS},
        "required": [key for key in complete["required"] if key not in omitted],
        "additionalProperties": False,
    }
    example = {key: value for key, value in kind.example.items() if key not in without}
    return {"application/json": {"schema": schema, "example": example}}


def _ref(kind: type) -> dict[str, str]:
    return {"$ref": REF.format(name=kind.__name__)}
