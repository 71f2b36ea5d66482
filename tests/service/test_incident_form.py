"""The page for a new incident: its server, and the scenario that a form makes."""

import http.client
import json
import shlex
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mission_service.cli.incident import incident_commands
from mission_service.config.scenario import load_scenario
from mission_service.errors import MissionServiceError
from mission_service.interfaces.incident_form import Form, FormServer, options_of, uploads_of
from mission_service.interfaces.incident_form.form_options import LayerFile
from tests.patience import PATIENCE_S
from tests.service.test_cli import call

FORM: dict[str, Any] = {
    "box": "-84.2,36.32,-84.1,36.4",
    "wind": "5,225",
    "ignitions": ["36.35,-84.15"],
    "aircraft": ["hawk,px4,plane,36.36,-84.14,tcp:127.0.0.1:5760"],
}
TOKEN = "secret-of-the-test"


class Site:
    """A server of the page that runs in a thread."""

    def __init__(self, file: Path, folder: Path, page: Path) -> None:
        self.file, self.folder = file, folder

        def create(options: list[str]) -> dict[str, Any]:
            return incident_commands.created_by_form(file, options)

        self.server = FormServer(0, folder, TOKEN, create, page)
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()

    def ask(
        self, method: str, path: str, body: bytes = b"", **headers: str
    ) -> tuple[int, dict[str, Any]]:
        """Return the status and the JSON of a reply."""
        given = {"authorization": f"Bearer {TOKEN}", **headers}
        connection = http.client.HTTPConnection("127.0.0.1", self.server.server_port, timeout=60)
        connection.request(method, path, body, given)
        reply = connection.getresponse()
        content = reply.read()
        connection.close()
        return reply.status, json.loads(content) if method != "GET" else {"text": content.decode()}

    def post(self, **fields: Any) -> tuple[int, dict[str, Any]]:
        return self.ask("POST", "/incident", json.dumps({**FORM, **fields}).encode())


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    page = tmp_path / "dist" / "incident.html"
    page.parent.mkdir()
    page.write_text("the form")
    file = tmp_path / "fire.toml"
    with uploads_of(file) as folder:
        found = Site(file, folder, page)
        try:
            yield found
        finally:
            found.server.shutdown()
            found.server.server_close()
            found.thread.join(PATIENCE_S)


def test_a_completed_form_makes_a_scenario_and_ends_the_server(site: Site) -> None:
    status, reply = site.post(hours="4", moistures="5,6,7,60,90")
    assert (status, reply["next"].split()[:2]) == (200, ["mission-service", "sim"])
    site.thread.join(PATIENCE_S)
    assert not site.thread.is_alive()
    loaded = load_scenario(str(site.file))
    assert loaded.duration_s == 4 * 3600
    assert loaded.vehicles[0].link == "tcp:127.0.0.1:5760"
    assert loaded.weather[0].dead_1h_pct == 5.0


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"wind": "5"}, "write it as SPEED,FROM"),
        ({"wind": ""}, "specify --wind or --weather"),
        ({"aircraft": []}, "specify --vehicle"),
        ({"ignitions": ["37.35,-84.15"]}, "lies outside the landscape"),
        ({"perimeter": "outline.geojson", "ignitions": []}, "outline.geojson: no such file"),
        ({"landscape": "../../etc/passwd", "box": ""}, "no such file"),
        ({"colour": "red"}, "colour"),
        ({"hours": "-1"}, "hours"),
        ({"hours": "nan"}, "hours"),
        ({"fuel_model": "9" * 30}, "fuel-model"),
        ({"aircraft": ["hawk,px4,plane,36.36,-84.14,127.0.0.1:14550"]}, "link"),
    ],
)
def test_a_wrong_form_is_refused_and_nothing_is_written(
    site: Site, fields: dict[str, Any], words: str
) -> None:
    status, reply = site.post(**fields)
    assert status == 422
    assert words in reply["error"]
    assert "\n" not in reply["error"]
    assert not site.file.exists()
    assert site.post()[0] == 200  # a corrected form is accepted


def test_an_uploaded_file_is_used_and_stays_beside_the_scenario(tmp_path: Path) -> None:
    outline = {"type": "Polygon", "coordinates": [[
        [-84.15, 36.35], [-84.145, 36.35], [-84.145, 36.355], [-84.15, 36.355], [-84.15, 36.35],
    ]]}  # fmt: skip
    page = tmp_path / "incident.html"
    page.write_text("")
    file = tmp_path / "fire.toml"
    with uploads_of(file) as folder:
        site = Site(file, folder, page)
        stored = site.ask("PUT", "/files/outline.geojson", json.dumps(outline).encode())
        assert stored == (200, {"file": "outline.geojson"})
        assert site.post(ignitions=[], perimeter="outline.geojson")[0] == 200
        site.thread.join(PATIENCE_S)
        site.server.server_close()
    assert load_scenario(str(file)).fire.perimeter is not None
    assert [each.name for each in (tmp_path / "fire-files").iterdir()] == ["outline.geojson"]


