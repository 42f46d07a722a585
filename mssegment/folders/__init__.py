"""Folders of results: whole or not there, and written by one process at a time.

The files of a folder ``out`` are written into a hidden folder beside it, ``.out.mssegment/new``,
which gets the name ``out`` when it is complete. Beside it in ``.out.mssegment`` lies a lock that
names the process, and during the exchange with an earlier folder a journal. A process may be killed
at any moment: ``out`` is then the earlier folder or the new one, and the next process that opens it
removes what is left, or completes an exchange that had begun.

Where ``out`` cannot be renamed, because it is a mount point, the working directory, or lies in a
folder that cannot be written, the files of the complete new folder are moved into it one by one;
after a kill the next process moves the rest.
"""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mssegment.errors import OutputError, UsageError
from mssegment.folders.lock import LOCK, FolderLock, remove_if_free
from mssegment.folders.replacing import Replacing
from mssegment.records import State, field

__all__ = ["ResultFolder", "folder_lock", "result_folder", "sweep"]

HIDDEN = ".mssegment"
"""Ending of the hidden folder beside the results, or its name where it lies among them."""
NEW = "new"
_KEY = "key"


class ResultFolder(State):
    """A folder that is being written.

    Attributes
    ----------
    path : Path
        Where to write the files.
    resumed : bool
        Whether ``path`` holds files of an interrupted process with the same key.
    stale : list of str
        Files of the earlier folder that the new one replaces, by their path below it. All other
        files of the earlier folder are kept, unless a new one has the same path.
    """

    path: Path
    resumed: bool = False
    stale: list[str] = field(default_factory=list)


@contextmanager
def result_folder(
    out: str, *, replace: bool = False, key: str | None = None, wait: float = 0.0
) -> Iterator[ResultFolder]:
    """Write the folder ``out``: at the end of the block it is there, whole.

    If the block raises an exception, ``out`` is as it was before, and what was written is removed.

    Parameters
    ----------
    out : str
        The folder; its parents are created.
    replace : bool
        Whether ``out`` may hold files. They are kept, except those that have the path of a new one
        or are named in ``stale``.
    key : str, optional
        With a key, what was written is kept after an interrupt or a kill, or if the disk is full;
        the next call with the same key goes on with it. It should depend on everything that the
        files depend on.
    wait : float
        Seconds to wait for another process that writes the same folder.

    Yields
    ------
    ResultFolder

    Raises
    ------
    UsageError
        If ``out`` is a file, is not empty and ``replace`` is not set, or is being written by
        another process.
    OutputError
        If it cannot be written.
    """
    target, work = _places(out)
    created = _create_parents(work.parent, out)
    try:
        with _locked(work, out, wait), _errors_name(out, work / NEW):
            yield from _write(target, work, out, replace, key)
    finally:
        for parent in created:  # a folder with something in it stays
            with suppress(OSError):
                parent.rmdir()


@contextmanager
def folder_lock(out: str) -> Iterator[None]:
    """Hold the folder ``out``, which need not exist yet, against other processes.

    Raises UsageError if another process holds it, OutputError if its parent cannot be written.
    """
    target, work = _places(out)
    created = _create_parents(work.parent, out)
    try:
        with _locked(work, out, 0.0):
            Replacing(target, work / NEW).settle()
            _clear(work)
            yield
    finally:
        for parent in created:
            with suppress(OSError):
                parent.rmdir()


def sweep(out: str, wait: float = 0.0, *, keep: bool = False) -> None:
    """Remove what a killed process left beside ``out``, or complete its exchange.

    With ``keep``, what a process with the same key would go on with stays.

    Raises UsageError if another process is still writing the folder after ``wait`` seconds.
    """
    target, work = _places(out)
    if work.exists():
        with _locked(work, out, wait), _errors_name(out, work / NEW):
            Replacing(target, work / NEW).settle()
            if not keep or not (work / _KEY).exists():
                _clear(work)


def _write(
    target: Path, work: Path, out: str, replace: bool, key: str | None
) -> Iterator[ResultFolder]:
    """The block of ``result_folder``, under the lock."""
    replacing = Replacing(target, work / NEW)
    replacing.settle()
    if not replace and target.exists() and set(os.listdir(target)) - {HIDDEN}:
        if not (work / _KEY).exists():
            _clear(work)
        raise UsageError(
            f"{out}: this folder is not empty; use --force to write into it, or --out to name "
            "another"
        )
    kept = False
    try:
        folder = ResultFolder(work / NEW, resumed=_resumes(work, key))
        kept = key is not None
        yield folder
        replacing.replace(folder.stale)
        kept = False
    except Exception as error:  # it would come again, except where there is no room
        kept = kept and isinstance(error, OutputError | OSError)
        raise
    finally:
        replacing.settle()
        if not kept or not any((work / NEW).iterdir()):
            _clear(work)


def _resumes(work: Path, key: str | None) -> bool:
    """Make the folder that is written; whether it is one of the same key."""
    try:
        if key is not None and (work / _KEY).read_text() == key and (work / NEW).is_dir():
            _remove_temporary(work / NEW)
            return True
    except (FileNotFoundError, UnicodeDecodeError):
        pass
    _clear(work)
    (work / NEW).mkdir()
    if key is not None:
        (work / _KEY).write_text(key)
    return False


def _remove_temporary(folder: Path) -> None:
    """Remove unfinished files of ``documents.write_bytes``: ``.NAME.`` and 12 digits."""
    for path in folder.rglob(".*.????????????"):
        if path.is_file():
            path.unlink()


def _places(out: str) -> tuple[Path, Path]:
    """The folder without links, and its hidden folder: beside it, or inside where it must be.

    Raises UsageError if there is a file.
    """
    target = Path(os.path.realpath(out))
    try:
        status = target.stat()
    except FileNotFoundError:
        is_folder = False
    except OSError as error:
        raise OutputError.of(out, error) from None
    else:
        is_folder = stat.S_ISDIR(status.st_mode)
        if not is_folder:
            raise UsageError(f"{out}: this is a file; expected a folder for --out")
    if is_folder and (os.path.ismount(target) or not os.access(target.parent, os.W_OK | os.X_OK)):
        return target, target / HIDDEN
    return target, target.parent / f".{target.name}{HIDDEN}"


def _create_parents(folder: Path, out: str) -> list[Path]:
    """Create a folder with its parents; those that are new, the innermost first."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError.of(out, error) from None
    return new


@contextmanager
def _locked(work: Path, out: str, wait: float) -> Iterator[None]:
    lock = None
    try:
        try:
            lock = FolderLock(work, out, wait)
        except OSError as error:
            raise OutputError.of(out, error) from None
        yield
    finally:
        if lock is None:  # also after a signal in the middle
            remove_if_free(work)
        else:
            lock.release()


@contextmanager
def _errors_name(out: str, new: Path) -> Iterator[None]:
    """Errors name the files where they will be, and not where they are written."""
    try:
        yield
    except UsageError as error:
        if str(new) not in str(error):
            raise
        raise type(error)(str(error).replace(str(new), out)) from None
    except OSError as error:
        if not str(error.filename).startswith(str(new.parent)):
            raise
        raise OutputError.of(out, error) from None


def _clear(work: Path) -> None:
    """Remove everything but the lock."""
    for entry in os.scandir(work):
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path)
        elif entry.name != LOCK:
            os.unlink(entry.path)
