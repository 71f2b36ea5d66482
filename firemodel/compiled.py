"""Compile inner loops with Numba, and cache them on disk under a hash of all sources used.

Numba's own cache checks only the file of the compiled function. A change in another file that
contains a function called by the compiled function is not detected. Therefore the name of the cache
folder contains a hash of all files of this package, of the files in the compiled function's folder,
and of all modules of that function's package that compile functions.
"""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import config

NUMBA: Any = config
_FUNCTIONS: list[Any] = []  # all functions of imported modules that Numba compiles
PACKAGE = Path(__file__).parent


@cache
def cache_folder(home: Path) -> Path:
    """Return the cache folder for the functions in the folder ``home``.

    The cache folder is in the folder configured for Numba if there is one, else in this package or,
    if this package is read-only, in the user's cache.
    """
    sha = hashlib.sha256()
    for source in sorted({*PACKAGE.rglob("*.py"), *home.glob("*.py"), *_with_kernels(_top(home))}):
        sha.update(source.read_bytes())
    if NUMBA.CACHE_DIR:
        base = Path(NUMBA.CACHE_DIR)
    elif os.access(PACKAGE, os.W_OK):
        base = PACKAGE / "__pycache__"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "firemodel"
    return base / f"kernels-{sha.hexdigest()[:16]}"


def _top(home: Path) -> Path:
    """Return the top-level package that holds a folder."""
    while (home.parent / "__init__.py").exists():
        home = home.parent
    return home


@cache
def _with_kernels(package: Path) -> tuple[Path, ...]:
    """Return the modules of a package that compile functions.

    The cache depends on these modules, because a kernel may call kernels of other folders.
    """
    found = (path for path in package.rglob("*.py") if b"firemodel.compiled" in path.read_bytes())
    return tuple(found)


def _cached(function: Callable[..., Any], **options: Any) -> Any:
    given = NUMBA.CACHE_DIR
    NUMBA.CACHE_DIR = str(cache_folder(Path(function.__code__.co_filename).parent))
    try:
        # The GIL is released, so that forecasts run in parallel threads. A forecast does not write
        # to arrays that other threads use.
        made = njit(cache=True, error_model="numpy", nogil=True, **options)(function)
    finally:
        NUMBA.CACHE_DIR = given
    _FUNCTIONS.append(made)
    return made


def compiled_counts() -> tuple[int, int]:
    """Return the number of functions compiled or loaded so far, and of all imported functions.

    The first number may stay below the second, because a run does not call every function.
    """
    functions = tuple(_FUNCTIONS)
    return sum(bool(each.overloads) for each in functions), len(functions)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function that may allocate arrays."""
    return _cached(function)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function without reference counts, so that inner loops take half the time.

    The function must not allocate arrays; work arrays are passed as arguments.
    """
    return _cached(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a ``kernel`` that is inlined into each kernel that calls it.

    An ordinary call passes every field of every array, which takes as long as the work of a short
    function.
    """
    return _cached(function, _nrt=False, forceinline=True)
