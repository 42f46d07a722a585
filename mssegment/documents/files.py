"""Files that are written whole or not at all, and standard input and output by the name ``-``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mssegment.errors import DataError, UsageError

STANDARD = "-"


def read_bytes(path: str) -> bytes:
    """The bytes of the file, or of standard input for ``-``.

    Raises DataError where the file is missing, a folder, empty, or cannot be read.
    """
    if path == STANDARD:
        content, name = sys.stdin.buffer.read(), "standard input"
    else:
        name = path
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            raise DataError(f"{path}: no such file; check the name") from None
        except IsADirectoryError:
            raise DataError(f"{path}: this is a folder, a file was expected") from None
        except OSError as error:
            raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    if not content.strip():
        hint = "; did the stage before it fail?" if path == STANDARD else ""
        raise DataError(f"{name}: empty, a document was expected{hint}")
    return content


def write_bytes(path: str, content: bytes) -> None:
    """Writes the file whole or not at all: a temporary file beside it, fsync, rename.

    ``-`` is standard output. A link is followed, and what is no plain file (a device, a named
    pipe) is written into, never replaced. Raises UsageError where it cannot be written.
    """
    if path == STANDARD:
        _write_standard(content)
        return
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise UsageError(f"{path}: this is a folder, a file was expected; name a file in it")
    if target.exists() and not target.is_file():
        _write_into(path, content)
        return
    temporary = target.with_name(f".{target.name}.{os.urandom(6).hex()}")
    try:
        file = temporary.open("xb")
    except OSError as error:
        raise _cannot_write(path, error) from None
    try:
        with file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise _cannot_write(path, error) from None
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _write_standard(content: bytes) -> None:
    try:
        sys.stdout.buffer.write(content)
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        # what is still in the buffer would fail once more when the interpreter ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise _cannot_write("standard output", error) from None


def _write_into(path: str, content: bytes) -> None:
    try:
        with Path(path).open("wb") as file:
            file.write(content)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _cannot_write(path, error) from None


def _cannot_write(path: str, error: OSError) -> UsageError:
    return UsageError(f"{path}: cannot be written ({error.strerror}); choose another place")
