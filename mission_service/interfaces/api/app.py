"""Builds the HTTP application of one run: all routes, behind the access guard."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from mission_service import __version__
from mission_service.airspace.operational_intent import OperationalIntents
from mission_service.errors import MissionServiceError
from mission_service.interfaces.api import (
    burn_routes,
    fire_routes,
    health_routes,
    journal_routes,
    mission_routes,
    models,
    observation_routes,
    planner_routes,
    replay_routes,
    request_routes,
    source_routes,
    state_routes,
    vehicle_routes,
)
from mission_service.interfaces.api.access.auth import Tokens
from mission_service.interfaces.api.access.guard import AccessGuard
from mission_service.interfaces.api.basemaps import basemap_routes
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import COMMON, REF, V1, RequiredRole, json, route
from mission_service.interfaces.api.responses import ApiError, encode, error_answer
from mission_service.interfaces.maps.basemaps.tile_files import Basemap
from mission_service.interfaces.maps.draped_images import MapImage
from mission_service.runtime.clocks import wall_us
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.published_states import (
    Announcement,
    MissionState,
    Record,
    SourceState,
    TelemetryState,
    VehicleState,
)
from mission_service.runtime.run_context import RunContext
from mission_service.value_errors import got, missing_key, remedy, schema_at

PAGE = Path(__file__).parents[1] / "web" / "dist"
ANSWERS = (
    models.Error,
    models.RequestResult,
    models.FullState,
    models.Preview,
    models.Importance,
    models.Health,
    Basemap,
    MapImage,
    OperationalIntents,
    MissionState,
    Announcement,
    Record,
    ReplayState,
    SourceState,
    TelemetryState,
    VehicleState,
)
ABOUT = """State, orders and corrections of one run. Mission time is in integer microseconds
(`at_us`); angles are in degrees, directions clockwise from north. See docs/api.md."""


@dataclass(frozen=True)
class Application:
    """The application of one run; ``asgi`` is the access guard in front of ``routes``."""

    asgi: AccessGuard
    routes: FastAPI
    api: ApiContext


def app_of(context: RunContext, tokens: Tokens, page: Path = PAGE) -> Application:
    """Make the application of one run; the caller closes its ``api`` when the run ends.

    ``page`` is the folder of the built map. If the folder is missing, ``/`` returns 404 and a hint.
    """
    api = ApiContext(context, tokens, wall_us)
    app = FastAPI(
        title="mission-service",
        version=__version__,
        description=ABOUT,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    for part in (
        state_routes,
        vehicle_routes,
        mission_routes,
        fire_routes,
        source_routes,
        observation_routes,
        planner_routes,
        burn_routes,
        request_routes,
        journal_routes,
        replay_routes,
        basemap_routes,
        health_routes,
    ):
        part.add(app.router, api)
    described = json({"openapi": "3.1.0"}, what="This description.")

    @app.get(f"{V1}/openapi.json", **route("look", "This description.", described))
    async def openapi() -> Response:
        return Response(
            await asyncio.to_thread(lambda: encode(app.openapi())), media_type="application/json"
        )

    for each in routes_of(app):
        role_of(each)  # raises for a route without a role
    _describe(app)
    _handle_errors(app)
    _serve_page(app, page)
    http = context.settings.http
    hosts = () if http is None else (http.host, *http.hosts)
    return Application(AccessGuard(app, tokens, hosts, api.streams.now_s, api.abort), app, api)


def routes_of(app: FastAPI) -> list[APIRoute]:
    """Return all routes of the API, without those of the map page."""
    return [each for each in app.routes if isinstance(each, APIRoute)]


def role_of(api_route: APIRoute) -> str:
    """Return the role that a route requires, or ``nobody`` if it requires no token.

    Raises MissionServiceError for a route without a role.
    """
    dependencies = [each.dependency for each in api_route.dependencies]
    roles = [each.role for each in dependencies if isinstance(each, RequiredRole)]
    if len(roles) != 1:
        raise MissionServiceError(f"{api_route.path}: the route has no role; add one with route()")
    return roles[0] or "nobody"


def _describe(app: FastAPI) -> None:
    """Add Struct schemas, the token and the common errors to FastAPI's API description."""
    generate: Callable[[], dict[str, Any]] = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            found = generate()
            _, schemas = msgspec.json.schema_components(ANSWERS, ref_template=REF)
            parts = found.setdefault("components", {})
            parts["schemas"] = {**parts.get("schemas", {}), **schemas}
            parts["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
            parts["responses"] = {f"E{status}": COMMON[status] for status in COMMON}
            for each in routes_of(app):
                for method in each.methods or ():
                    operation = found["paths"][each.path_format][method.lower()]
                    # FastAPI removes null values from examples: restore the originals.
                    operation["responses"]["200"] = each.responses[200]
                    operation["responses"] |= {
                        str(status): {"$ref": f"#/components/responses/E{status}"}
                        for status in COMMON
                    }
            app.openapi_schema = found
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _handle_errors(app: FastAPI) -> None:
    """Return all errors in one form; only the log contains the details of internal errors."""

    @app.exception_handler(ApiError)
    async def refused(request: Request, error: ApiError) -> Response:
        return error_answer(error.status, str(error), error.headers)

    @app.exception_handler(HTTPException)
    async def no_route(request: Request, error: HTTPException) -> Response:
        headers = {name.lower(): value for name, value in (error.headers or {}).items()}
        if error.status_code == 405:
            headers["allow"] = ", ".join(_methods(app, request.scope["path"]))
        return error_answer(error.status_code, str(error.detail), headers)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        described = app.openapi()["paths"].get(request.scope["route"].path_format, {})
        operation = described.get(request.method.lower(), {})
        return error_answer(422, _refused_parameter(first, operation))

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> Response:
        return error_answer(500, "internal error of the service; see its log")

    @app.exception_handler(FireModelError)
    @app.exception_handler(BridgeError)
    @app.exception_handler(MissionServiceError)
    async def unusable(request: Request, error: Exception) -> Response:
        return error_answer(422, str(error))


def _refused_parameter(error: dict[str, Any], operation: dict[str, Any]) -> str:
    """Return the text for a refused parameter, from the operation's OpenAPI description."""
    parameters = operation.get("parameters", ())
    schema = {"properties": {each["name"]: each["schema"] for each in parameters}}
    place, *path = error["loc"]
    if error["type"] == "missing":
        return f"{place}.{missing_key(path, schema)}"
    found = schema_at(schema, path)
    words = error["msg"] if found is None else remedy(found, schema)
    return f"{'.'.join(map(str, error['loc']))}: {words}{got(error['input'])}"


def _methods(app: FastAPI, path: str) -> list[str]:
    """Return all methods of a path; the router reports only those of the first matching route."""
    found = [each.methods or set() for each in routes_of(app) if each.path_regex.match(path)]
    return sorted(set().union(*found))


class PageFiles(StaticFiles):
    """The files of the page; clients that accept gzip receive the copy ``NAME.gz``, if any."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return the response for a file."""
        accepted = Headers(scope=scope).get("accept-encoding", "")
        name = "index.html" if path == "." else path
        if "gzip" not in accepted or not self.lookup_path(f"{name}.gz")[1]:
            return await super().get_response(path, scope)
        response = await super().get_response(f"{name}.gz", scope)
        response.headers["content-encoding"] = "gzip"
        response.headers["vary"] = "Accept-Encoding"
        return response


def _serve_page(app: FastAPI, page: Path) -> None:
    """Serve the page for all paths without a route; a wrong method for a route returns 405."""
    if page.is_dir():
        files = PageFiles(directory=page, html=True)

        async def file_or_no_route(scope: Scope, receive: Receive, send: Send) -> None:
            if scope["path"].startswith(V1.rpartition("/")[0]):
                raise HTTPException(404, f"no such route; {V1}/openapi.json lists all routes")
            await files(scope, receive, send)

        app.router.default = file_or_no_route
        return

    async def unbuilt(scope: Scope, receive: Receive, send: Send) -> None:
        text = "the map was not built; see docs/api.md" if scope["path"] == "/" else "Not Found"
        raise HTTPException(404, text)

    app.router.default = unbuilt
