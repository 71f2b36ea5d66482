"""Requests generated from the OpenAPI description; each response matches the description.

``python -m benchmarks.api_fuzz`` sends many more requests over a socket.
"""

import asyncio
from collections import Counter
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from mission_service.interfaces.api.access.guard import AccessGuard
from tests.api.worlds import World, client, served
from tests.patience import PATIENCE_S

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
]
EXAMPLES = 2
FEW = settings(
    max_examples=EXAMPLES,
    database=None,
    derandomize=True,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.long
def test_all_answers_are_as_described(flying: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AccessGuard, "_check_rate", lambda *_: None)
    service = served(flying)
    service.app.api.streams.stopping.set()  # excluded, because a live stream never ends
    schema = schemathesis.openapi.from_dict(service.app.routes.openapi())
    answers: Counter[int] = Counter()
    with asyncio.Runner() as runner:
        http = client(service.app, headers=service.headers(), timeout=PATIENCE_S)

        def ask(case: Any) -> None:
            arguments = case.as_transport_kwargs(base_url="http://127.0.0.1:8765")
            sent = {
                key: arguments[key] for key in ("params", "json", "cookies") if arguments.get(key)
            }
            if "data" in arguments:
                sent["content"] = arguments["data"]
            headers = {name.lower(): value for name, value in arguments["headers"].items()}
            headers |= service.headers()  # an existing name instead of a generated one
            request = http.build_request(
                arguments["method"], arguments["url"], **sent, headers=headers
            )
            response = runner.run(http.send(request))
            case.validate_response(response, checks=CHECKS)
            answers[response.status_code] += 1

        for found in schema.get_all_operations():
            operation = found.ok()  # type: ignore[union-attr]
            FEW(given(case=operation.as_strategy())(ask))()
        service.app.api.context.close()
        runner.run(http.aclose())
    assert answers.total() >= EXAMPLES * 45
    assert answers[200] > 20  # many requests are carried out
    assert answers[401] == answers[403] == 0  # and not all requests are refused
