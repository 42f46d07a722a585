"""The documents of a long clip: one for each window, one for the whole clip, and their arrays.

A window has two files, ``windows/00012.json`` and ``windows/00012.npz``. The arrays hold the
positions of the frames that belong to no later window, so that each position is stored once, as two
32-bit numbers.
"""

from __future__ import annotations

import io
import zipfile
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from mssegment.documents.arrays import decode_array, encode_array, readable
from mssegment.documents.files import read_bytes
from mssegment.documents.schemas import HistoryEntry
from mssegment.errors import DataError
from mssegment.records import Floats, Integers, Record, Strategy, field

Struct = TypeVar("Struct")


class WindowMotion(Record, frozen=True):
    """A motion in one window.

    Attributes
    ----------
    label : int
        Its label in the window.
    identity : int
        The object; 0 is the static world, seen by a moving camera, -1 none.
    model : str
        The motion model.
    tracks : int
        The number of its tracks.
    rms : float
        Root mean square of their residuals, in pixels.
    first, last : int
        The first and the last frame that show it.
    """

    label: int
    identity: int
    model: str
    tracks: int
    rms: float
    first: int
    last: int


class WindowDocument(
    msgspec.Struct, kw_only=True, frozen=True, tag_field="schema", tag="mssegment/window/1"
):
    """What was found in a window of frames.

    Attributes
    ----------
    index : int
        The number of the window, from 0.
    start, stop : int
        Its first frame, and the frame after its last one, counted in the clip from 0.
    own_stop : int
        The frame after the last one whose positions are in the arrays of this window; those that
        follow are in the next one.
    camera : {"static", "moving"}
        Whether the camera moves.
    strategy : str or None
        How the motions were found; None where nothing moves.
    motions : list of WindowMotion
        The motions, label 1 first.
    resting : list of int
        The objects that stand still in this window.
    origins, merged : dict
        The object that a new one split from; and the one that an object was merged into.
    times : list of float or None
        When the frames from ``start`` to ``own_stop`` are shown, in seconds.
    notes : list of str
        What was decided, and what could not be.
    """

    index: int
    start: int
    stop: int
    own_stop: int
    camera: Literal["static", "moving"]
    strategy: Strategy | None
    motions: list[WindowMotion]
    resting: list[int] = []
    origins: dict[int, int] = {}
    merged: dict[int, int] = {}
    times: list[float | None] = []
    notes: list[str] = []


class ClipObject(Record, frozen=True):
    """An object, or the static world, over a whole clip.

    Attributes
    ----------
    identity : int
        Its number; 0 is the static world, seen by a moving camera.
    first, last : int
        The first and the last frame that show it.
    moving, resting : list of [int, int]
        The first and the last frame of each period in which it moves, or stands still.
    tracks : int
        How many tracks show it.
    largest : int
        The most tracks in one window.
    origin : int or None
        The object that it split from.
    merged_into : int or None
        The object that its last tracks became part of.
    """

    identity: int
    first: int
    last: int
    moving: list[tuple[int, int]]
    resting: list[tuple[int, int]] = field(default_factory=list)
    tracks: int = 0
    largest: int = 0
    origin: int | None = None
    merged_into: int | None = None

    @property
    def is_part(self) -> bool:
        """Whether all of its tracks became part of another object: then it was a piece of that."""
        return self.merged_into is not None and self.tracks == 0


class ClipDocument(
    msgspec.Struct, kw_only=True, frozen=True, tag_field="schema", tag="mssegment/clip/1"
):
    """A clip that was segmented window by window.

    Attributes
    ----------
    inputs : list of str
        The video, or the pictures; or the file of tracks, and the pictures of these.
    sha256 : str
        Of the video, or of those of all pictures together; or of the tracks.
    start, step : int
        The first frame that was read of a video or of a file of tracks, and the distance of the
        frames.
    numbers : list of int
        The numbers of the frames of a file of tracks, where their distances differ.
    width, height : int
        The size of the frames in pixels.
    frames : int
        The number of frames.
    rate : float or None
        Frames a second, where the source has times.
    windows : list of [int, int]
        The first frame of each window, and the frame after its last one.
    cameras : list of str
        ``static`` or ``moving``, for each window.
    tracks, positions : int
        The number of tracks, and of their positions.
    objects : list of ClipObject
        The objects, by number.
    ids : list of str
        The names of the tracks in the file that they come from, by number.
    history : list of HistoryEntry
        The stages and their settings.
    notes : list of str
        Notes for the user.
    """

    inputs: list[str]
    sha256: str
    start: int
    step: int
    width: int
    height: int
    frames: int
    rate: float | None
    windows: list[tuple[int, int]]
    cameras: list[str]
    tracks: int
    positions: int
    objects: list[ClipObject]
    numbers: list[int] = []
    ids: list[str] = []
    history: list[HistoryEntry] = []
    notes: list[str] = []

    def number(self, frame: int) -> int:
        """The number of a frame in its source."""
        return self.numbers[frame] if self.numbers else self.start + frame * self.step

    @property
    def whole_objects(self) -> list[ClipObject]:
        """The objects without those that turned out to be pieces of others."""
        return [one for one in self.objects if not one.is_part]


