"""Encodes responses and decodes request bodies as JSON; all errors have one form."""

from typing import Any

import msgspec
from fastapi import Request, Response

MAX_BODY_BYTES = 1024 * 1024
MAX_PERIMETER_BYTES = 10 * 1024 * 1024

encode = msgspec.json.Encoder().encode


class ApiError(Exception):
    """An HTTP status of 400 or more, with the reason in one line."""

    def __init__(self, status: int, text: str, headers: dict[str, str] | None = None) -> None:
        super().__init__(text)
        self.status = status
        self.headers = headers


def error_body(text: str) -> bytes:
    """Return the JSON body of every error, with ``text`` on one line."""
    return encode({"error": " ".join(text.split())})


def error_answer(status: int, text: str, headers: dict[str, str] | None = None) -> Response:
    """Return an error as an HTTP response."""
    return Response(error_body(text), status, headers, "application/json")


def answer(content: Any, media_type: str = "application/json") -> Response:
    """Return a response with ``content`` (msgspec Structs, dictionaries, lists) as JSON."""
    return Response(encode(content), media_type=media_type)


async def body_of(request: Request, max_bytes: int = MAX_BODY_BYTES) -> bytes:
    """Return the body of a request, which the guard has read.

    Raises ApiError 413 for more than ``max_bytes``.
    """
    body = await request.body()
    if len(body) > max_bytes:
        raise ApiError(413, f"the body has more than {max_bytes} bytes")
    return body


async def json_body(request: Request) -> dict[str, Any]:
    """Return the JSON object in a request's body, or {} for an empty body. Raises ApiError."""
    body = await body_of(request)
    if not body.strip():
        return {}
    try:
        found = msgspec.json.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ApiError(400, f"the body is not JSON: {error}") from None
    if not isinstance(found, dict):
        raise ApiError(422, 'the body must be a JSON object, such as {"by": "Anna"}')
    return found
