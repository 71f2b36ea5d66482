"""Compare the states of two services object by object and find the first difference."""

from collections import deque
from collections.abc import Iterator, Mapping, Set
from typing import Any

import msgspec
import numpy as np
from shapely.geometry.base import BaseGeometry

from firemodel.assimilation.learned_inputs import LearnedInputs
from firemodel.spread import devs8_kernels
from firemodel.spread.anyangle import AnyAngleFire
from mission_service.guidance.formation.shared_map import SharedMap
from mission_service.guidance.front.front_estimate import FrontEstimate
from mission_service.guidance.team.lookahead import Moves
from mission_service.runtime.track import Track

HEAPS = (devs8_kernels.EventHeap,)
SIMPLE = (str, bytes, int, float, complex, type(None), type)


def difference(
    a: Any, b: Any, path: str = "", seen: dict[tuple[int, int], Any] | None = None
) -> str:
    """Return the path and a description of the first difference; empty if the objects are equal.

    Object identity is ignored, NaN equals NaN, and the order of a dictionary is compared.
    """
    seen = {} if seen is None else seen
    if a is b or (id(a), id(b)) in seen:
        return ""
    if type(a) is not type(b):
        return f"{path}: {type(a).__name__} {_cut(a)} is not {type(b).__name__} {_cut(b)}"
    if isinstance(a, SIMPLE):
        return "" if a == b or (a != a and b != b) else f"{path}: {_cut(a)} is not {_cut(b)}"
    seen[id(a), id(b)] = (a, b)  # these references prevent that ids are used again
    if isinstance(a, np.ndarray):
        if a.dtype.hasobject:
            return difference(a.tolist(), b.tolist(), path, seen)
        same = a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        return "" if same else f"{path}: arrays differ"
    if isinstance(a, np.generic | np.random.Generator):
        same = repr(a) == repr(b) if isinstance(a, np.generic) else _state(a) == _state(b)
        return "" if same else f"{path}: {_cut(a)} is not {_cut(b)}"
    if isinstance(a, BaseGeometry):
        return "" if a.equals_exact(b, 0.0) else f"{path}: geometries differ"
    if isinstance(a, HEAPS):  # the rest of the arrays is unused
        a, b = ([part[: each.size] for part in each[:-1]] for each in (a, b))
        return difference(a, b, path, seen)
    if isinstance(a, Moves):  # the other fields are work arrays
        return difference(list(a[:2]), list(b[:2]), path, seen)
    if isinstance(a, Track):
        return difference(list(a), list(b), path, seen)
    ours, theirs = list(_parts(a)), list(_parts(b))
    if [name for name, _ in ours] != [name for name, _ in theirs]:
        names = {name for name, _ in ours} ^ {name for name, _ in theirs}
        return f"{path}: other parts: {sorted(names)[:5] or 'in another order'}"
    for (name, one), (_, other) in zip(ours, theirs, strict=True):
        found = difference(one, other, f"{path}{name}", seen)
        if found:
            return found
    return ""


def _state(generator: np.random.Generator) -> str:
    return repr(generator.bit_generator.state)


def _parts(thing: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(thing, Mapping):
        yield from ((f"[{key!r}]", value) for key, value in thing.items())
    elif isinstance(thing, Set):
        yield from ((f"{{{key}}}", None) for key in sorted(map(repr, thing)))
    elif isinstance(thing, list | tuple | deque):
        yield from ((f"[{number}]", value) for number, value in enumerate(thing))
    if isinstance(thing, msgspec.Struct):
        yield from ((f".{name}", getattr(thing, name)) for name in thing.__struct_fields__)
        return
    names = [name for kind in type(thing).__mro__ for name in _slots(kind)]
    if hasattr(thing, "__dict__"):
        names += sorted(vars(thing))
    if isinstance(thing, SharedMap):
        names = [name for name in names if name not in ("_found", "_shares", "_theirs")]
    if isinstance(thing, LearnedInputs | FrontEstimate):
        names.remove("_rates")  # computed again when needed
    if isinstance(thing, AnyAngleFire):
        names = [name for name in names if name not in ("_points", "_queue", "_labels")]
        yield "._labels", thing._labels[:2]  # the rest depends on the time of the last copy
        yield "._points", [each[: thing._used] for each in thing._points]
        times, keys, waiting = thing._queue
        yield "._queue", [times[: thing._size], keys[: thing._size], waiting[: thing._waits]]
    for name in names:
        if hasattr(thing, name):
            yield f".{name}", getattr(thing, name)
    if callable(thing) and hasattr(thing, "__self__"):
        yield ".__self__", thing.__self__


def _slots(kind: type) -> tuple[str, ...]:
    found = vars(kind).get("__slots__", ())
    names = (found,) if isinstance(found, str) else tuple(found)
    return tuple(name for name in names if name not in ("__dict__", "__weakref__"))


def _cut(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 100 else text[:99] + "…"
