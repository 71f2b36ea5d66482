"""Photos of notes: stored beside the journal, and refused with one line."""

import hashlib
import io
import json
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import httpx
import pytest
from PIL import Image

from mission_service import uploaded_photos as photos
from mission_service.products.features import layers_of
from mission_service.products.journal_incident import incident_in
from mission_service.products.kmz import write_kmz
from mission_service.uploaded_photos import PhotoError, photo_name, photo_path, store_photo
from tests.api.test_routes import SQUARE, V1, asked, got, posted
from tests.api.worlds import scenario_of, world_in


def picture(form: str = "JPEG", size: tuple[int, int] = (60, 40)) -> bytes:
    """Return the bytes of an image file."""
    content = io.BytesIO()
    Image.new("RGB", size, (200, 90, 20)).save(content, form)
    return content.getvalue()


@pytest.mark.parametrize(("form", "extension"), [("JPEG", "jpg"), ("PNG", "png"), ("WEBP", "webp")])
def test_the_name_of_a_photo_is_its_hash_and_format(form: str, extension: str) -> None:
    data = picture(form)
    assert photo_name(data) == f"{hashlib.sha256(data).hexdigest()}.{extension}"


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is not a photo"),
        (b"<html>", "is not a photo"),
        (picture("GIF"), "is not a photo"),
        (picture("JPEG", (600, 400))[:900], "is corrupt"),
        (picture("PNG", (600, 400))[:400], "is corrupt"),
    ],
)
def test_other_files_are_refused_with_one_line(data: bytes, reason: str) -> None:
    with pytest.raises(PhotoError, match=reason) as found:
        photo_name(data)
    assert "\n" not in str(found.value)


def test_a_photo_with_too_many_pixels_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photos, "MAX_PIXELS", 60 * 40 - 1)
    with pytest.raises(PhotoError, match="60 x 40 pixels"):
        photo_name(picture())


def test_a_full_folder_refuses_further_photos(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store_photo(tmp_path, picture())
    monkeypatch.setattr(photos, "MAX_PHOTOS_BYTES", len(picture()) + 1)
    assert store_photo(tmp_path, picture()) == photo_name(picture())  # it is stored already
    with pytest.raises(PhotoError, match="full"):
        store_photo(tmp_path, picture("PNG"))


@pytest.mark.parametrize("name", ["../journal.jsonl", "journal.jsonl", "", f"{'0' * 64}.jpg\n"])
def test_only_stored_photos_have_a_path(tmp_path: Path, name: str) -> None:
    (tmp_path / "journal.jsonl").write_text("{}")
    store_photo(tmp_path, picture())
    assert photo_path(tmp_path, name) is None
    assert photo_path(tmp_path, photo_name(picture())) is not None


def test_a_note_with_a_photo_is_in_the_log_and_in_the_journal(tmp_path: Path) -> None:
    world = world_in(tmp_path, scenario_of())
    data = picture()

    async def ask(http: httpx.AsyncClient) -> None:
        stored = (await http.post(f"{V1}/photos", content=data)).json()
        note = {"text": "gate", "lat_deg": SQUARE[0][0], "lon_deg": SQUARE[0][1]}
        await posted(http, "/notes", **note, **stored, by="Eve")
        line = (await got(http, "/records"))[-1]
        assert line["photo"] == stored["photo"]
        assert line["text"].endswith(f": gate (photo {stored['photo']})")
        back = await http.get(f"{V1}/photos/{stored['photo']}")
        assert (back.content, back.headers["content-type"]) == (data, "image/jpeg")
        bad = await http.post(f"{V1}/photos", content=b"text")
        assert (bad.status_code, list(bad.json())) == (422, ["error"])
        assert (await http.get(f"{V1}/photos/{'0' * 64}.jpg")).status_code == 404
        wrong = await http.post(f"{V1}/notes", json={**note, "photo": "../../etc/passwd"})
        assert wrong.status_code == 422

    asked(world, ask)
    lines = (tmp_path / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    events = [json.loads(line).get("event", {}) for line in lines]
    assert [each["photo"] for each in events if each.get("type") == "NoteAdded"] == [
        photo_name(data)
    ]
    zero = datetime(2026, 8, 1, 18, tzinfo=UTC)
    first, second = (incident_in(tmp_path / "journal.jsonl", None, 0.0, zero) for _ in range(2))
    (note,) = first.notes
    assert (note.text, note.photo) == ("gate", photo_name(data))
    for name, found in (("a.kmz", first), ("b.kmz", second)):
        write_kmz(tmp_path / name, found, layers_of(found))
    with zipfile.ZipFile(tmp_path / "a.kmz") as archive:
        assert f"photos/{photo_name(data)}" in archive.namelist()
    assert (tmp_path / "a.kmz").read_bytes() == (tmp_path / "b.kmz").read_bytes()
