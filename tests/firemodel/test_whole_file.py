"""A file is written completely or not at all, and only a file is replaced."""

import os
from pathlib import Path

import pytest

from firemodel.errors import FireModelError
from firemodel.outputs.whole_file import write_whole


def test_a_file_is_replaced_and_no_part_remains(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("before", encoding="utf-8")
    write_whole(path, "after")
    assert path.read_text(encoding="utf-8") == "after"
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]


def test_what_is_not_a_file_is_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, text in (
        (pipe, "it is a device, a pipe or a socket"),
        (tmp_path, "Is a directory"),
        (tmp_path / "missing" / "a.txt", "No such file or directory"),
        (Path(), "Is a directory"),
    ):
        with pytest.raises(FireModelError, match=text):
            write_whole(path, "text")
    assert pipe.is_fifo()
    assert [each.name for each in tmp_path.iterdir()] == ["pipe"]
