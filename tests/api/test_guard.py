"""Roles, origins and rate limits of every route."""

import asyncio
import gzip
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from mission_service.core.request_events import REQUESTS
from mission_service.errors import MissionServiceError
from mission_service.events import Aborted
from mission_service.interfaces.api.access import guard
from mission_service.interfaces.api.access.auth import ROLES, User
from mission_service.interfaces.api.access.guard import MAX_OF_A_DETECTOR, AccessGuard
from mission_service.interfaces.api.app import role_of, routes_of
from mission_service.interfaces.api.responses import MAX_BODY_BYTES
from mission_service.interfaces.limits import RateLimiter
from tests.api.worlds import HOST, Call, Served, World, calls, client, scenario_of, served, world_in
from tests.patience import until

V1 = "/api/v1"


def asked(world: World, ask: Callable[[Served, httpx.AsyncClient], Awaitable[None]]) -> Served:
    """Run a coroutine against a run's application; its live streams end at once."""
    service = served(world)

    async def go() -> None:
        service.app.api.streams.stopping.set()
        async with client(service.app) as http:
            await ask(service, http)
        service.app.api.context.close()

    asyncio.run(go())
    return service


async def send(http: httpx.AsyncClient, call: Call, headers: dict[str, str]) -> httpx.Response:
    return await http.request(call.method, call.path, json=call.body, headers=headers)


def generous(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AccessGuard, "_check_rate", lambda *_: None)


def test_there_are_routes_and_each_has_a_role(flying: World) -> None:
    found = calls(served(flying).app)
    assert len(found) > 45
    assert {call.role for call in found} == {"nobody", *ROLES}
    assert {call.path for call in found if call.role == "nobody"} == {"/healthz", "/readyz"}


def test_a_route_without_a_role_is_refused() -> None:
    app = FastAPI()

    @app.get("/secret")
    async def secret() -> str:
        return "all"

    (route,) = routes_of(app)
    with pytest.raises(MissionServiceError, match="/secret: the route has no role"):
        role_of(route)


def may(role: str, call: Call) -> bool:
    """Return whether a token with this role may make a call, by docs/api.md."""
    if role == "all" or call.path == f"{V1}/abort":
        return True
    if role == "observe":
        return call.role == "observe"
    return call.role in ("look", role) or (role, call.role) == ("correct", "observe")


def test_a_detector_may_observe_and_nothing_else(flying: World) -> None:
    """A token without any role may look, as before the role observe existed."""
    detector, empty = (User("x", frozenset(roles), "0" * 64) for roles in (("observe",), ()))
    assert [role for role in ROLES if detector.may(role)] == ["observe"]
    assert detector.highest_role == "observe"
    assert [role for role in ROLES if empty.may(role)] == ["look"]
    both = User("x", frozenset(("observe", "look")), "0" * 64)
    assert [role for role in ROLES if both.may(role)] == ["look", "observe"]
    observed = {call.path for call in calls(served(flying).app) if may("observe", call)}
    observations = {f"{V1}/fire/observations{end}" for end in ("", "/raster", "/geotiff")}
    assert observed == {f"{V1}/abort", *observations}


