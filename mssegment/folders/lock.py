"""A lock that names the process which holds a folder, and that dies with it."""

from __future__ import annotations

import errno
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import msgspec

from mssegment.errors import UsageError
from mssegment.records import Record

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

LOCK = "lock"
_FAR = 1 << 30
"""The byte that is locked on Windows, where a locked byte cannot be read: behind the text."""
_BUSY = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
_NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK)
"""File systems without locks (some of clusters): there, a folder is not guarded."""
_LONGEST_COMMAND = 80
_POLL = 0.05
"""Seconds between two attempts to get a lock that another process holds."""


class Holder(Record, frozen=True):
    """The process that holds a folder."""

    pid: int
    host: str
    command: str

    def __str__(self) -> str:
        """Such as ``process 4711 (mssegment run a.mp4)``; with the host if it is another one."""
        where = "" if self.host == _host() else f" on {self.host}"
        return f"process {self.pid} ({self.command}){where}"


class FolderLock:
    """The lock file in the folder ``work``, which is created for it.

    It is a lock of the operating system on an open file: the end of the process, of whatever kind,
    releases it. Processes that share the folder over a network exclude each other too, if the file
    system supports locks.

    Parameters
    ----------
    work : Path
        The folder of the lock file; created, not with its parents.
    name : str
        What the lock guards, for the message.
    wait : float
        Seconds to wait for another process.

    Raises
    ------
    UsageError
        If another process holds the lock; it is named.
    OSError
        If the folder or the file cannot be written.
    """

    def __init__(self, work: Path, name: str, wait: float = 0.0) -> None:
        self._work, self._path = work, work / LOCK
        until = time.monotonic() + wait
        while (file := self._attempt(name, until)) is None:
            pass
        self._file = file

    def _attempt(self, name: str, until: float) -> int | None:
        """Open and lock the file; None if it has to be tried again."""
        file = self._open()
        if file is None:
            return None  # its last holder has just removed the folder
        try:
            if _try_lock(file):
                if _is_current(file, self._path):
                    os.ftruncate(file, 0)
                    os.lseek(file, 0, os.SEEK_SET)
                    with suppress(OSError):  # on a full disk, the lock holds without a name
                        os.write(file, msgspec.json.encode(_this_process()))
                    kept, file = file, -1
                    return kept
            elif time.monotonic() >= until:
                raise UsageError(
                    f"{name}: {_holder_of(file)} is writing into it; wait until it ends, or name "
                    "another folder"
                )
            else:
                time.sleep(_POLL)
        finally:
            if file >= 0:
                os.close(file)
        return None

    def release(self) -> None:
        """Remove the lock file, and the folder if nothing else is in it."""
        self._path.unlink(missing_ok=True)
        try:
            self._work.rmdir()
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
                raise
        finally:
            os.close(self._file)

    def _open(self) -> int | None:
        self._work.mkdir(exist_ok=True)
        if self._work.is_symlink():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(self._work))
        try:
            return os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:
            return None


def remove_if_free(work: Path) -> None:
    """Remove the folder of a lock that no process holds, if nothing else is in it."""
    with suppress(OSError):
        if (work / LOCK).exists():
            file = os.open(work / LOCK, os.O_RDWR)
            try:
                if _try_lock(file) and _is_current(file, work / LOCK):
                    (work / LOCK).unlink()
            finally:
                os.close(file)
        work.rmdir()


def _is_current(file: int, path: Path) -> bool:
    """Whether the locked file is the one that others find: its holder may have removed it."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _try_lock(file: int) -> bool:
    try:
        if sys.platform == "win32":
            os.lseek(file, _FAR, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _BUSY:
            return False
        if error.errno not in _NO_LOCKS:
            raise
    return True


def _host() -> str:
    return os.uname().nodename if hasattr(os, "uname") else os.environ.get("COMPUTERNAME", "")


def _this_process() -> Holder:
    words = [os.path.basename(sys.argv[0] or "python"), *sys.argv[1:]]
    text = "".join(c if c.isprintable() else "?" for c in " ".join(words))
    if len(text) > _LONGEST_COMMAND:
        text = text[: _LONGEST_COMMAND - 3] + "..."
    return Holder(os.getpid(), _host(), text)


def _holder_of(file: int) -> str:
    """Who holds the locked file, as far as it says so: its holder may not have written it yet."""
    try:
        os.lseek(file, 0, os.SEEK_SET)
        return str(msgspec.json.decode(os.read(file, 4096), type=Holder))
    except msgspec.DecodeError:
        return "another process"
