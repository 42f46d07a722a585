"""The kinds of files that hold tracks: which one a file is, and its content by name."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from mssegment.datasets.layouts import HEAD, is_binary_model, layout_of
from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.inputs.files import check_name, read_file

Variables = Mapping[str, Any]
"""The content of a file by name: variables, arrays, columns or tables."""


_PICKLE = "a Python pickle (which may run any code)"
_REFUSED = {
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"GIF8": "a picture",
    b"PAR1": "a Parquet file",
    b"ARROW1": "a Feather file",
    b"\xd0\xcf\x11\xe0": "an Excel workbook",
    b"\x80\x02": _PICKLE,
    b"\x80\x03": _PICKLE,
    b"\x80\x04": _PICKLE,
    b"\x80\x05": _PICKLE,
    b"(dp0": _PICKLE,
    b"(lp0": _PICKLE,
    b"\x1f\x8b": "a file compressed by gzip",
    b"BZh": "a file compressed by bzip2",
    b"\xfd7zXZ": "a file compressed by xz",
    b"\x28\xb5\x2f\xfd": "a file compressed by zstd",
    b"7z\xbc\xaf": "a 7-Zip archive",
    b"#ROSBAG": "a ROS bag",
    b"\x89MCAP": "a ROS bag (MCAP)",
    b"RDX": "a file of R",
    b"X\n\0\0": "a file of R",
    b"PF\n": "a PFM image",
    b"%PDF": "a PDF",
    b"version https://git-lfs": "a pointer of Git LFS (`git lfs pull` fetches the file)",
    b"NVM_V3": "a reconstruction of VisualSFM",
    b"# Bundle file": "a reconstruction of Bundler",
}
"""The first bytes of files that are known and not read."""


class InputFile:
    """An opened file of tracks.

    Parameters
    ----------
    name : str
        Its path, or what it is called in messages.
    content : bytes
        The whole file.
    member : str
        The part of the file to read, as in ``FILE#PART``; empty for the only one.
    """

    def __init__(self, name: str, content: bytes, member: str = "") -> None:
        self.name = name
        self.content = content
        self._member = member
        self.was_member_read = False
        """Whether a reader has looked for the part; files of one part have no names of parts."""

    @classmethod
    def opened(cls, path: Path | str) -> InputFile:
        """Read a file, or the part ``#PART`` of it; raises DataError if it cannot be read."""
        name, member = str(path), ""
        if "#" in name and not os.path.exists(name):
            name, _, member = name.rpartition("#")
        check_name(name)
        return cls(name, read_file(name, expected="a file of tracks"), member)

    @property
    def member(self) -> str:
        """The part of the file to read, as in ``FILE#PART``; empty for the only one."""
        self.was_member_read = True
        return self._member

    @property
    def path(self) -> Path:
        """The path of the file."""
        return Path(self.name)

    @cached_property
    def container(self) -> str:
        """The kind of the file, a name in ``CONTAINERS``."""
        return container_of(self.name, self.content)

    @cached_property
    def variables(self) -> Variables:
        """The content by name; raises DataError if it cannot be read."""
        try:
            return CONTAINERS[self.container](self)
        except MemoryError:
            raise DataError(
                f"{self.name}: there is not enough memory to read it; give fewer tracks or frames"
            ) from None


def container_of(name: str, content: bytes) -> str:
    """The kind of a file from its first bytes, and only where these do not tell from its name.

    Returns
    -------
    str
        A name in ``CONTAINERS``; ``table`` for any text.
    """
    if content[:6] == b"MATLAB":
        return "matlab"
    if b"\x89HDF\r\n\x1a\n" in (content[:8], content[512:520]):
        return "matlab" if name.lower().endswith(".mat") else "hdf5"
    if content[:6] == b"\x93NUMPY":
        return "numpy"
    if content[:4] == b"PK\x03\x04":
        return "numpy"
    if content[:16] == b"SQLite format 3\0":
        return "database"
    if name.lower().endswith(".mat"):
        return "matlab"
    if content[:4] == b"PIEH":
        return "flow"
    if is_binary_model(name, content):
        return "layout"
    if any(content.startswith(magic) for magic in _REFUSED):
        return "refused"
    start = content[:200].removeprefix(b"\xef\xbb\xbf").lstrip()
    if start[:1] == b"<":
        return "xml"
    if start[:5] == b"%YAML":
        return "yaml"
    if start[:1] in (b"{", b"["):
        return "json"
    return "layout" if layout_of(content[:HEAD].decode("utf-8-sig", "replace")) else "table"


