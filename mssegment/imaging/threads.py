"""The number of threads that OpenCV uses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2


@contextmanager
def threads_for(frames: int) -> Iterator[None]:
    """Within the context OpenCV uses one thread for two views, its own number for a sequence.

    Two views are matched in thousands of small steps, between which idle threads keep spinning:
    more threads took a third more CPU time and saved no wall-clock time.
    """
    usual = cv2.getNumThreads()
    cv2.setNumThreads(1 if frames == 2 else usual)
    try:
        yield
    finally:
        cv2.setNumThreads(usual)


@contextmanager
def threads_beside(busy: int) -> Iterator[None]:
    """Within the context OpenCV leaves a core to each of so many other threads that are ``busy``.

    Where all cores are busy, its threads only wait for each other, spinning.
    """
    usual = cv2.getNumThreads()
    cv2.setNumThreads(max(1, usual - busy))
    try:
        yield
    finally:
        cv2.setNumThreads(usual)
