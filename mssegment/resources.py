"""Time and memory: measuring the stages, and keeping freed memory for the next arrays."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np

from mssegment.records import State


class Timings(State):
    """Wall-clock seconds of each stage, in order, and the peak memory in bytes after each."""

    seconds: dict[str, float] = msgspec.field(default_factory=dict)
    peak_bytes: dict[str, int] = msgspec.field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block as stage ``name``."""
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
        self.peak_bytes[name] = peak_bytes()


def keep_freed_memory() -> None:
    """Make glibc keep the memory of freed arrays for later ones, in huge pages.

    Notes
    -----
    By default glibc returns large freed blocks to the system, and mapping the same pages again and
    again takes a tenth of a run. It raises its threshold to the size of the largest block that it
    has seen freed, up to 32 MB, so freeing one large array is enough. A second array then lies in
    the retained memory, for which NumPy requests huge pages; this saves another 3 % of a run.
    Neither array is touched, so they cost nothing. With another C library, or without huge pages,
    the call has no effect.
    """
    for _ in range(2):
        np.empty(31 * 2**20, dtype=np.uint8)


def peak_bytes() -> int:
    """The peak memory of this process so far; 0 where the system does not count it."""
    try:
        import resource
    except ImportError:  # Windows has no such counter
        return 0
    import sys

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def processors() -> int:
    """The number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
