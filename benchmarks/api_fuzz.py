"""Run schemathesis on the whole HTTP API of a flying run, over a real socket.

    python -m benchmarks.api_fuzz [EXAMPLES] [SCENARIO] [SEED]

EXAMPLES (default 100) is the maximum number of examples for each route; SCENARIO is ``demo``
(default) or ``burn``. The exit code is that of schemathesis. It is 0 if all of these hold: the API
sent no 5xx response except 503 and 507, which state their reason; the status, content type and
schema of each response agree with the OpenAPI description; the API rejected each request without a
token or with a wrong method.
"""

import asyncio
import sys
import tempfile
import time
from pathlib import Path

import click

from mission_service.config.service_section import HttpSection
from mission_service.interfaces.api.server import bound, serving
from mission_service.interfaces.limits import RateLimiter
from tests.api.worlds import SMALL, World, scenario_of, served, world_in

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "unsupported_method",
    "allow_header_conformance",
    "ignored_auth",
)
FLY_EVERY_S, SPEEDUP = 0.1, 10.0


async def fuzz(world: World, examples: int, seed: int) -> int:
    """Run schemathesis while the simulated flight continues; return its exit code."""
    service = served(world)
    guard = service.app.asgi
    # No rate limit, otherwise most responses would be 429.
    for name in ("_reading", "_changing", "_failing"):
        setattr(guard, name, RateLimiter(1e6, 1e6))
    service.app.api.streams.stopping.set()  # excluded, because a live stream never ends
    with bound(HttpSection(listen="127.0.0.1:0")) as listening:
        async with serving(guard, listening, asyncio.Event(), None):
            url = f"http://127.0.0.1:{listening.getsockname()[1]}"
            line = [
                *(sys.executable, "-m", "schemathesis.cli", "run", f"{url}/api/v1/openapi.json"),
                *("--url", url, "-H", f"Authorization: Bearer {service.tokens['all']}"),
                *("--checks", ",".join(CHECKS), "--max-examples", str(examples)),
                *("--phases", "examples,coverage,fuzzing", "--seed", str(seed)),
                *("--continue-on-failure", "--no-color", "--warnings", "off"),
                *("--suppress-health-check", "all", "--request-timeout", "30"),
            ]
            # Schemathesis writes a cache into its working directory.
            running = await asyncio.create_subprocess_exec(*line, cwd=world.context.out)
            ended = asyncio.create_task(running.wait())
            while not ended.done():
                await asyncio.wait([ended], timeout=FLY_EVERY_S)
                world.fly(world.now_s + FLY_EVERY_S * SPEEDUP)
            return ended.result()


def main() -> None:
    """Create the run, fuzz its API and print the time this took."""
    given = [*sys.argv[1:], *("100", "demo", "1")[len(sys.argv) - 1 :]]
    examples, name, seed = int(given[0]), given[1], int(given[2])
    with tempfile.TemporaryDirectory() as folder:
        world = world_in(Path(folder), scenario_of(name, SMALL if name == "demo" else ()))
        world.fly(world.now_s + 100.0)
        began_s = time.monotonic()
        code = asyncio.run(fuzz(world, examples, seed))
        took_s = time.monotonic() - began_s
        click.echo(f"{name}: {took_s:.0f} s; {len(world.submitted)} requests became events")
    sys.exit(code)


if __name__ == "__main__":
    main()
