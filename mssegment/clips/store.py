"""The files of a long clip: those of each finished window, and the state to go on from.

The arrays of a window are written before its document, and the state after it, so that a document
has its arrays, and the state has its windows. Each file is written whole or not at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from mssegment.documents import write_bytes
from mssegment.documents.arrays import encode_array
from mssegment.documents.clips import (
    ClipDocument,
    WindowDocument,
    WindowTracks,
    decode_json,
    encode_json,
)
from mssegment.errors import DataError
from mssegment.records import Floats, Frame, Integers, Record
from mssegment.sequences.identities import IdentityTracker

CLIP = "clip.json"
STATE = "state.json"
FOLDER = "windows"


class LiveTracks(Record, frozen=True):
    """The tracks in one frame: numbers [n], and positions [n, 2] in pixels."""

    tracks: Integers
    points: Floats


class ClipState(Record, frozen=True):
    """From what an interrupted clip goes on.

    Attributes
    ----------
    windows : int
        The number of finished windows.
    start : int
        The first frame of the next one.
    frames : list of Frame
        Its frames that the last window had too; the last is the one to track from.
    shared : list of LiveTracks
        Their tracks.
    recent : list of LiveTracks
        The tracks of the last frames up to the one to track from.
    next_track : int
        The number of the next new track.
    background : ndarray of int64
        The tracks that were background in the last window.
    identities : IdentityTracker
        What the motions have been.
    is_last : bool
        Whether there are no more windows.
    """

    windows: int
    start: int
    frames: list[Frame]
    shared: list[LiveTracks]
    recent: list[LiveTracks]
    next_track: int
    background: Integers
    identities: IdentityTracker
    is_last: bool = False


class ClipStore:
    """The files of one clip.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def names(self, index: int) -> tuple[str, str]:
        """The names of the document and of the arrays of a window, below the folder."""
        return f"{FOLDER}/{index:05d}.json", f"{FOLDER}/{index:05d}.npz"

    def write_window(self, document: WindowDocument, tracks: WindowTracks) -> None:
        """Write the files of a finished window."""
        (self.folder / FOLDER).mkdir(exist_ok=True)
        json, arrays = (str(self.folder / name) for name in self.names(document.index))
        write_bytes(arrays, tracks.to_bytes())
        write_bytes(json, encode_json(document))

    def write_state(self, state: ClipState) -> None:
        """Replace the state."""
        content = msgspec.json.encode(state, enc_hook=encode_array)
        write_bytes(str(self.folder / STATE), content)

    def read_state(self) -> ClipState | None:
        """The state of an interrupted clip, if there is one."""
        path = self.folder / STATE
        return decode_json(str(path), ClipState) if path.exists() else None

    def write_clip(self, document: ClipDocument) -> None:
        """Write the document of the finished clip; the state is no longer needed."""
        write_bytes(str(self.folder / CLIP), encode_json(document))
        (self.folder / STATE).unlink(missing_ok=True)

    def windows(self, count: int) -> Iterator[tuple[WindowDocument, WindowTracks]]:
        """The first ``count`` windows; raises DataError if a file is missing or damaged."""
        for index in range(count):
            json, arrays = (str(self.folder / name) for name in self.names(index))
            yield decode_json(json, WindowDocument), WindowTracks.from_file(arrays)


def read_clip(folder: str) -> tuple[ClipDocument, ClipStore]:
    """The clip whose files are in a folder.

    Raises DataError if there is none.
    """
    path = Path(folder) / CLIP
    if not path.exists():
        raise DataError(f"{folder}: no {CLIP}; expected the results of a long clip")
    return decode_json(str(path), ClipDocument), ClipStore(Path(folder))