def test_a_detector_that_waits_does_not_block_operators(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    generous(monkeypatch)
    waiting, go_on = [], asyncio.Event()

    async def slow(request: dict[str, Any], *_: Any) -> dict[str, Any]:
        waiting.append(request["by"])
        await go_on.wait()
        return {"ok": True, "at_s": 0.0, "event": "FireObserved", "messages": []}

    monkeypatch.setattr(flying.context.request_handler, "ask_and_wait", slow)

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        def post(role: str) -> asyncio.Task[httpx.Response]:
            headers = service.headers(role)
            return asyncio.create_task(
                http.post(f"{V1}/fire/observations", json={}, headers=headers)
            )

        detector = [post("observe") for _ in range(MAX_OF_A_DETECTOR + 3)]
        await until(lambda: sum(each.done() for each in detector) == 3)
        operator = post("correct")
        await until(lambda: len(waiting) == MAX_OF_A_DETECTOR + 1)
        go_on.set()
        assert (await operator).status_code == 200
        found = sorted([(await each).status_code for each in detector])
        assert found == [200] * MAX_OF_A_DETECTOR + [503] * 3

    asked(flying, ask)


def test_every_route_takes_its_role_and_no_other(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    generous(monkeypatch)

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        for call in calls(service.app):
            without_token = await send(http, call, {})
            stranger = await send(http, call, {"authorization": "Bearer " + "x" * 43})
            if call.role == "nobody":
                assert without_token.status_code == 200, call
                assert stranger.status_code == 200, call
                continue
            for refused in (without_token, stranger):
                assert refused.status_code == 401, call
                assert refused.headers["www-authenticate"] == "Bearer"
                assert list(refused.json()) == ["error"]
            for role in (*ROLES, "all"):
                if call.path.endswith("/geotiff") and may(role, call):
                    continue  # starts a process
                answer = await send(http, call, service.headers(role))
                assert answer.status_code < 500, (call, answer.text)
                if may(role, call):
                    assert answer.status_code not in (401, 403), (call, role)
                else:
                    assert answer.status_code == 403, (call, role)
                    assert call.role in answer.json()["error"]

    asked(flying, ask)


def test_looking_changes_nothing_but_by_an_abort(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    generous(monkeypatch)
    before, lines = len(flying.submitted), flying.context.journal_path.read_bytes().count(b"\n")

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        for call in calls(service.app):
            for method in ("POST", "PATCH", "PUT", "DELETE"):
                if call.path != f"{V1}/abort":
                    tried = Call(method, call.path, call.role, call.body)
                    await send(http, tried, service.headers("look"))
        assert len(flying.submitted) == before
        assert flying.context.journal_path.read_bytes().count(b"\n") == lines
        stop = await http.post(f"{V1}/abort", headers=service.headers("look"))
        assert stop.status_code == 200

    asked(flying, ask)
    assert [type(event) for event in flying.submitted[before:]] == [Aborted]


OTHER_SITES = [
    {"origin": "http://evil.example"},
    {"origin": "null"},
    {"origin": f"https://{HOST}"},
    {"origin": "http://127.0.0.1:9999"},
    {"sec-fetch-site": "cross-site"},
    {"sec-fetch-site": "same-site"},
    {"host": "evil.example"},
    {"host": "evil.example:8765"},
    {"host": "127.0.0.1.evil.example"},
    {"host": ""},
    {"host": "10.1.2.3"},
    {"host": "[2001:db8::1]:8765"},
]


@pytest.mark.parametrize("headers", OTHER_SITES, ids=lambda each: " ".join(*each.items()))
def test_pages_of_other_sites_get_nothing(
    flying: World, headers: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    generous(monkeypatch)
    before = len(flying.submitted)

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        for call in [*calls(service.app), Call("GET", "/", "nobody", None)]:
            for method in (call.method, "OPTIONS"):
                tried = Call(method, call.path, call.role, call.body)
                answer = await send(http, tried, {**service.headers(), **headers})
                assert answer.status_code == 403, (tried, answer.text)
                assert "access-control-allow-origin" not in answer.headers

    asked(flying, ask)
    assert len(flying.submitted) == before


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": f"http://{HOST}", "sec-fetch-site": "same-origin"},
        {"sec-fetch-site": "none"},
        {"host": "localhost:8765", "origin": "http://localhost:8765"},
        {"host": "[::1]:8765"},
        {"host": "127.0.0.9"},
    ],
    ids=str,
)
def test_its_own_pages_and_addresses_are_let_in(flying: World, headers: dict[str, str]) -> None:
    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        answer = await http.get(f"{V1}/vehicles", headers={**service.headers(), **headers})
        assert answer.status_code == 200, answer.text

    asked(flying, ask)


def test_a_name_of_its_own_may_be_behind_a_proxy_with_tls(flying: World) -> None:
    http_section = flying.context.settings.http
    assert http_section is not None
    section = http_section.model_copy(update={"hosts": ("fire.example",)})

    async def go() -> list[int]:
        settings = flying.context.settings
        flying.context.settings = settings.model_copy(update={"http": section})
        try:
            service = served(flying)
        finally:
            flying.context.settings = settings
        found = []
        async with client(service.app) as http:
            for origin in ("https://fire.example", "http://fire.example", "https://evil.example"):
                headers = {**service.headers(), "host": "fire.example", "origin": origin}
                answer = await http.get(f"{V1}/vehicles", headers=headers)
                found.append(answer.status_code)
        return found

    assert asyncio.run(go()) == [200, 200, 403]


def test_every_answer_has_the_headers_that_browsers_obey(flying: World) -> None:
    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        all_of = service.headers()
        for path, headers in [
            ("/healthz", {}),
            ("/", {}),
            (f"{V1}/state", all_of),
            (f"{V1}/state", {}),
            (f"{V1}/nothing", all_of),
            (f"{V1}/vehicles/nobody", all_of),
            (f"{V1}/live", all_of),
            (f"{V1}/state", {"host": "evil.example"}),
        ]:
            response = (await http.get(path, headers=headers)).headers
            policy = response["content-security-policy"]
            assert "frame-ancestors 'none'" in policy
            assert "unsafe" not in policy
            assert "worker-src 'self' blob:" in policy
            assert response["x-content-type-options"] == "nosniff"
            assert response["referrer-policy"] == "no-referrer"
            expected = "no-store" if path.startswith("/api/") else "no-cache"
            assert response["cache-control"] == expected

    asked(flying, ask)


def test_the_page_is_sent_compressed_to_clients_that_accept_it(
    flying: World, tmp_path: Path
) -> None:
    for name in ("index.html", "map.js", "plain.css"):
        (tmp_path / name).write_text("a" * 5000)
    for name in ("index.html", "map.js"):
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(b"a" * 5000))

    async def go() -> None:
        async with client(served(flying, page=tmp_path).app) as http:
            for path, kind in (("/", "text/html"), ("/map.js", "text/javascript")):
                found = await http.get(path)
                assert found.text == "a" * 5000
                assert found.headers["content-encoding"] == "gzip"
                assert found.headers["content-type"].startswith(kind)
                assert int(found.headers["content-length"]) < 100
                plain = await http.get(path, headers={"accept-encoding": "identity"})
                assert plain.text == "a" * 5000
                assert "content-encoding" not in plain.headers
            assert "content-encoding" not in (await http.get("/plain.css")).headers

    asyncio.run(go())


def test_the_page_is_everybodys_and_hides_no_route(flying: World, tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<p>map</p>")
    (tmp_path / "assets" / "map.js").write_text("1")
    (tmp_path.parent / "secret").write_text("secret")

    async def go() -> None:
        service = served(flying, page=tmp_path)
        async with client(service.app) as http:
            page = await http.get("/")
            assert page.text == "<p>map</p>"
            assert "script-src 'self'" in page.headers["content-security-policy"]
            script = await http.get("/assets/map.js")
            assert script.headers["content-type"].startswith("text/javascript")
            for path in ("/../secret", "/%2e%2e/secret", "/assets/..%2f..%2fsecret", "/nothing"):
                assert (await http.get(path)).status_code == 404
            all_of = service.headers()
            assert (await http.post("/", headers=all_of)).status_code == 405
            wrong = await http.get(f"{V1}/abort", headers=all_of)
            assert (wrong.status_code, wrong.headers["allow"]) == (405, "POST")
            both = await http.put(f"{V1}/fire/corrections", headers=all_of)
            assert (both.status_code, both.headers["allow"]) == (405, "GET, POST")
            assert (await http.get(f"{V1}/nothing", headers=all_of)).status_code == 404
            posted = await http.post(f"{V1}/fire/observation", headers=all_of)
            assert posted.status_code == 404
            assert f"no such route; {V1}/openapi.json lists all" in posted.json()["error"]
            assert (await http.get(f"{V1}/nothing")).status_code == 401

    asyncio.run(go())


def test_bodies_have_limits(flying: World) -> None:
    async def parts(size: int) -> Any:
        for _ in range(size // 65536 + 1):
            yield b" " * 65536

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        path, headers = f"{V1}/wind", service.headers()
        long = await http.post(path, content=parts(MAX_BODY_BYTES), headers=headers)
        assert long.status_code == 413
        response = await http.post(
            path, content=b"{}", headers={**headers, "content-length": "1" * 9}
        )
        assert response.status_code == 413
        deep = await http.post(path, content=b"[" * 100_000, headers=headers)
        assert deep.status_code == 400
        bad = await http.post(path, content=b'{"speed_m_s": \xff}', headers=headers)
        assert bad.status_code == 400

    asked(flying, ask)


def test_too_many_requests_wait_but_an_abort_never_does(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_rate = AccessGuard._check_rate

    def at_one_time(guard: AccessGuard, limiter: RateLimiter, client: str) -> None:
        guard._now_s = lambda: 100.0  # a slow machine would send fewer requests a second
        check_rate(guard, limiter, client)

    monkeypatch.setattr(AccessGuard, "_check_rate", at_one_time)

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        undo = [
            await http.post(f"{V1}/fire/undo", headers=service.headers("correct"))
            for _ in range(60)
        ]
        # Other tests may have drawn corrections; after their removal there is nothing to undo
        # (422).
        assert {each.status_code for each in undo[:30]} <= {200, 422}
        assert undo[-1].status_code == 429
        assert int(undo[-1].headers["retry-after"]) >= 1
        # Other users are not slowed down, and aborts of the same user are not limited.
        other = await http.post(f"{V1}/fire/undo", headers=service.headers("all"))
        assert other.status_code in (200, 422)
        for _ in range(100):
            stop = await http.post(f"{V1}/abort", headers=service.headers("correct"))
            assert stop.status_code == 200

    asked(flying, ask)


def test_wrong_tokens_are_slowed_down_and_right_ones_are_not(flying: World) -> None:
    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        wrong = {"authorization": "Bearer wrong"}
        found = [(await http.get(f"{V1}/state", headers=wrong)).status_code for _ in range(40)]
        assert found[0] == 401
        assert found[-1] == 429
        right = await http.get(f"{V1}/state", headers=service.headers("look"))
        assert right.status_code == 200

    asked(flying, ask)


def test_with_too_many_that_read_what_changes_and_health_get_through(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "MAX_READING", 0)

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        busy = await http.get(f"{V1}/state", headers=service.headers())
        assert busy.status_code == 503
        assert busy.headers["retry-after"] == "1"
        wind = {"speed_m_s": 3.0, "from_deg": 200.0}
        change = await http.post(f"{V1}/wind", json=wind, headers=service.headers())
        assert change.status_code == 200
        assert (await http.get("/healthz")).status_code == 200
        stop = await http.post(f"{V1}/abort", headers=service.headers("look"))
        assert stop.status_code == 200

    asked(flying, ask)


@pytest.mark.parametrize("body", [b"", b"{}", b"nonsense", b"[" * 70_000, b'{"by": 7}', b"null"])
def test_an_abort_is_accepted_whatever_its_content(flying: World, body: bytes) -> None:
    before = len(flying.submitted)

    async def ask(service: Served, http: httpx.AsyncClient) -> None:
        stop = await http.post(f"{V1}/abort", content=body, headers=service.headers("look"))
        assert stop.json()["event"] == "Aborted"

    asked(flying, ask)
    assert len(flying.submitted) == before + 1


def test_with_a_tokens_file_everybody_acts_under_their_own_name(flying: World) -> None:
    async def go() -> None:
        service = served(flying, named=True)
        async with client(service.app) as http:
            path, headers = f"{V1}/wind", service.headers("correct")
            wind = {"speed_m_s": 3.0, "from_deg": 200.0}
            other = await http.post(path, json={**wind, "by": "all"}, headers=headers)
            assert other.status_code == 403
            assert (await http.post(path, json=wind, headers=headers)).status_code == 200
            assert flying.submitted[-1].by == "correct"
            stop = await http.post(f"{V1}/abort", json={"by": "fly"}, headers=headers)
            assert stop.status_code == 200
            assert flying.submitted[-1].by == "correct"

    asyncio.run(go())


@pytest.mark.parametrize("named", [True, False])
def test_an_event_has_a_field_for_whether_its_user_may_approve(tmp_path: Path, named: bool) -> None:
    """In a user's own token, the role decides; without users, the role of the request decides."""
    world = world_in(tmp_path, scenario_of("burn", ()))
    item = world.context.burn()["go_items"][0]  # type: ignore[index]

    async def go() -> None:
        service = served(world, named)
        async with client(service.app) as http:
            for name, path, body in (
                ("correct", "wind", {"speed_m_s": 2.0, "from_deg": 0.0}),
                ("all", "wind", {"speed_m_s": 2.0, "from_deg": 0.0}),
                ("all", "burn/present", {}),
                ("approve", "burn/go", {"item": item}),
            ):
                headers = service.headers(name)
                answer = await http.post(f"{V1}/{path}", json=body, headers=headers)
                assert answer.status_code == 200

    asyncio.run(go())
    assert [event.may_approve for event in world.submitted] == [False, named, True, True]


def test_what_takes_the_role_approve_is_the_same_for_all_interfaces() -> None:
    approvers = {"approve", "reject", "go", "no-go", "present", "unit"}
    assert {do for do, kind in REQUESTS.items() if kind.role == "approve"} == approvers


def test_the_address_that_a_connection_came_to_is_a_right_host(flying: World) -> None:
    async def go() -> None:
        service = served(flying)
        for server, host, status in (
            (("192.0.2.1", 8765), "192.0.2.1:8765", 200),
            (("192.0.2.1", 8765), "192.0.2.2:8765", 403),
            (("2001:db8::1", 8765), "[2001:db8::1]", 200),
        ):
            sent: list[Any] = []

            async def send(message: Any, sent: list[Any] = sent) -> None:
                sent.append(message)

            async def receive() -> Any:
                return {"type": "http.request", "body": b"", "more_body": False}

            scope = {
                "type": "http",
                "method": "GET",
                "path": "/healthz",
                "raw_path": b"/healthz",
                "query_string": b"",
                "headers": [(b"host", host.encode())],
                "server": server,
                "client": ("192.0.2.9", 5),
                "scheme": "http",
            }
            await service.app.asgi(scope, receive, send)
            assert sent[0]["status"] == status, (server, host)

    asyncio.run(go())
