"""The state of a service in a file: a restart begins there, not at the start of the journal.

First line: JSON (``Header``), with the position in the journal that the state belongs to. The rest
is one compressed pickle of all objects, so that references between them are kept. Objects rebuilt
from the scenario (landscape, scenario) are stored by name only. A state is read only by the same
code that wrote it, with the same versions of its libraries; otherwise a restart replays the
journal, which takes longer. Unpickling executes code: a file that other users could have written is
refused.
"""

import hashlib
import io
import os
import pickle
import platform
import zlib
from collections.abc import Iterator
from dataclasses import fields
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from firemodel.landscape.landscape import Landscape
from mission_service.config.rule_lookup import versions_of_others
from mission_service.config.scenario import Scenario
from mission_service.errors import StateError
from mission_service.journal.journal_file import Rest
from mission_service.journal.private_files import opened

FORMAT = 1
OURS = ("mission_service", "firemodel", "autopilot_bridge")
COMPUTES_WITH = ("msgspec", "numba", "numpy", "pydantic", "pymavlink", "pyproj", "scipy", "shapely")


class Header(msgspec.Struct, frozen=True):
    """The header of a state; ``parts`` are the lengths of the pickle and its buffers."""

    format: int
    code: str
    scenario: str
    landscape: str
    segment: int
    at_byte: int
    crc: int
    parts: tuple[int, ...]
    sha256: str

    @property
    def rest(self) -> Rest:
        """The position in the journal at which it was taken."""
        return Rest(self.at_byte, self.crc, self.segment)


class Known:
    """The objects that a state stores by name only, because they follow from the scenario."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        names = [field.name for field in fields(landscape)]
        arrays = {name: getattr(landscape, name) for name in names}
        self.by_name: dict[str, Any] = {
            "landscape": landscape,
            **{f"landscape.{k}": v for k, v in arrays.items() if isinstance(v, np.ndarray)},
            **dict(_parts("scenario", scenario)),
        }
        self.name_of = {id(thing): name for name, thing in self.by_name.items()}
        self._of = (scenario, landscape)

    @cached_property
    def scenario(self) -> str:
        """The digest of the scenario."""
        return digest_of(self._of[0])

    @cached_property
    def landscape(self) -> str:
        """The digest of the landscape."""
        return self._of[1].digest()


def _parts(name: str, thing: object) -> Iterator[tuple[str, object]]:
    """The sections of a scenario, by name."""
    if isinstance(thing, BaseModel):
        yield name, thing
        for key, value in vars(thing).items():
            yield from _parts(f"{name}.{key}", value)
    elif isinstance(thing, tuple):
        for number, value in enumerate(thing):
            yield from _parts(f"{name}.{number}", value)


def digest_of(scenario: Scenario) -> str:
    """The digest of a whole scenario."""
    return hashlib.sha256(scenario.model_dump_json().encode()).hexdigest()


@cache
def code_digest() -> str:
    """The digest of the packages' source, the interpreter and the numerical libraries."""
    digest = hashlib.sha256()
    fix = Path(__file__).parents[2]
    for package in OURS:
        for path in sorted((fix / package).rglob("*.py")):
            digest.update(f"{path.relative_to(fix)}\0".encode())
            digest.update(path.read_bytes())
    versions = {name: version(name) for name in COMPUTES_WITH} | versions_of_others()
    digest.update(repr((versions, platform.python_version(), platform.machine())).encode())
    return digest.hexdigest()


# Objects to bytes ---------------------------------------------------------------------------------


class Frozen:
    """Objects as bytes: later changes of the objects do not affect them."""

    def __init__(self, objects: dict[str, Any], known: Known) -> None:
        """Pickle the objects, in about the time of a copy; the rest can be done in a thread."""
        pickled, buffers = io.BytesIO(), list[pickle.PickleBuffer]()
        _Pickler(pickled, known, buffers).dump(objects)
        self.parts = [pickled.getvalue(), *(bytes(each.raw()) for each in buffers)]
        self.known = known


class _Pickler(pickle.Pickler):
    """Pickles the ``Known`` objects by name, and keeps arrays that share memory sharing it."""

    def __init__(self, file: io.BytesIO, known: Known, buffers: list[pickle.PickleBuffer]) -> None:
        super().__init__(file, 5, buffer_callback=buffers.append)
        self._name_of = known.name_of

    def reducer_override(self, thing: Any) -> Any:
        name = self._name_of.get(id(thing))
        if name is not None:
            return _known, (name,)
        if type(thing) is np.ndarray and isinstance(thing.base, np.ndarray):
            return _as_view(thing)
        return NotImplemented


def _known(name: str) -> Any:
    raise AssertionError(f"{name}: only the reader of a state can replace it")


