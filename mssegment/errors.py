"""The errors that a user can correct, and the exit status of each kind."""

from __future__ import annotations

import errno
from enum import IntEnum


class ExitStatus(IntEnum):
    """The exit statuses of the command line."""

    DONE = 0
    UNFORESEEN = 1
    USAGE = 2
    CONFIGURATION = 3
    DATA = 4
    INTERRUPTED = 130
    CLOSED_PIPE = 141
    TERMINATED = 143


class MssegmentError(Exception):
    """Base class of all errors meant for the user.

    The message is one line that says what was found, what was expected, and what to do.
    """

    status = ExitStatus.UNFORESEEN


class UsageError(MssegmentError):
    """A command or function was called with invalid arguments, or its output cannot be written."""

    status = ExitStatus.USAGE


class OutputError(UsageError):
    """A file or folder cannot be written."""

    @classmethod
    def of(cls, path: str, error: OSError) -> OutputError:
        """The error for a path, with advice; the message is the same wherever it is raised."""
        is_full = error.errno in (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
        advice = "make room, or choose another path" if is_full else "choose another path"
        return cls(f"{path}: cannot be written ({error.strerror}); {advice}")


class ConfigurationError(MssegmentError):
    """A configuration is missing, has an unknown key, or has an invalid value."""

    status = ExitStatus.CONFIGURATION


class DataError(MssegmentError):
    """An input file is missing or damaged, or the data are not sufficient."""

    status = ExitStatus.DATA
