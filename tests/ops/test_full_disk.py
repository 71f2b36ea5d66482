"""The journal on a full disk."""

import errno
import os
from pathlib import Path

import pytest

from mission_service.journal.journal_file import _write


def test_what_could_not_be_written_can_be_thrown_away() -> None:
    data = bytearray(b"line\n")
    full = os.open("/dev/full", os.O_WRONLY)
    with pytest.raises(OSError, match="No space left") as error:
        _write(full, data)
    os.close(full)
    data.clear()  # an error's frames could keep a memory view open, which would prevent this
    assert error.value.errno == errno.ENOSPC


def test_all_is_written_however_little_is_taken_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, write = tmp_path / "file", os.write
    monkeypatch.setattr(os, "write", lambda file, data: write(file, bytes(data[:3])))
    file = os.open(path, os.O_WRONLY | os.O_CREAT)
    _write(file, b"0123456789")
    os.close(file)
    assert path.read_bytes() == b"0123456789"
