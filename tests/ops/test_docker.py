"""Containers and systemd units, checked by their files without a container engine."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
DOCKER = ROOT / "docker"
COMPOSE: dict[str, Any] = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
OURS = ("demo", "px4-service", "ardupilot-service", "live")


def test_there_is_a_profile_for_each_way_to_run() -> None:
    found = {profile for service in SERVICES.values() for profile in service["profiles"]}
    assert found == {"demo", "px4", "ardupilot", "live", "monitoring"}


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_is_healthy_limited_and_can_change_nothing(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]
    assert service["healthcheck"]["test"][0] in ("CMD", "CMD-SHELL")
    for limit in ("mem_limit", "cpus", "pids_limit"):
        assert service[limit]
    for forbidden in ("privileged", "cap_add", "pid", "ipc", "userns_mode"):
        assert forbidden not in service
    assert service.get("network_mode", "service:").startswith("service:")
    tag = service["image"].rpartition(":")[2].rstrip("}")
    assert tag != "latest" or "build" in service or name.endswith("-door")


@pytest.mark.parametrize("name", SERVICES)
def test_ports_are_published_on_loopback(name: str) -> None:
    for port in SERVICES[name].get("ports", []):
        assert str(port).startswith("127.0.0.1:")


@pytest.mark.parametrize("name", OURS)
def test_each_service_has_an_entry_point_and_prometheus_has_it_as_a_target(name: str) -> None:
    service = SERVICES[name]
    run_interface = next(
        each for each in SERVICES.values() if each.get("network_mode") == f"service:{name}"
    )
    assert run_interface["entrypoint"][0] == "socat"
    assert run_interface["profiles"] == service["profiles"]
    assert f'--set=service.http.hosts=["{name}"]' in service["command"]
    out = next(word for word in service["command"] if word.startswith("--out="))[6:]
    jobs = yaml.safe_load((DOCKER / "prometheus" / "prometheus.yml").read_text("utf-8"))
    job = next(
        each for each in jobs["scrape_configs"] if each["dns_sd_configs"][0]["names"] == [name]
    )
    assert job["authorization"]["credentials_file"] == f"{out}/token"


@pytest.mark.parametrize("name", OURS)
def test_what_services_run_is_a_command_with_these_options(name: str) -> None:
    from click.testing import CliRunner

    from mission_service.cli.main import main

    command, *words = SERVICES[name]["command"]
    output = CliRunner().invoke(main, [command, "--help"]).output
    for word in words:
        if word.startswith("--"):
            assert word.partition("=")[0] in output
    for word in words:
        key = re.match(r"--set=([\w.]+)=", word)
        if key is not None:
            _setting_exists(key[1])


def _setting_exists(key: str) -> None:
    from mission_service.config.service_section import HttpSection, MqttSection, ServiceSection

    sections: dict[str, Any] = {"http": HttpSection, "mqtt": MqttSection}
    first, section, *rest = key.split(".")
    assert first == "service"
    assert section in ServiceSection.model_fields
    for name in rest:
        assert name in sections[section].model_fields


def test_what_is_mounted_is_there() -> None:
    for service in SERVICES.values():
        for volume in service.get("volumes", []):
            source = volume.partition(":")[0]
            if source.startswith("./"):
                assert (DOCKER / source).exists(), source
            elif not source.startswith("$"):
                assert source in COMPOSE["volumes"]


def test_the_image_runs_our_command_as_an_unprivileged_user() -> None:
    lines = (DOCKER / "Dockerfile").read_text(encoding="utf-8").splitlines()
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["scripts"]
    entry = next(line for line in lines if line.startswith("ENTRYPOINT"))
    assert re.findall(r'"([\w-]+)"', entry)[0] in scripts
    final = lines[max(n for n, line in enumerate(lines) if line.startswith("FROM")) :]
    user = next(line.split()[1] for line in final if line.startswith("USER"))
    assert int(user.partition(":")[0]) > 0
    assert "STOPSIGNAL SIGTERM" in final
    assert any(line.startswith("HEALTHCHECK") for line in final)
    for line in lines:
        if line.startswith("COPY") and "--from" not in line:
            for source in line.split()[1:-1]:
                kept = source.rstrip("/").split("/")[0]
                assert f"!{kept}" in (ROOT / ".dockerignore").read_text("utf-8")


def test_the_unit_is_watched_and_confined() -> None:
    text = (DOCKER / "systemd" / "mission-service.service").read_text(encoding="utf-8")
    for line in ("Type=notify", "DynamicUser=yes", "ProtectSystem=strict", "NoNewPrivileges=yes"):
        assert line in text.splitlines()
    assert re.search(r"^WatchdogSec=\d+$", text, re.MULTILINE)
    assert re.search(r"^ExecStart=\S+/mission-service run ", text, re.MULTILINE)
