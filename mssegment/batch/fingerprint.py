"""What the result of an item depends on: its files, its settings, and the version."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from mssegment.configuration import Configuration
from mssegment.errors import DataError
from mssegment.imaging.sources import expand
from mssegment.inputs.files import check_kind
from mssegment.records import Record
from mssegment.version import __version__


class Fingerprint(Record, frozen=True):
    """The digest of an item, and the SHA-256 of each of its files."""

    digest: str
    files: dict[str, str]


def fingerprint(configuration: Configuration) -> Fingerprint:
    """Hash the files and the settings of an item.

    Raises DataError if a file does not exist or cannot be read.
    """
    files = {path: _sha256(path) for path in input_files(configuration)}
    content = [__version__, msgspec.to_builtins(configuration), files]
    encoded = msgspec.json.encode(content, order="sorted")
    return Fingerprint(hashlib.sha256(encoded).hexdigest(), files)


def input_files(configuration: Configuration) -> list[str]:
    """The files that a configuration names: pictures, videos, tracks, camera and labels.

    Raises DataError if a pattern matches nothing.
    """
    read = configuration.input
    found = [path for given in read.images for path in expand(given)[0]]
    found += [_file_of(name) for name in (read.tracks, configuration.camera.file) if name]
    found += [path for given in configuration.report.labels for path in _all_below(given)]
    return list(dict.fromkeys(found))


def _file_of(name: str) -> str:
    """The file of ``FILE#PART``."""
    return name if os.path.exists(name) or "#" not in name else name.rpartition("#")[0]


def _all_below(given: str) -> Iterator[str]:
    """The files that one value of ``report.labels`` names."""
    if os.path.isdir(given):
        for parent, folders, names in os.walk(given):
            folders.sort()
            yield from (os.path.join(parent, name) for name in sorted(names))
    elif not os.path.exists(given) and glob.has_magic(given):
        yield from sorted(glob.glob(given, recursive=True))
    else:
        yield given


def _sha256(path: str) -> str:
    check_kind(path)
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