@pytest.mark.parametrize("name", ["..%2Fx", "%2Fetc%2Fx", ".hidden", "a%20b", "", "x" * 101])
def test_a_file_name_that_is_not_plain_is_refused(site: Site, name: str) -> None:
    assert site.ask("PUT", f"/files/{name}", b"x")[0] == 422
    assert list(site.folder.iterdir()) == []


def test_requests_of_other_sites_and_without_the_token_are_refused(site: Site) -> None:
    assert site.ask("PUT", "/files/x", b"x", authorization="Bearer wrong")[0] == 401
    assert site.ask("PUT", "/files/x", b"x", host="evil.example")[0] == 403
    assert site.ask("POST", "/other", b"{}")[0] == 404
    assert site.ask("POST", "/incident", b"{")[0] == 422
    assert list(site.folder.iterdir()) == []


def test_an_upload_that_ends_early_is_not_stored(site: Site) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", site.server.server_port, timeout=60)
    connection.putrequest("PUT", "/files/x.tif")
    connection.putheader("authorization", f"Bearer {TOKEN}")
    connection.putheader("content-length", "1000")
    connection.endheaders(b"only a part")
    assert connection.sock is not None
    connection.sock.shutdown(1)
    assert connection.getresponse().status == 400
    connection.close()
    assert list(site.folder.iterdir()) == []


def test_a_large_refused_upload_gets_the_reason(site: Site) -> None:
    status, reply = site.ask("PUT", "/files/.bad", b"x" * 5_000_000)
    assert (status, "rename the file" in reply["error"]) == (422, True)


def test_a_defect_is_reported_and_the_form_remains(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(options: list[str]) -> dict[str, Any]:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(site.server, "create", broken)
    assert site.post() == (500, {"error": "internal error: ZeroDivisionError: a defect"})
    monkeypatch.undo()
    assert site.post()[0] == 200


def test_the_form_ends_after_saving_if_the_tab_was_closed_meanwhile(site: Site) -> None:
    body = json.dumps(FORM).encode()
    head = (
        f"POST /incident HTTP/1.1\r\nhost: 127.0.0.1:{site.server.server_port}\r\n"
        f"authorization: Bearer {TOKEN}\r\ncontent-length: {len(body)}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", site.server.server_port)) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.sendall(head.encode() + body)
    site.thread.join(PATIENCE_S)
    assert not site.thread.is_alive()
    assert site.file.exists()


def test_a_layer_is_given_only_once(site: Site) -> None:
    site.ask("PUT", "/files/fuel.tif", b"x")
    layers = [{"name": "fuel", "file": "fuel.tif"}] * 2
    status, reply = site.post(box="", layers=layers)
    assert (status, "only once" in reply["error"]) == (422, True)


def test_the_next_command_can_be_pasted_for_any_file_name(tmp_path: Path) -> None:
    for name in ("my fire.toml", "🔥.toml", "-x.toml", "a;b.toml"):
        options = [f"--{key}={FORM[key]}" for key in ("box", "wind")]
        options += [f"--ignition={FORM['ignitions'][0]}", f"--vehicle={FORM['aircraft'][0]}"]
        shown = incident_commands.created_by_form(tmp_path / name, options)
        assert shlex.split(shown["next"])[2] == str(tmp_path / name)
        assert load_scenario(str(tmp_path / name)).name == name.removesuffix(".toml")


def test_the_page_is_served_with_a_content_security_policy(site: Site) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", site.server.server_port, timeout=60)
    for path in ("/", "/?a=1"):
        connection.request("GET", path)
        reply = connection.getresponse()
        assert reply.read() == b"the form"
        assert "default-src 'none'" in reply.headers["content-security-policy"]
    connection.close()


def test_uploads_are_removed_without_a_scenario_and_never_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "fire.toml"
    with uploads_of(file) as folder:
        (folder / "fuel.tif").write_text("")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "fire-files").mkdir()
    with pytest.raises(MissionServiceError, match="exists"), uploads_of(file):
        pass


def test_a_page_that_was_not_built_is_reported(tmp_path: Path) -> None:
    with pytest.raises(MissionServiceError, match="run make web"):
        FormServer(0, tmp_path, TOKEN, lambda options: {}, tmp_path / "incident.html")


def test_every_option_of_the_command_that_the_form_has_is_accepted(tmp_path: Path) -> None:
    for name in ("dem.tif", "w.raws"):
        (tmp_path / name).write_text("")
    form = Form(
        layers=(LayerFile("slope", "dem.tif", "percent"),),
        weather="w.raws",
        ignitions=("-36.35,-84.15",),
        real=True,
    )
    options = options_of(form, tmp_path)
    assert "--ignition=-36.35,-84.15" in options
    given = incident_commands.new.make_context("new", [str(tmp_path / "x.toml"), *options]).params
    assert given["weather"] == tmp_path / "w.raws"
    assert given["layers"] == (("slope", str(tmp_path / "dem.tif")),)
    assert given["units"] == (("slope", "percent"),)
    assert given["real"]


def test_the_command_refuses_an_existing_scenario(tmp_path: Path) -> None:
    file = tmp_path / "fire.toml"
    file.write_text("")
    result = call("incident", "page", str(file), "--no-browser")
    assert result.exit_code == 1
    assert f"{file}: already exists; choose another name" in result.output