class _Unpickler(pickle.Unpickler):
    """Replaces names by the ``Known`` objects."""

    def __init__(self, file: io.BytesIO, known: Known, buffers: list[bytearray]) -> None:
        super().__init__(file, buffers=buffers)
        self._by_name = known.by_name

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == (__name__, _known.__name__):
            return self._by_name.__getitem__
        return super().find_class(module, name)


def _as_view(view: NDArray[Any]) -> Any:
    base = view
    while isinstance(base.base, np.ndarray):
        base = base.base
    if base.dtype.hasobject:
        return NotImplemented
    offset = view.__array_interface__["data"][0] - base.__array_interface__["data"][0]
    return _view, (base, offset, view.shape, view.strides, view.dtype, view.flags.writeable)


def _view(
    base: NDArray[Any],
    offset: int,
    shape: tuple[int, ...],
    strides: tuple[int, ...],
    dtype: np.dtype[Any],
    writeable: bool,
) -> NDArray[Any]:
    memory = base.ravel(order="K").view(np.uint8)
    view: NDArray[Any] = np.ndarray(shape, dtype, memory, offset, strides)
    view.flags.writeable = writeable
    return view


# Bytes to files -----------------------------------------------------------------------------------


def write(path: Path, frozen: Frozen, rest: Rest) -> None:
    """Write a state that belongs to a position in the journal, completely or not at all.

    Raises OSError, and leaves the previous file unchanged.
    """
    packing = zlib.compressobj(level=1)
    packed = b"".join([*(packing.compress(part) for part in frozen.parts), packing.flush()])
    header = Header(
        FORMAT,
        code_digest(),
        frozen.known.scenario,
        frozen.known.landscape,
        rest.segment,
        rest.at_byte,
        rest.crc,
        tuple(len(part) for part in frozen.parts),
        hashlib.sha256(packed).hexdigest(),
    )
    half = path.with_name(f"{path.name}.half")
    try:
        with os.fdopen(opened(half, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb") as file:
            file.write(msgspec.json.encode(header) + b"\n")
            file.write(packed)
            file.flush()
            os.fsync(file.fileno())
        half.replace(path)
        _sync_folder(path.parent)
    except OSError:
        half.unlink(missing_ok=True)
        raise


def _sync_folder(folder: Path) -> None:
    place = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(place)
    finally:
        os.close(place)


def header_of(path: Path, known: Known) -> Header:
    """The header of a state. Raises StateError if the state cannot be used here."""
    try:
        with os.fdopen(opened(path, os.O_RDONLY), "rb") as file:
            _refuse_others(path, os.fstat(file.fileno()))
            header = msgspec.json.decode(file.readline(), type=Header)
    except OSError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise StateError(f"{path}: is damaged: {error}") from None
    told = (header.format, header.code, header.scenario, header.landscape)
    due = (FORMAT, code_digest(), known.scenario, known.landscape)
    for what, ours, theirs in zip(
        ("format", "code", "scenario", "landscape"), due, told, strict=True
    ):
        if ours != theirs:
            raise StateError(f"{path}: is of another {what}")
    return header


def _refuse_others(path: Path, found: os.stat_result) -> None:
    if found.st_uid not in (os.getuid(), 0) or found.st_mode & 0o022:
        raise StateError(f"{path}: other users could have written it; it is not read")


def read(path: Path, known: Known) -> dict[str, Any]:
    """The objects of a state. Raises StateError if it cannot be used here, or is damaged."""
    header = header_of(path, known)
    with path.open("rb") as file:
        file.readline()
        packed = file.read()
    if hashlib.sha256(packed).hexdigest() != header.sha256:
        raise StateError(f"{path}: is damaged: its sha256 does not match")
    memory = memoryview(zlib.decompress(packed))
    parts, at = [], 0
    for length in header.parts:
        parts.append(bytearray(memory[at : at + length]))
        at += length
    objects: dict[str, Any] = _Unpickler(io.BytesIO(parts[0]), known, parts[1:]).load()
    return objects


def copied(objects: dict[str, Any], known: Known) -> dict[str, Any]:
    """Deep copies that share the ``known`` objects; references between them are kept."""
    pickled, buffers = io.BytesIO(), list[pickle.PickleBuffer]()
    _Pickler(pickled, known, buffers).dump(objects)
    pickled.seek(0)
    copies = [bytearray(each.raw()) for each in buffers]
    again: dict[str, Any] = _Unpickler(pickled, known, copies).load()
    return again


def thawed(frozen: Frozen) -> dict[str, Any]:
    """The objects restored, as from a file."""
    pickled, *buffers = (bytearray(part) for part in frozen.parts)
    objects: dict[str, Any] = _Unpickler(io.BytesIO(pickled), frozen.known, buffers).load()
    return objects
