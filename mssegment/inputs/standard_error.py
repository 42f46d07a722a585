"""What decoders written in C print to file descriptor 2, discarded where the process is ours."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

_lock = threading.RLock()
_is_ours = False


def take() -> None:
    """Let ``quiet`` redirect descriptor 2: the process is a command line, not a user's program."""
    global _is_ours
    _is_ours = True


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Discard what OpenCV, libpng and FFmpeg write to file descriptor 2.

    They write there from C, bypassing ``sys.stderr``. Every failure that they would report is
    raised by the caller as an error that names the file. In a program of someone else nothing is
    redirected: its other threads may be writing there.
    """
    if not _is_ours:
        yield
        return
    with _lock:
        with contextlib.suppress(AttributeError, OSError, ValueError):  # it may be closed
            sys.stderr.flush()
        try:
            kept = os.dup(2)
        except OSError:  # the process has no stderr: nothing to discard
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)
