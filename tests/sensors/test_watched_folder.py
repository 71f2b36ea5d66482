"""Files of a watched folder are used once, when whole; a backlog does not delay new ones."""

import os
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from mission_service.sensors import watched_folder
from mission_service.sensors.watched_folder import WatchedFolder
from tests.patience import PATIENCE_S

NOW = datetime(2026, 7, 4, tzinfo=UTC)


class Texts(WatchedFolder):
    """Uses text files, and keeps their contents."""

    def __init__(self, folder: Path) -> None:
        super().__init__("a.folder", str(folder), (".txt",), "a text")
        self.found: list[str] = []

    def process_file(self, path: Path, now: datetime) -> None:
        self.found.append(path.read_text(encoding="utf-8"))


def test_a_file_is_used_once_when_it_no_longer_grows(tmp_path: Path) -> None:
    texts, path = Texts(tmp_path), tmp_path / "a.txt"
    (tmp_path / "a.dat").write_text("another suffix")
    for part in ("one", " two"):
        with path.open("a", encoding="utf-8") as file:
            file.write(part)
        texts.scan(NOW)
        assert texts.found == []
    for _ in range(3):
        texts.scan(NOW)
    assert texts.found == ["one two"]
    path.write_text("replaced", encoding="utf-8")
    for _ in range(3):
        texts.scan(NOW)
    assert texts.found == ["one two", "replaced"]


def test_of_a_backlog_only_the_newest_files_are_read(tmp_path: Path) -> None:
    texts = Texts(tmp_path)
    count = watched_folder.MAX_AT_ONCE + 400
    for number in range(count):
        path = tmp_path / f"{number:04d}.txt"
        path.write_text(str(number), encoding="utf-8")
        os.utime(path, (number, number))
    for _ in range(2):
        texts.scan(NOW)
    assert texts.found == [str(number) for number in range(400, count)]
    assert "0399.txt: 100 or more newer files arrived with it (and 399 others)" in texts.problem
    (tmp_path / "new.txt").write_text("new", encoding="utf-8")
    for _ in range(2):
        texts.scan(NOW)
    assert texts.found[-1] == "new"
    for path in tmp_path.iterdir():
        path.unlink()
    texts.scan(NOW)
    assert texts.problem == ""


def test_listing_a_large_folder_takes_a_small_share_of_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []

    texts = Texts(tmp_path)

    def close(wait_s: float) -> None:
        waits.append(wait_s)
        texts.close()

    clock = iter([0.0, 0.5])
    slow = SimpleNamespace(monotonic=lambda: next(clock))
    monkeypatch.setattr(watched_folder, "time", slow)
    monkeypatch.setattr(texts._closed, "wait", close)
    texts._run()
    assert waits == [10.0]


def test_an_error_of_the_thread_is_raised_by_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(now: datetime) -> None:
        raise InterruptedError

    texts = Texts(tmp_path)
    monkeypatch.setattr(texts, "scan", fail)
    texts._run()
    with pytest.raises(InterruptedError):
        texts.start()


def test_closing_ends_the_thread(tmp_path: Path) -> None:
    texts = Texts(tmp_path)
    texts.start()
    thread = texts._thread
    assert thread is not None
    assert thread.is_alive()
    texts.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
