"""Defines the routes for liveness, readiness and metrics (Prometheus)."""

from fastapi import APIRouter, Response

from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.models import Health
from mission_service.interfaces.api.openapi import route, struct
from mission_service.interfaces.api.responses import ApiError, encode


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/healthz`` and ``/readyz``, without a token, and ``/metrics``."""
    healthy = struct(Health, {"ok": True, "not_ready": []})

    @routes.get("/healthz", **route(None, "Liveness of the service.", healthy))
    async def healthz() -> Response:
        return Response(encode(Health(True)), media_type="application/json")

    @routes.get("/readyz", **route(None, "Readiness of the service, or missing parts.", healthy))
    async def readyz() -> Response:
        lacks = api.context.ready()
        if api.context.stopping:
            lacks = [*lacks, "service: is stopping"]
        if lacks:
            raise ApiError(503, "; ".join(lacks))
        return Response(encode(Health(True)), media_type="application/json")

    text = {"text/plain": {"schema": {"type": "string"}}}

    @routes.get("/metrics", **route("look", "Metrics for Prometheus.", text))
    async def metrics() -> Response:
        # Imports prometheus_client at the first request.
        from mission_service.interfaces.metrics import metrics_of

        content, media_type = metrics_of(api.context)
        return Response(content, headers={"content-type": media_type})
