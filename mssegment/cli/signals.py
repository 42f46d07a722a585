"""Ctrl-C, SIGTERM and SIGHUP: each ends a command in the same way, cleaning up on the way out."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType
from typing import Any

AGAIN = 0.01
"""Seconds after which a signal comes again whose exception was lost."""


class Stopped(KeyboardInterrupt):
    """A signal that asks the program to end; code that handles Ctrl-C handles it too."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number

    @property
    def word(self) -> str:
        """What has happened, in one word."""
        return "interrupted" if self.number == signal.SIGINT else "terminated"

    @property
    def status(self) -> int:
        """The exit status, as a shell gives it for the signal: 128 and its number."""
        return 128 + self.number


class Signals:
    """Turns signals that ask the program to end into ``Stopped``, while a command runs.

    A signal that is ignored, as under ``nohup`` or in the background of a shell, stays ignored.
    """

    NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")

    def __init__(self) -> None:
        self.stopped: Stopped | None = None
        """The first signal that came: some libraries turn the exception into another one."""

    def install(self) -> None:
        """From now on, raise Stopped."""
        for number in self._numbers():
            signal.signal(number, self._raise)
        sys.unraisablehook = self._again

    def remove(self) -> None:
        """From now on, a signal ends the process at once: nothing is left to be cleaned up."""
        for number in self._numbers():
            signal.signal(number, signal.SIG_DFL)

    def _numbers(self) -> list[int]:
        known = [getattr(signal, name) for name in self.NAMES if hasattr(signal, name)]
        return [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]

    def _raise(self, number: int, frame: FrameType | None) -> None:
        self.stopped = self.stopped or Stopped(number)
        raise Stopped(number)

    def _again(self, unraisable: Any) -> None:
        """An exception that was lost, as in the removal of an object: the signal comes again."""
        stopped = unraisable.exc_value
        if isinstance(stopped, Stopped):
            # later, from another thread: raised in here, it would be lost again
            again = threading.Timer(AGAIN, os.kill, (os.getpid(), stopped.number))
            again.daemon = True
            again.start()
        else:
            sys.__unraisablehook__(unraisable)
