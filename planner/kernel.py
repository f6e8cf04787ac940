"""Compiles kernels by numba and caches them on disk.

Numba does not notice when a function that a cached kernel calls changes in another file. So the cache folder
is named after the content of all kernels and numba's version. If the folder is unusable, numba would fall
back to `__pycache__`, whose name does not change; kernels are then compiled anew in every process instead.
"""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from runtime.shell.command import tell

F = TypeVar("F", bound=Callable[..., Any])

CACHE_VARIABLE = "SQUEEZETREE_CACHE_DIR"


def cache_folder() -> Path:
    """The user's cache folder of this project; the variable `SQUEEZETREE_CACHE_DIR` overrides it."""
    stated = os.environ.get(CACHE_VARIABLE)
    if stated:
        return Path(stated)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "squeezetree"


def _fingerprint() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        text = source.read_bytes()
        if b"planner.kernel import" in text:
            digest.update(text)
    return digest.hexdigest()[:16]


numba_config: Any = numba.config
numba_config.CACHE_DIR = str(cache_folder() / f"kernels-{_fingerprint()}")


def kernel(function: F) -> F:
    """Compiles a function of arrays and numbers, without Python objects, GIL and exceptions; caches it."""
    return _compiled(function)


def inner_kernel(function: F) -> F:
    """Same as `kernel`, for functions that allocate nothing: without reference counts.

    Counting references would take 40 % of the time of a squeeze.
    """
    return _compiled(function, _nrt=False)


def inlined_kernel(function: F) -> F:
    """Same as `inner_kernel`, but inlined: for short, frequent functions, whose calls would cost most."""
    return _compiled(function, _nrt=False, forceinline=True)


def merged_kernel(function: F) -> F:
    """Same as `inner_kernel`, for a function that only one kernel calls: compiled only in its caller."""
    return _compiled(function, _nrt=False, inline="always")


def _compiled(function: F, **flags: Any) -> F:
    options: Any = {"nogil": True, "error_model": "numpy", **flags}
    try:
        compiled = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba has no cache folder at all
        compiled = None
    if compiled is None or not _is_ours(compiled.stats.cache_path):
        _warn_once()
        compiled = numba.njit(**options)(function)
    return cast(F, compiled)


def _is_ours(place: str | None) -> bool:
    """Whether a kernel's cache `place` lies in the folder named after the content of the kernels."""
    return place is not None and Path(place).is_relative_to(numba_config.CACHE_DIR)


@cache
def _warn_once() -> None:
    tell(
        "squeezetree",
        f"{numba_config.CACHE_DIR} cannot be written, so kernels are compiled anew each time, half a minute; "
        f"name another folder in {CACHE_VARIABLE}",
    )
