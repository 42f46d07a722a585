"""How many threads OpenCV works on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2


@contextmanager
def threads_for(frames: int) -> Iterator[None]:
    """One thread for two views, OpenCV's own number for a sequence.

    Two views are matched in thousands of small steps. Between them the other threads wait
    actively: that took a third more of the processors' time and saved none on the clock.
    """
    usual = cv2.getNumThreads()
    cv2.setNumThreads(1 if frames == 2 else usual)
    try:
        yield
    finally:
        cv2.setNumThreads(usual)
