"""The nouns that pass between the rooms: frames, corners, tracks, hypotheses, modes, motions.

Plain data without behaviour, so that every room may import it. ``documents`` writes these very
records as JSON; an array is ``float64`` or ``int64``.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Strategy = Literal["modes", "mixture", "consensus"]
"""How hypotheses become motions."""
Partition = Literal["spectral", "normalized_cuts", "average_linkage"]
"""How consensus groups tracks: complete ones, incomplete ones, those before a static camera."""

OUTLIER = 0
"""Label of a track that belongs to no motion."""
BACKGROUND = -1
"""Label of a track that stands still under a static camera."""
NOT_JUDGED = -2
"""Label of a track that was seen too briefly to say anything."""
LARGEST_COORDINATE = 1e6
"""Pixels; a track or corner that is farther out is a mistake in a file (and would overflow)."""
IGNORED = -3
"""True label of a track that must not be counted (mask value 255)."""


replace = msgspec.structs.replace
"""``replace(record, field=value)``: a copy of a record with some fields changed."""


class Record(msgspec.Struct, frozen=True):
    """Plain data that does not change, as a frozen dataclass.

    A dataclass writes and compiles its methods on every start, and a run has dozens of them; a
    struct is made thirty times faster, and so is each instance.
    """


class State(msgspec.Struct):
    """A record that changes: where a computation stands."""


class Frame(Record, frozen=True):
    """One picture: the path as given, its size in pixels, the SHA-256 of the file.

    ``index`` is the frame number inside a video file, None for a picture.
    """

    path: str
    width: int
    height: int
    sha256: str = ""
    index: int | None = None


class Camera(Record, frozen=True):
    """Pinhole intrinsics in pixels; ``distortion`` in OpenCV's order (k1, k2, p1, p2, k3, ...)."""

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    @property
    def matrix(self) -> Floats:
        """The 3x3 calibration matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


class Corners(Record, frozen=True):
    """The corners of one frame: ``points`` [n, 2] pixels, ``responses`` [n], ``scales`` [n]."""

    points: Floats
    responses: Floats
    scales: Floats


class Tracks(Record, frozen=True):
    """Scene points followed through the frames.

    ``points`` [P, F, 2] pixels, NaN (null in JSON) where a track is not seen; ``affines``
    [P, 2, 2] is the local affine map of a match from frame 1 to frame 2, where the matcher knows
    it; ``labels`` [P] are true labels (0 none, 1..n motions), where somebody gave them.
    """

    points: Floats
    affines: Floats | None = None
    labels: Integers | None = None

    @property
    def visible(self) -> npt.NDArray[np.bool_]:
        """Where each track is seen, [P, F]."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))


class Normalization(Record, frozen=True):
    """How pixels became the coordinates in which a hypothesis is a point on its manifold.

    Frame f of the set maps x to (x - ``centres``[f]) / ``scale``; ``centres`` is [F, 2] pixels and
    ``scale`` is in pixels per unit, the same for every frame. For a calibrated camera ``scale`` is
    fx, ``aspect`` is fy / fx, and ``rotation`` [3, 3] turns the rays of the second frame into the
    orientation of the first (None: the camera did not turn).
    """

    centres: Floats
    scale: float
    aspect: float = 1.0
    rotation: Floats | None = None


class HypothesisSet(Record, frozen=True):
    """Hypotheses of one motion model on one choice of frames.

    ``frames`` are indices into the document's frames; ``subsets`` [n, k] are indices of tracks;
    ``points`` [n, ...] lie on ``manifold``; ``drawn`` is how many elemental subsets were tried.
    Consensus groups tracks by sets that are ``evidence``; in the others it only states motions.
    """

    model: str
    manifold: str
    frames: tuple[int, ...]
    normalization: Normalization
    subsets: Integers
    points: Floats
    drawn: int = 0
    evidence: bool = True


class Hypotheses(Record, frozen=True):
    """All sets of hypotheses of a scene, and the strategy that they were drawn for.

    ``modes``: motions are selected among the modes of the hypotheses. ``mixture``: modes of a long
    sequence start a mixture of Student t distributions. ``consensus``: tracks are grouped by the
    hypotheses that they agree on, in the way that ``partition`` says.
    """

    strategy: Strategy
    sets: tuple[HypothesisSet, ...]
    partition: Partition | None = None


class Mode(Record, frozen=True):
    """A local maximum of the kernel density of the hypotheses of set ``set_index``.

    ``hypotheses`` counts the mean shift trajectories that end here, ``kde`` is the kernel density
    (7) without its constant, ``motion`` the label of the motion that grew from it (0: none).
    """

    set_index: int
    hypotheses: int
    kde: float
    point: Floats
    motion: int = 0


class Motion(Record, frozen=True):
    """A mode that survived selection, refitted to its inliers.

    ``label`` is its number, 1 the one with most inliers; ``parameters`` is its point on the
    manifold of ``set_index``'s model (``model`` names it: ``auto`` may choose per motion);
    ``inliers`` are indices of tracks; ``scale`` is the standard deviation of its residuals and
    ``rms`` their root mean square, in pixels; ``cost_saved`` is the description length that the
    motion saves (nats), None where the selection does not reckon with it.
    """

    label: int
    set_index: int
    model: str
    parameters: Floats
    inliers: Integers
    scale: float
    rms: float
    cost_saved: float | None = None


class Segmentation(Record, frozen=True):
    """The outcome of ``cluster``: modes strongest first, motions, one label per track.

    ``residuals`` [motions, P] in pixels, NaN where a track has none; ``notes`` are sentences for
    the user: what was decided, and what could not be.
    """

    labels: Integers
    modes: tuple[Mode, ...]
    motions: tuple[Motion, ...]
    bandwidths: tuple[float, ...]
    residuals: Floats
    assignments: tuple[Integers, ...] = ()
    notes: tuple[str, ...] = ()
