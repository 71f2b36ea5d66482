"""Fixtures: a run with vehicles in the air, for tests that do not depend on its exact state."""

import subprocess
from pathlib import Path

import pytest

from tests.api.worlds import World, scenario_of, world_in


@pytest.fixture(scope="session")
def flying(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Return a run with two vehicles; one of them is in the air on its way to the fire."""
    world = world_in(tmp_path_factory.mktemp("run"), scenario_of())
    world.fly(3700.0)
    return world


@pytest.fixture
def standing(tmp_path: Path) -> World:
    """Return a run that has not begun."""
    return world_in(tmp_path, scenario_of())


@pytest.fixture(scope="session")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a self-signed certificate for 127.0.0.1 and its key."""
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = folder / "cert.pem", folder / "key.pem"
    line = [
        *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"),
        *("-nodes", "-days", "2", "-subj", "/CN=localhost", "-keyout", str(key)),
        *("-addext", "subjectAltName=IP:127.0.0.1", "-out", str(certificate)),
    ]
    try:
        subprocess.run(line, check=True, capture_output=True)
    except FileNotFoundError:
        pytest.skip("no openssl to make a certificate with")
    return certificate, key
