"""Stores the state of a service in a file, so that a restart need not replay the whole journal.

The first line is JSON (``Header``), with the state's position in the journal. The rest is one
compressed pickle of all objects, which preserves references between the objects. Objects that are
created from the scenario in a restart (landscape, scenario) are stored by name only. A state is
read only by the code that wrote it, with the same library versions; otherwise a restart replays the
journal, which takes longer. Because unpickling executes code, a file that other users could have
written is refused.
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
from firemodel.physics.wind_field import WindGrids
from mission_service.config.rule_lookup import versions_of_others
from mission_service.config.scenario import Scenario
from mission_service.errors import StateError
from mission_service.fire.scenario_fire import weather_of
from mission_service.journal.journal_file import Rest
from mission_service.journal.private_files import opened, sync, writable_by_others

FORMAT = 1
OURS = ("mission_service", "firemodel", "autopilot_bridge")
COMPUTES_WITH = ("msgspec", "numba", "numpy", "pydantic", "pymavlink", "pyproj", "scipy", "shapely")


class Header(msgspec.Struct, frozen=True):
    """A state's header; ``parts`` are the lengths of the pickle and of each buffer."""

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
        """The position in the journal at which the state was taken."""
        return Rest(self.at_byte, self.crc, self.segment)


class Known:
    """The objects that a state stores by name only, because the scenario determines them."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        names = [field.name for field in fields(landscape)]
        arrays = {name: getattr(landscape, name) for name in names}
        self.by_name: dict[str, Any] = {
            "landscape": landscape,
            **{f"landscape.{k}": v for k, v in arrays.items() if isinstance(v, np.ndarray)},
            **dict(_parts("scenario", scenario)),
        }
        self._wind = _wind_grids(scenario)
        if self._wind is not None:
            self.by_name |= {"wind": self._wind, "wind.toward": self._wind.toward}
        self.name_of = {id(value): name for name, value in self.by_name.items()}
        self._of = (scenario, landscape)

    @cached_property
    def scenario(self) -> str:
        """The digest of the scenario, and of its wind grids if there are any."""
        found = digest_of(self._of[0])
        return found if self._wind is None else f"{found} {self._wind.digest()}"

    @cached_property
    def landscape(self) -> str:
        """The digest of the landscape."""
        return self._of[1].digest()


def _wind_grids(scenario: Scenario) -> WindGrids | None:
    """Return the wind grids that all entries of a scenario with grids or terrain wind share."""
    if scenario.wind_grids is None and scenario.terrain_wind is None:
        return None
    fields = (entry.wind_field for entry in weather_of(scenario).entries)
    return next((field.grids for field in fields if field is not None), None)


def _parts(name: str, section: object) -> Iterator[tuple[str, object]]:
    """Yield the sections of a scenario with their names."""
    if isinstance(section, BaseModel):
        yield name, section
        for key, value in vars(section).items():
            yield from _parts(f"{name}.{key}", value)
    elif isinstance(section, tuple):
        for number, value in enumerate(section):
            yield from _parts(f"{name}.{number}", value)


def digest_of(scenario: Scenario) -> str:
    """Return the digest of a whole scenario."""
    return hashlib.sha256(scenario.model_dump_json().encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return the digest of the packages' source and of the interpreter and library versions."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for package in OURS:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(f"{path.relative_to(root)}\0".encode())
            digest.update(path.read_bytes())
    versions = {name: version(name) for name in COMPUTES_WITH} | versions_of_others()
    digest.update(repr((versions, platform.python_version(), platform.machine())).encode())
    return digest.hexdigest()


# Objects to bytes ---------------------------------------------------------------------------------


class Frozen:
    """Pickled objects, which do not change when the original objects change."""

    def __init__(self, objects: dict[str, Any], shared: Known) -> None:
        """Pickle the objects in about the time a copy takes; ``write`` may then run in a thread."""
        pickled, buffers = _pickled(objects, shared)
        self.parts = [pickled, *(bytes(each.raw()) for each in buffers)]
        self.shared = shared


def _pickled(objects: dict[str, Any], shared: Known) -> tuple[bytes, list[pickle.PickleBuffer]]:
    file, buffers = io.BytesIO(), list[pickle.PickleBuffer]()
    _Pickler(file, shared, buffers).dump(objects)
    return file.getvalue(), buffers


def _unpickled(
    pickled: bytes | bytearray, buffers: list[bytearray], shared: Known
) -> dict[str, Any]:
    objects: dict[str, Any] = _Unpickler(io.BytesIO(pickled), shared, buffers).load()
    return objects


class _Pickler(pickle.Pickler):
    """A pickler that stores ``Known`` objects by name, and arrays with shared memory as views."""

    def __init__(self, file: io.BytesIO, shared: Known, buffers: list[pickle.PickleBuffer]) -> None:
        super().__init__(file, 5, buffer_callback=buffers.append)
        self._name_of = shared.name_of

    def reducer_override(self, value: Any) -> Any:
        name = self._name_of.get(id(value))
        if name is not None:
            return _reference, (name,)
        if type(value) is np.ndarray and isinstance(value.base, np.ndarray):
            return _as_view(value)
        return NotImplemented


def _reference(name: str) -> Any:
    raise AssertionError(f"{name}: only ``_Unpickler`` can resolve this reference")


class _Unpickler(pickle.Unpickler):
    """An unpickler that replaces names by the ``Known`` objects."""

    def __init__(self, file: io.BytesIO, shared: Known, buffers: list[bytearray]) -> None:
        super().__init__(file, buffers=buffers)
        self._by_name = shared.by_name

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == (__name__, _reference.__name__):
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
    """Write the state at a position in the journal; only a complete file replaces the old file.

    Raises OSError; the old file is then unchanged.
    """
    packing = zlib.compressobj(level=1)
    packed = b"".join([*(packing.compress(part) for part in frozen.parts), packing.flush()])
    header = Header(
        FORMAT,
        code_digest(),
        frozen.shared.scenario,
        frozen.shared.landscape,
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
        sync(path.parent)
    except OSError:
        half.unlink(missing_ok=True)
        raise


def header_of(path: Path, shared: Known) -> Header:
    """Return the header of a state. Raises StateError if this run cannot use the state."""
    try:
        with os.fdopen(opened(path, os.O_RDONLY), "rb") as file:
            found = os.fstat(file.fileno())
            if found.st_uid not in (os.getuid(), 0) or writable_by_others(found):
                raise StateError(f"{path}: other users could have written it, so it is not read")
            header = msgspec.json.decode(file.readline(), type=Header)
    except OSError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise StateError(f"{path}: is corrupt: {error}") from None
    required = {
        "format": FORMAT,
        "code": code_digest(),
        "scenario": shared.scenario,
        "landscape": shared.landscape,
    }
    for name, value in required.items():
        if getattr(header, name) != value:
            raise StateError(f"{path}: was written with another {name}")
    return header


def read(path: Path, shared: Known) -> dict[str, Any]:
    """Return a state's objects. Raises StateError for a damaged state or another run's state."""
    header = header_of(path, shared)
    with path.open("rb") as file:
        file.readline()
        packed = file.read()
    if hashlib.sha256(packed).hexdigest() != header.sha256:
        raise StateError(f"{path}: is corrupt: its sha256 does not match")
    memory = memoryview(zlib.decompress(packed))
    parts, at = [], 0
    for length in header.parts:
        parts.append(bytearray(memory[at : at + length]))
        at += length
    return _unpickled(parts[0], parts[1:], shared)


def copied(objects: dict[str, Any], shared: Known) -> dict[str, Any]:
    """Return deep copies of objects, which refer to each other and to the ``shared`` objects."""
    pickled, buffers = _pickled(objects, shared)
    return _unpickled(pickled, [bytearray(each.raw()) for each in buffers], shared)


def restore(frozen: Frozen) -> dict[str, Any]:
    """Return the objects of a ``Frozen``, equal to those that ``read`` returns after ``write``."""
    pickled, *buffers = frozen.parts
    return _unpickled(pickled, [bytearray(each) for each in buffers], frozen.shared)
