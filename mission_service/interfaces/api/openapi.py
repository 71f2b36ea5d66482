"""The OpenAPI description of a route: role, request body, response, example.

Schemas are generated from the msgspec Structs, so they agree with the code.
"""

from collections.abc import Mapping
from typing import Any

import msgspec
from fastapi import Depends, Request

from mission_service import requests
from mission_service.interfaces import examples
from mission_service.interfaces.api.responses import ApiError
from mission_service.requests import Role

V1 = "/api/v1"
REF = "#/components/schemas/{name}"
REFUSALS = {
    400: "The request cannot be read.",
    401: "No token, or one that is not valid.",
    403: "The token has not the role, or the page is of another origin.",
    404: "There is no such thing.",
    408: "The body did not come in time.",
    409: "Not in this kind of run.",
    413: "Too large.",
    422: "Understood, and wrong: the line says what.",
    429: "Too often; Retry-After says when again.",
    503: "Not now: too many at once, or not ready.",
    507: "It cannot be written down (the disk is full, say), so it was not done.",
}
ERROR = {
    "application/json": {
        "schema": {"$ref": REF.format(name="Error")},
        "example": {"error": "no vehicle 'hawk2'; there are hawk"},
    }
}
COMMON = {status: {"description": text, "content": ERROR} for status, text in REFUSALS.items()}
WHO = {
    "by": {"type": "string", "description": "Who asks, where the token is nobody's own."},
    "station": {"type": "string", "description": "From where; default: the token's, or the only."},
}


class RequiredRole:
    """A dependency of a route that requires a role. ``None``: no token is required."""

    def __init__(self, role: Role | None) -> None:
        self.role = role

    async def __call__(self, request: Request) -> None:
        if self.role is None:
            return
        who = request.state.who
        if who is None:
            raise ApiError(401, "a token is needed", {"www-authenticate": "Bearer"})
        if not who.may(self.role):
            raise ApiError(403, f"this takes the role {self.role}; {who.name} has it not")


def route(
    role: Role | None,
    summary: str,
    answer: Mapping[str, Any],
    takes: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The keyword arguments of a route. ``answer``, ``takes``: content by media type."""
    extra: dict[str, Any] = {"x-role": role or "nobody"}
    if role is not None:
        extra["security"] = [{"token": []}]
    if takes is not None:
        extra["requestBody"] = {"required": False, "content": dict(takes)}
    found = {200: {"description": "As asked.", "content": dict(answer)}}
    return {
        "dependencies": [Depends(RequiredRole(role))],
        "summary": summary,
        "responses": {**found, **COMMON},
        "openapi_extra": extra,
    }


def struct(kind: type, example: Any = None) -> dict[str, Any]:
    """A response that is a Struct of type ``kind``."""
    shown = examples.example_of(kind) if example is None else example
    return {"application/json": {"schema": _ref(kind), "example": shown}}


def structs(kind: type) -> dict[str, Any]:
    """A response that is a list of Structs of type ``kind``."""
    schema = {"type": "array", "items": _ref(kind)}
    return {"application/json": {"schema": schema, "example": [examples.example_of(kind)]}}


def json(example: Any, media_type: str = "application/json", what: str = "") -> dict[str, Any]:
    """A response that is a JSON object."""
    return {media_type: {"schema": {"type": "object", "description": what}, "example": example}}


def file(media_type: str) -> dict[str, Any]:
    """A response that is a file."""
    return {media_type: {"schema": {"type": "string", "format": "binary"}}}


def body(kind: type[requests.Request], without: tuple[str, ...] = ()) -> dict[str, Any]:
    """The body of a request of type ``kind``; ``without``: keys that the path contains."""
    whole = msgspec.json.schema(kind)["$defs"][kind.__name__]
    left_out = ("do", "by", "station", *without)
    properties = {k: v for k, v in whole["properties"].items() if k not in left_out}
    schema = {
        "type": "object",
        "description": whole.get("description", ""),
        "properties": {**properties, **WHO},
        "required": [key for key in whole["required"] if key not in left_out],
        "additionalProperties": False,
    }
    example = {key: value for key, value in kind.example.items() if key not in without}
    return {"application/json": {"schema": schema, "example": example}}


def _ref(kind: type) -> dict[str, str]:
    return {"$ref": REF.format(name=kind.__name__)}
