"""From what a user names to files: folders, patterns, and what is no file at all."""

from __future__ import annotations

import glob
import os
import re
import stat
from pathlib import Path

from mssegment.errors import DataError
from mssegment.imaging import pictures
from mssegment.inputs.files import check_name

_URL = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)
_PRINTF = re.compile(r"%(0?)(\d*)d")
_RAW = frozenset((".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw"))
"""Suffixes of raw files; a decoder of TIFF would find a small preview in some."""
_HEIC = frozenset((".heic", ".heif", ".hif"))
_RESULTS = ("tracks.json", "segmentation.json", "report.json")
"""Files that stand together only in a folder of results."""
_LABELS = re.compile(r"(?:^|[^a-z])(masks?|labels?|annotations?|gt|seg|segmentations?)(?:[^a-z]|$)")
"""Words in the names of pictures that hold labels, not frames."""


def expand(given: str) -> tuple[list[str], tuple[str, ...]]:
    """The files that one argument names, and notes on what was left out.

    Parameters
    ----------
    given : str
        A file, a folder, a glob pattern, or a printf pattern such as ``frame_%03d.png``.

    Returns
    -------
    files : list of str
        Of folders and patterns in natural order (frame-2 before frame-10).
    notes : tuple of str

    Raises
    ------
    DataError
        If nothing matches, or the argument is a URL, a device, a pipe, or a name that is not UTF-8.
    """
    _check(given)
    if os.path.isdir(given):
        return _folder(given)
    if not os.path.exists(given) and _PRINTF.search(given):
        return _named([path for path in _printf(given) if os.path.isfile(path)], given), ()
    if not os.path.exists(given) and glob.has_magic(given):
        found = [path for path in glob.glob(given, recursive=True) if os.path.isfile(path)]
        return _named(found, given), ()
    return [given], ()


def natural_key(path: str) -> list[tuple[int, int, str]]:
    """Sort key that compares numbers inside names by value."""
    parts = re.split(r"(\d+)", path)
    return [(1, int(p), p) if p.isdecimal() else (0, 0, p) for p in parts]


def _check(given: str) -> None:
    """Raises DataError for what is no file."""
    if _URL.match(given):
        raise DataError(
            f"{given}: URLs and streams are not fetched; download the file and name that"
        )
    if given == "-":
        raise DataError(
            "-: pictures and videos are not read from standard input; write them to a file"
        )
    if not os.path.exists(given) and given.isdecimal():
        raise DataError(
            f"{given}: cameras are not opened by their number; record a video and name that"
        )
    check_name(given)
    if Path(given).suffix.lower() in _RAW:
        raise DataError(
            f"{given}: the raw file of a camera, which is not read; develop it to PNG, TIFF or JPEG"
        )
    if os.path.exists(given) and not os.path.isdir(given):
        mode = os.stat(given).st_mode
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
            raise DataError(
                f"{given}: a pipe, which can be read only once, but the stages read a picture "
                "again; write it to a file"
            )
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise DataError(f"{given}: a device; record a video and name that")


def _named(found: list[str], given: str) -> list[str]:
    if not found:
        raise DataError(f"{given}: no file matches this pattern; check it, and quote it in a shell")
    for path in found:
        _check(path)
    return sorted(found, key=natural_key)


def _printf(given: str) -> list[str]:
    """The existing files of a pattern like ``%d`` or ``%03d``, as OpenCV and FFmpeg read it."""
    folder, name = os.path.split(given)
    parts = _PRINTF.split(name)
    pattern = re.escape(parts[0])
    for zero, width, text in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
        digits = int(width or 0)
        pattern += (rf"\d{{{digits},}}" if zero and digits else r"\d+") + re.escape(text)
    inside = os.listdir(folder or ".") if os.path.isdir(folder or ".") else []
    return [os.path.join(folder, own) for own in inside if re.fullmatch(pattern, own)]


def _instead(folder: str) -> str:
    """What else is in a folder without pictures: folders, or files of other kinds."""
    inside = sorted((e for e in Path(folder).iterdir() if e.name[:1] != "."), key=lambda e: e.name)
    folders = [entry.name for entry in inside if entry.is_dir()]
    if folders:
        more = ", ..." if len(folders) > 4 else ""
        return f"name one of its folders ({', '.join(folders[:4])}{more})"
    suffixes = sorted({entry.suffix.lower() for entry in inside if entry.suffix})
    if set(suffixes) & _HEIC:
        return "convert its HEIC pictures to JPEG or PNG"
    return f"found {', '.join(suffixes[:5])} files" if suffixes else "check the path"


def _folder(given: str) -> tuple[list[str], tuple[str, ...]]:
    """The pictures in a folder; those named as labels are left out where there are others.

    Raises DataError where there are none, or they are drawings among the results of a run.
    """
    if all(os.path.isfile(os.path.join(given, name)) for name in _RESULTS):
        raise DataError(
            f"{given}: the results of a run, whose pictures are drawings; name the pictures that "
            f"are meant, or the tracks: {os.path.join(given, 'tracks.json')}"
        )
    names = [
        name
        for name in os.listdir(given)
        if Path(name).suffix.lower() in pictures.PICTURE_SUFFIXES and not name.startswith(".")
    ]
    if not names:
        raise DataError(
            f"{given}: no pictures in this folder, expected PNG, JPEG, TIFF, BMP, ... files; "
            f"{_instead(given)}"
        )
    labels = {name for name in names if _LABELS.search(Path(name).stem.lower())}
    frames = [name for name in names if name not in labels] or names
    notes: tuple[str, ...] = ()
    if len(frames) < len(names):
        first = min(labels, key=natural_key)
        notes = (f"{given}: {len(labels)} pictures named as labels ({first}, ...) are no frames",)
    series = {re.sub(r"\d+", "#", name) for name in frames}
    if len(series) > 1 and len(frames) > 2:
        shown = ", ".join(sorted(series)[:4])
        notes += (f"{given}: pictures of several series ({shown}) are read as one sequence",)
    found = [os.path.join(given, name) for name in frames]
    for path in found:
        _check(path)
    return sorted(found, key=natural_key), notes
