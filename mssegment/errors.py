"""What can go wrong for a reason that the user can mend, and the exit status of each kind."""

from __future__ import annotations

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


class MssegmentError(Exception):
    """An error for people: one line that says what was found, what was expected, what to do."""

    status = ExitStatus.UNFORESEEN


class UsageError(MssegmentError):
    """The command was called in a way that cannot work (also: the output folder exists)."""

    status = ExitStatus.USAGE


class ConfigurationError(MssegmentError):
    """A configuration is missing, misspelt, or holds a value that cannot work."""

    status = ExitStatus.CONFIGURATION


class DataError(MssegmentError):
    """An input is missing, broken, or does not hold enough to work with."""

    status = ExitStatus.DATA
