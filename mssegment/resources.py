"""Time and memory: how much a stage takes, and how freed memory is kept for the next arrays."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np

from mssegment.records import State


class Timings(State):
    """Seconds of every stage, in the order they ran, and peak memory in bytes after each."""

    seconds: dict[str, float] = msgspec.field(default_factory=dict)
    peak_bytes: dict[str, int] = msgspec.field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measures the block as stage ``name``."""
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
        self.peak_bytes[name] = _peak_bytes()


def keep_freed_memory() -> None:
    """Makes glibc keep the memory of freed arrays for the next ones, in large pages.

    It hands a large block back to the system, and fetching the same pages again and again takes a
    tenth of a run. It stops doing so for blocks up to the largest, of at most 32 MB, that it has
    seen freed. The second block therefore lies where later arrays will, and there NumPy asks the
    system for large pages, which takes another 3 %. Neither is touched, so they cost nothing;
    with another C library, or where there are no large pages, nothing changes.
    """
    for _ in range(2):
        np.empty(31 * 2**20, dtype=np.uint8)


def _peak_bytes() -> int:
    try:
        import resource
    except ImportError:  # Windows has no such counter
        return 0
    import sys

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)
