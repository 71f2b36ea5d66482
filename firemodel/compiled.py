"""Compile inner loops with Numba, with a cache on disk that depends on all sources used.

Numba's own cache checks only the file of the compiled function. The cache ignores changes to
functions in other files that this function calls. The name of this module's cache folder is a hash
of all files of this package, of the files in the function's folder, and of all modules of its
package that compile functions.
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
PACKAGE = Path(__file__).parent


@cache
def cache_folder(home: Path) -> Path:
    """Return the cache folder for the functions in the folder ``home``.

    The folder is in Numba's configured folder, else in this package or, if the package is
    read-only, in the user's cache.
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

    A kernel may call kernels of other folders.
    """
    found = (path for path in package.rglob("*.py") if b"firemodel.compiled" in path.read_bytes())
    return tuple(found)


def _cached(function: Callable[..., Any], **options: Any) -> Any:
    given = NUMBA.CACHE_DIR
    NUMBA.CACHE_DIR = str(cache_folder(Path(function.__code__.co_filename).parent))
    try:
        # The GIL is released, because a forecast runs in its own thread and shares no array that
        # it writes.
        return njit(cache=True, error_model="numpy", nogil=True, **options)(function)
    finally:
        NUMBA.CACHE_DIR = given


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function that may allocate arrays."""
    return _cached(function)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function without reference counts, so that inner loops take half of the time.

    The function must not allocate arrays; callers pass its work arrays.
    """
    return _cached(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a ``kernel`` whose code becomes part of each kernel that calls it.

    A call passes each field of each array, which takes as long as a short function.
    """
    return _cached(function, _nrt=False, forceinline=True)