def is_text(head: bytes) -> bool:
    """Whether the first bytes of a file are text, in any encoding that ``tables`` decodes."""
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return True
    if b"\0" in head:
        return head.count(b"\0") * 3 > len(head) and not set(head) & {1, 2, 3, 4, 5, 6, 7, 8}
    return all(byte >= 32 or byte in b"\t\n\r\f\x1b" for byte in head)


def holds_data(name: str, head: bytes) -> bool:
    """Whether a file is one of tracks rather than a picture or a video, from its first bytes."""
    return container_of(name, head) != "table" or is_text(head)


def _matlab(file: InputFile) -> Variables:
    from mssegment.datasets.matlab import load_matlab

    return load_matlab(file)


def _numpy(file: InputFile) -> Variables:
    from mssegment.datasets.numpy_files import load_numpy

    return load_numpy(file)


def _hdf5(file: InputFile) -> Variables:
    from mssegment.datasets.hdf5 import load_hdf5
    from mssegment.datasets.hdfstore import frames_of, read_frames

    found = load_hdf5(file.content, file.name)
    try:
        frames = frames_of(found)
    except DataError as error:
        raise DataError(f"{file.name}: {error}") from None
    if frames:
        return read_frames(frames, file)
    groups = [own for own in found.values() if isinstance(own, dict)]
    # what is in the only group is read as if it stood at the top
    return {**groups[0], **found} if len(groups) == 1 == len(found) else found


def _database(file: InputFile) -> Variables:
    from mssegment.datasets.colmap import load_database

    return load_database(file)


def _table(file: InputFile) -> Variables:
    from mssegment.datasets.tables import read_table

    return read_table(file.content, file.name)


def _refused(file: InputFile) -> Variables:
    kind = next(kind for magic, kind in _REFUSED.items() if file.content.startswith(magic))
    if kind == "a picture":
        raise DataError(f"{file.name}: a picture; expected tracks (`mssegment run` takes pictures)")
    advice = (
        "unpack it first"
        if "compressed" in kind or "archive" in kind
        else "save the tracks as CSV, or an array [tracks, frames, 2] with numpy.save or "
        "numpy.savez"
    )
    raise DataError(f"{file.name}: {kind}, which is not read; {advice}")


def _xml(file: InputFile) -> Variables:
    from mssegment.datasets.trackmate import load_xml
    from mssegment.inputs.opencv_storage import arrays_of, of_element

    found = load_xml(file)
    if found["root"].tag != "opencv_storage":
        return found
    try:
        tree = of_element(found["root"])
    except RecursionError:
        raise DataError(f"{file.name}: nested too deeply; expected matrices") from None
    return arrays_of(tree) if isinstance(tree, dict) else {}


def _flow(file: InputFile) -> Variables:
    from mssegment.datasets.flows import load_flo

    return load_flo(file)


def _layout(file: InputFile) -> Variables:
    return {}  # its reader parses the whole


def _yaml(file: InputFile) -> Variables:
    from mssegment.inputs.encodings import text_of
    from mssegment.inputs.opencv_storage import arrays_of, of_yaml

    return arrays_of(of_yaml(text_of(file.content, file.name), file.name, DataError))


def _json(file: InputFile) -> Variables:
    from mssegment.inputs.opencv_storage import arrays_of

    limits.check("text_bytes", len(file.content), file.name)
    try:
        found = _parsed(file.content.decode("utf-8-sig"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise DataError(f"{file.name}: not JSON ({error}); expected tracks") from None
    if isinstance(found, dict):
        if str(found.get("schema", "")).startswith("mssegment/"):
            raise DataError(
                f"{file.name}: an mssegment document, which needs no import: pass it to `mssegment "
                "hypothesize` or `mssegment run`"
            )
        return arrays_of(found)
    return {"": found}


def _parsed(text: str) -> Any:
    """JSON, or a list of JSON lines."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        lines = [line for line in text.splitlines() if line.strip()]
        if "Extra data" not in error.msg or len(lines) < 2:
            raise
        return [json.loads(line) for line in lines]


CONTAINERS: dict[str, Callable[[InputFile], Variables]] = {
    "table": _table,
    "numpy": _numpy,
    "matlab": _matlab,
    "hdf5": _hdf5,
    "json": _json,
    "database": _database,
    "xml": _xml,
    "yaml": _yaml,
    "flow": _flow,
    "layout": _layout,
    "refused": _refused,
}
"""The kinds of files, and how the content of each is read."""
