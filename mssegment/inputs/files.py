"""Reading a whole file: plain files and pipes, up to a limit, with one line for what is wrong."""

from __future__ import annotations

import os
import stat
import sys
import time

from mssegment.errors import DataError, MssegmentError
from mssegment.inputs import limits
from mssegment.inputs.text import printable

_PIECE = 1 << 20
_PATIENCE = 2.0
"""Seconds that a named pipe may wait for a program that writes into it."""


def is_pipe(path: str) -> bool:
    """Whether a path names a pipe, such as ``<(...)`` of a shell."""
    try:
        return stat.S_ISFIFO(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def check_name(path: str, error: type[MssegmentError] = DataError) -> None:
    """Raises ``error`` for a name that a document cannot hold: not UTF-8, or with a zero byte."""
    if "\0" in path:
        raise error(f"{printable(path)}: not a possible name of a file; check it")
    try:
        path.encode("utf-8")
    except UnicodeEncodeError:
        raise error(
            f"{printable(path)}: the name is not UTF-8, and documents cannot hold it; rename the "
            "file"
        ) from None


def read_file(
    path: str,
    *,
    error: type[MssegmentError] = DataError,
    expected: str = "a file",
    missing: str = "no such file; check the name",
    may_be_pipe: bool = True,
) -> bytes:
    """Read the bytes of a file.

    Parameters
    ----------
    path : str
        The file.
    error : type
        The error to raise.
    expected : str
        What the file should be, for messages.
    missing : str
        What to say if there is no such file.
    may_be_pipe : bool
        Whether a pipe is read too, once and to its end, as ``<(...)`` in a shell gives it.

    Returns
    -------
    bytes

    Raises
    ------
    MssegmentError
        ``error``, if there is no such file, it is a folder or a device, it cannot be read, or it
        is larger than ``limits.file_bytes``.
    """
    check_kind(path, error=error, expected=expected, missing=missing, may_be_pipe=may_be_pipe)
    try:
        # without O_NONBLOCK, opening a pipe that no program writes into waits for ever
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0) | _nonblock())
        try:
            return _all_of(handle, path, error)
        finally:
            os.close(handle)
    except OSError as failure:
        raise error(f"{path}: cannot be read ({failure.strerror}); check the file") from None


def read_standard(error: type[MssegmentError] = DataError) -> bytes:
    """Read standard input to its end; raises ``error`` if it is closed or above the limit."""
    try:
        content = sys.stdin.buffer.read(limits.limit("file_bytes") + 1)
    except (AttributeError, OSError, ValueError):
        raise error("standard input: cannot be read; name a file, or pipe one in") from None
    if len(content) > limits.limit("file_bytes"):
        raise error(limits.exceeded("file_bytes", None, "standard input"))
    return content


def check_kind(
    path: str,
    *,
    error: type[MssegmentError] = DataError,
    expected: str = "a file",
    missing: str = "no such file; check the name",
    may_be_pipe: bool = False,
) -> None:
    """Raises ``error`` for what is no plain file, nor a pipe where it may be one."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        raise error(f"{path}: {missing}") from None
    except OSError as failure:
        raise error(f"{path}: cannot be read ({failure.strerror}); check the path") from None
    except ValueError:
        raise error(f"{path}: not a possible name of a file; check it") from None
    if stat.S_ISREG(mode) or (may_be_pipe and stat.S_ISFIFO(mode)):
        return
    if stat.S_ISDIR(mode):
        raise error(f"{path}: this is a folder; expected {expected}")
    if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
        raise error(
            f"{path}: a pipe or socket, which can be read only once; expected {expected}: write "
            "it to a file first"
        )
    raise error(f"{path}: a device; expected {expected}")


def _nonblock() -> int:
    return getattr(os, "O_NONBLOCK", 0)


def _all_of(handle: int, path: str, error: type[MssegmentError]) -> bytes:
    status = os.fstat(handle)
    limits.check("file_bytes", status.st_size, path, error)
    pieces = [_first_of_pipe(handle, path, error)] if stat.S_ISFIFO(status.st_mode) else []
    size, largest = sum(map(len, pieces)), limits.limit("file_bytes")
    while piece := os.read(handle, _PIECE):
        pieces.append(piece)
        size += len(piece)
        if size > largest:
            raise error(limits.exceeded("file_bytes", None, path))
    return b"".join(pieces)


def _first_of_pipe(handle: int, path: str, error: type[MssegmentError]) -> bytes:
    """Wait for a program that writes into a pipe; from then on reading waits for its output."""
    give_up = time.monotonic() + _PATIENCE
    first = b""
    while not first:
        try:
            first = os.read(handle, _PIECE)
        except BlockingIOError:
            break  # a program has it open, and is silent so far
        if not first and time.monotonic() > give_up:
            raise error(f"{path}: no program writes into this pipe; start it first")
        time.sleep(0 if first else 0.02)
    os.set_blocking(handle, True)
    return first
