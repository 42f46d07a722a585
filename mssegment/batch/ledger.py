"""The ledger of a batch: one JSON line for each item that was done, failed or was skipped."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from mssegment.errors import DataError, OutputError
from mssegment.records import Record

LEDGER = "ledger.jsonl"


class Entry(Record, frozen=True, omit_defaults=True):
    """What became of an item, in one run of the batch.

    Attributes
    ----------
    time : str
        When, in UTC (ISO 8601).
    name : str
        The item.
    state : str
        ``done``, ``failed``, or ``skipped``: its result is there already, or it failed before.
    fingerprint : str
        Of its files, its settings and the version; empty if a file cannot be read.
    seconds : float
        The time that it took.
    error : str
        Why it failed.
    worker : str
        The process that worked on it: host and number.
    """

    time: str
    name: str
    state: str
    fingerprint: str = ""
    seconds: float = 0.0
    error: str = ""
    worker: str = ""


class Ledger:
    """The ledger in a folder; a line that a kill cut off is removed when it is opened.

    Raises DataError if the file is no ledger, OutputError if it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / LEDGER
        try:
            self._file = self._path.open("ab+", buffering=0)
        except OSError as error:
            raise OutputError.of(str(self._path), error) from None
        self.entries = self._read()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def last(self) -> dict[str, Entry]:
        """For each item the last entry in which it was done or failed."""
        return {entry.name: entry for entry in self.entries if entry.state != "skipped"}

    def add(self, entry: Entry) -> None:
        """Append an entry; it is on the disk when the method returns.

        Raises OutputError if it cannot be written; the ledger is then as before.
        """
        entry = msgspec.structs.replace(entry, time=_now())
        size = os.fstat(self._file.fileno()).st_size
        line = msgspec.json.encode(entry) + b"\n"
        try:
            written = self._file.write(line)
            if written != len(line):  # the disk became full in the middle
                self._file.write(line[written:])
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(size)
            raise OutputError.of(str(self._path), error) from None
        self.entries.append(entry)

    def _read(self) -> list[Entry]:
        self._file.seek(0)
        content = self._file.read()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            self._file.truncate(len(whole))
        entries = []
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                entries.append(msgspec.json.decode(line, type=Entry))
            except msgspec.DecodeError as error:
                raise DataError(
                    f"{self._path}:{number}: not an entry of a ledger ({error}); "
                    "restore the line, or remove it"
                ) from None
        return entries


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