class WindowTracks(Record, frozen=True):
    """The tracks of a window, where they are visible: one row for each run of frames.

    Attributes
    ----------
    track : ndarray [n] of int64
        The number of the track in the clip.
    first : ndarray [n] of int64
        The first frame of the run, counted in the clip.
    length : ndarray [n] of int64
        Its frames.
    label : ndarray [n] of int64
        The label of the track in the window.
    identity : ndarray [n] of int64
        Its object; 0 the static world, -1 none.
    points : ndarray [sum of length, 2] of float32
        The positions in pixels, run after run.
    matrices : ndarray [m, L, 3, 3] of float64
        For each motion, the affine map in pixels from the first frame that shows it to each frame
        of the window; NaN where its tracks determine none.
    """

    track: Integers
    first: Integers
    length: Integers
    label: Integers
    identity: Integers
    points: npt.NDArray[np.float32]
    matrices: Floats

    @classmethod
    def of(
        cls,
        start: int,
        tracks: Integers,
        points: Floats,
        labels: Integers,
        identities: Integers,
        matrices: Floats | None = None,
    ) -> WindowTracks:
        """The runs of tracks [P] whose positions [P, L, 2] begin with frame ``start``.

        Labels and identities are [P], or [P, L] where a track changes them.
        """
        visible = np.asarray(np.isfinite(points).all(axis=2))
        labels, identities = (
            np.broadcast_to(own if own.ndim == 2 else own[:, None], visible.shape)
            for own in (labels, identities)
        )
        before = np.zeros_like(visible)
        before[:, 1:] = (
            visible[:, :-1]
            & (labels[:, 1:] == labels[:, :-1])
            & (identities[:, 1:] == identities[:, :-1])
        )
        after = np.zeros_like(visible)
        after[:, :-1] = before[:, 1:] & visible[:, 1:]
        row, first = np.nonzero(visible & ~before)
        _, last = np.nonzero(visible & ~after)
        return cls(
            track=tracks[row],
            first=start + first,
            length=last + 1 - first,
            label=labels[row, first],
            identity=identities[row, first],
            points=points[visible].astype(np.float32),
            matrices=np.zeros((0, 0, 3, 3)) if matrices is None else matrices,
        )

    def to_bytes(self) -> bytes:
        """The content of an ``.npz`` file, a few bytes for each position."""
        out = io.BytesIO()
        np.savez(
            out,
            track=self.track.astype(np.uint32),
            first=self.first.astype(np.uint32),
            length=self.length.astype(np.uint16),
            label=self.label.astype(np.int16),
            identity=self.identity.astype(np.int32),
            points=self.points,
            matrices=self.matrices,
        )
        return out.getvalue()

    @classmethod
    def from_file(cls, path: str) -> WindowTracks:
        """Read them; raises DataError if the file is not what ``to_bytes`` wrote."""
        try:
            with np.load(io.BytesIO(read_bytes(path)), allow_pickle=False) as arrays:
                integers = {
                    name: np.asarray(arrays[name], np.int64)
                    for name in ("track", "first", "length", "label", "identity")
                }
                points = np.asarray(arrays["points"], np.float32)
                matrices = np.asarray(arrays["matrices"], np.float64)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise DataError(f"{path}: not the tracks of a window ({error})") from None
        if integers["length"].sum() != len(points) or points.ndim != 2:
            raise DataError(
                f"{path}: {len(points)} positions for runs of {integers['length'].sum()} frames"
            )
        return cls(**integers, points=points, matrices=matrices)

    def spread(self) -> tuple[Integers, Integers]:
        """The row and the frame of each of the ``points``."""
        rows = np.repeat(np.arange(len(self.track)), self.length)
        starts = np.cumsum(self.length) - self.length
        return rows, np.arange(len(self.points)) - starts[rows] + self.first[rows]


def encode_json(document: Any) -> bytes:
    """A document as JSON: indented where people may read it."""
    return msgspec.json.format(msgspec.json.encode(document, enc_hook=encode_array), indent=1)


def decode_json(path: str, kind: type[Struct]) -> Struct:
    """Read a document of a type; raises DataError with the path of what is wrong."""
    try:
        return msgspec.json.decode(read_bytes(path), type=kind, dec_hook=decode_array)
    except msgspec.ValidationError as error:
        raise DataError(f"{path}: {readable(error)}") from None
    except msgspec.DecodeError as error:
        raise DataError(f"{path}: not JSON ({error})") from None
