"""Reading files and writing them atomically; ``-`` is standard input or standard output."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mssegment.errors import DataError, OutputError, UsageError
from mssegment.inputs.files import read_file, read_standard
from mssegment.inputs.text import printable_lines

STANDARD = "-"


def read_bytes(path: str) -> bytes:
    """Read the bytes of a file, or of standard input if ``path`` is ``-``.

    Raises DataError if the file does not exist, is a folder or a device, is empty, is larger than
    ``limits.file_bytes``, or cannot be read.
    """
    name = "standard input" if path == STANDARD else path
    content = read_standard() if path == STANDARD else read_file(path)
    if not content.strip():
        hint = "; did the previous stage fail?" if path == STANDARD else ""
        raise DataError(f"{name}: empty; expected a document{hint}")
    return content


def write_bytes(path: str, content: bytes) -> None:
    """Write a file atomically: into a temporary file beside it, then fsync and rename.

    Parameters
    ----------
    path : str
        The file; ``-`` is standard output. A symbolic link is followed. A device or named pipe
        is written to, never replaced.
    content : bytes
        What to write.

    Raises
    ------
    UsageError
        If the path is a folder or cannot be written; an existing file is then unchanged.
    """
    if path == STANDARD:
        _write_standard(content)
        return
    target = Path(os.path.realpath(path))
    if os.path.isdir(target):
        raise UsageError(f"{path}: this is a folder; expected a file, such as one inside it")
    if os.path.exists(target) and not os.path.isfile(target):
        _write_into(path, content)
        return
    temporary = target.with_name(f".{target.name}.{os.urandom(6).hex()}")
    try:
        file = temporary.open("xb")
    except OSError as error:
        raise OutputError.of(path, error) from None
    try:
        with file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise OutputError.of(path, error) from None
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _write_standard(content: bytes) -> None:
    try:
        if sys.stdout.isatty():  # what a terminal obeys, such as ESC, must not come from a document
            content = printable_lines(content.decode("utf-8", "backslashreplace")).encode()
        sys.stdout.buffer.write(content)
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        # flushing the rest of the buffer would fail again when the interpreter exits
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise OutputError.of("standard output", error) from None


def _write_into(path: str, content: bytes) -> None:
    try:
        with Path(path).open("wb") as file:
            file.write(content)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError.of(path, error) from None
