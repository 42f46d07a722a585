"""One thread of BLAS where the last bits of a result decide.

OpenBLAS splits a product among its threads, and the sums of the parts round differently from the
sum of the whole. A choice that hangs on the last bits, such as which of two equal subsets comes
first, would then depend on the number of threads. The matrices here are small: more threads are
slower too.
"""

from __future__ import annotations

import ctypes
import functools
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""What a library reads that is loaded for the first time, such as SciPy's."""
_PREFIXES = ("scipy_openblas", "openblas")
_SUFFIXES = ("64_", "")


class _Library:
    """An OpenBLAS that this process has loaded: functions that get and set its threads."""

    def __init__(self, handle: ctypes.CDLL) -> None:
        self.get: Any = _function(handle, "get_num_threads")
        self.set: Any = _function(handle, "set_num_threads")


def _function(handle: ctypes.CDLL, name: str) -> Any:
    for prefix in _PREFIXES:
        for suffix in _SUFFIXES:
            found = getattr(handle, f"{prefix}_{name}{suffix}", None)
            if found is not None:
                return found
    raise OSError(f"no {name}")


@functools.cache
def _paths() -> tuple[str, ...]:
    """The OpenBLAS libraries in the wheels of NumPy and SciPy, loaded or not."""
    site = Path(np.__file__).parents[1]
    folders = ("numpy.libs", "scipy.libs", "numpy/.dylibs", "scipy/.dylibs")
    return tuple(
        str(path) for folder in folders for path in sorted((site / folder).glob("*openblas*"))
    )


def _loaded() -> dict[str, _Library]:
    """Those of ``_paths`` that are loaded by now."""
    found: dict[str, _Library] = {}
    for path in _paths():
        try:
            handle = ctypes.CDLL(path, mode=getattr(os, "RTLD_NOLOAD", 0))
            found[path] = _Library(handle)
        except OSError:  # not loaded, or another library
            continue
    return found


class _OneThread:
    """Counts who needs one thread: the first sets it, the last restores what was before."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._undo: Callable[[], None] = lambda: None

    def enter(self) -> None:
        with self._lock:
            self._users += 1
            if self._users == 1:
                self._undo = _limit()

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._undo()


def _limit() -> Callable[[], None]:
    """Give every BLAS one thread; returns what undoes it."""
    before = {path: (library, int(library.get())) for path, library in _loaded().items()}
    for library, count in before.values():
        if count != 1:
            library.set(1)
    environment = {name: os.environ.get(name) for name in _VARIABLES}
    others = _limit_others() if not before else None
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))

    def undo() -> None:
        for name, value in environment.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        usual = max((count for _, count in before.values()), default=1)
        for path, library in _loaded().items():
            count = before[path][1] if path in before else usual
            if int(library.get()) != count:
                library.set(count)
        if others is not None:
            others.restore_original_limits()

    return undo


def _limit_others() -> Any:
    """A BLAS that is not in a wheel, such as MKL: by threadpoolctl, where it is installed."""
    try:
        import threadpoolctl
    except ImportError:
        return None
    return threadpoolctl.threadpool_limits(1, user_api="blas")


_one = _OneThread()


@contextmanager
def one_thread() -> Iterator[None]:
    """A block in which BLAS has one thread, in the whole process; may be nested and concurrent.

    Examples
    --------
    >>> with one_thread():
    ...     product = np.eye(3) @ np.eye(3)
    """
    _one.enter()
    try:
        yield
    finally:
        _one.leave()


def with_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """A decorator: the function runs with one thread of BLAS."""

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_thread():
            return function(*args, **kwargs)

    return wrapper
