"""Putting a complete new folder in the place of an earlier one, with a journal.

Before anything is changed, the journal says what is going to happen. Whoever finds a journal later,
after a kill, can tell from it how far that has come, and completes it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

import msgspec

from mssegment.errors import UsageError
from mssegment.records import Record

JOURNAL = "journal"
OLD = "old"


class Journal(Record, frozen=True):
    """What is going to happen.

    Attributes
    ----------
    new : int or None
        The number (inode) of the new folder, which tells whether it has its place yet. None: its
        files are moved into the earlier folder one by one.
    stale : tuple of str
        Files of the earlier folder that are not kept.
    """

    new: int | None
    stale: tuple[str, ...] = ()


class Replacing:
    """Puts the folder ``new`` in the place of ``target``; the journal lies beside ``new``."""

    def __init__(self, target: Path, new: Path) -> None:
        self._target, self._new = target, new
        self._old, self._journal = new.with_name(OLD), new.with_name(JOURNAL)

    def replace(self, stale: Collection[str]) -> None:
        """Put the complete new folder in the place of the target.

        Parameters
        ----------
        stale : collection of str
            Files of the target that are not kept, by their path below it.

        Raises
        ------
        OSError
            If that fails; the target is then unchanged, or ``settle`` completes it.
        """
        _synchronise(self._new)
        gone = tuple(n for n in map(os.path.normpath, stale) if not _is_there(self._new / n))
        if not self._target.exists():
            os.rename(self._new, self._target)
        elif self._can_be_renamed() and self._take_over(gone):
            _copy_permissions(self._target, self._new)
            self._write(Journal(self._new.stat().st_ino, gone))
            self._exchange()
        else:
            self._check_places()
            self._write(Journal(None, gone))
        self.settle()
        _synchronise(self._target.parent)

    def settle(self) -> None:
        """Complete what the journal says, if there is one; what has not begun does not happen."""
        try:
            journal = msgspec.json.decode(self._journal.read_bytes(), type=Journal)
        except FileNotFoundError:
            return
        if journal.new is None:
            self._move_files(journal.stale)
        else:
            if not self._target.exists():  # between the two renames
                os.rename(self._new, self._target)
            if self._target.stat().st_ino == journal.new:
                for earlier in (self._new, self._old):
                    if earlier.exists():
                        self._rescue(earlier, journal.stale)
                        shutil.rmtree(earlier)
        self._journal.unlink()

    def _exchange(self) -> None:
        from mssegment.folders.exchange import exchange  # loads ctypes

        if not exchange(self._new, self._target):
            os.rename(self._target, self._old)
            os.rename(self._new, self._target)

    def _can_be_renamed(self) -> bool:
        """Whether the target is no mount point, and this process does not work in it."""
        here = Path(os.path.realpath(os.curdir))
        beside = self._target not in self._new.parents
        return beside and self._target != here and self._target not in here.parents

    def _take_over(self, stale: Collection[str]) -> bool:
        """Link the files that are kept into the new folder; False where that is not possible.

        With links, a file of the user has a name in a proper place at every moment.
        """
        try:
            for name in self._missing(self._target, self._new, stale):
                place = self._new / name
                place.parent.mkdir(parents=True, exist_ok=True)
                os.link(self._target / name, place, follow_symlinks=False)
            for name in _empty_folders(self._target):
                (self._new / name).mkdir(parents=True, exist_ok=True)
        except (OSError, NotImplementedError):  # another file system below, or one without links
            return False
        return True

    def _rescue(self, earlier: Path, stale: Collection[str]) -> None:
        """Move what came into the earlier folder after its files were linked to the target."""
        for name in self._missing(earlier, self._target, stale):
            place = self._target / name
            place.parent.mkdir(parents=True, exist_ok=True)
            os.rename(earlier / name, place)

    def _missing(self, earlier: Path, later: Path, stale: Collection[str]) -> list[str]:
        """The files of one folder that the other one should have too, and has not."""
        return [n for n in _files_below(earlier) if n not in stale and not _is_there(later / n)]

    def _check_places(self) -> None:
        """Raises UsageError for a file that would have to replace a folder, or the reverse."""
        for name in _files_below(self._new):
            place = self._target / name
            over = [p for p in place.parents if p.exists() and not p.is_dir()]
            if over or (place.is_dir() and not place.is_symlink()):
                raise UsageError(
                    f"{over[0] if over else place}: found a {'file' if over else 'folder'} where "
                    f"a {'folder' if over else 'file'} is to be written; move it away"
                )

    def _move_files(self, stale: Collection[str]) -> None:
        """Move each file of the new folder to its place in the target."""
        for name in _files_below(self._new) if self._new.exists() else ():
            place = self._target / name
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(self._new / name, place)
        for name in stale:
            with suppress(FileNotFoundError, NotADirectoryError, IsADirectoryError):
                (self._target / name).unlink()

    def _write(self, journal: Journal) -> None:
        temporary = self._journal.with_name(f"{JOURNAL}~")
        with temporary.open("wb") as file:
            file.write(msgspec.json.encode(journal))
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, self._journal)


def _files_below(folder: Path) -> list[str]:
    """The files and links below a folder, by their path below it."""
    found = []
    for parent, folders, names in os.walk(folder):
        links = [name for name in folders if os.path.islink(os.path.join(parent, name))]
        found += [os.path.relpath(os.path.join(parent, n), folder) for n in (*names, *links)]
    return found


def _empty_folders(folder: Path) -> list[str]:
    return [
        os.path.relpath(parent, folder)
        for parent, folders, names in os.walk(folder)
        if not folders and not names and parent != str(folder)
    ]


def _is_there(path: Path) -> bool:
    return os.path.lexists(path)


def _copy_permissions(earlier: Path, later: Path) -> None:
    """Give a folder the mode and, where that is allowed, the owner of another one."""
    status = earlier.stat()
    if hasattr(os, "chown"):
        with suppress(PermissionError):
            os.chown(later, status.st_uid, status.st_gid)
    later.chmod(status.st_mode & 0o7777)


def _synchronise(folder: Path) -> None:
    """Make the names in a folder permanent, where the operating system can."""
    with suppress(OSError):
        file = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)
