"""The records that all packages share: frames, corners, tracks, hypotheses, modes, motions.

They are plain data without behaviour, so every package may import this module. ``documents`` writes
them as JSON. Arrays are ``float64`` or ``int64``.
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
Partition = Literal["spectral", "joinedness", "average_linkage"]
"""How consensus groups tracks: complete ones, incomplete ones, those before a static camera."""

OUTLIER = 0
"""Label of a track that belongs to no motion."""
BACKGROUND = -1
"""Label of a static track under a static camera."""
NOT_JUDGED = -2
"""Label of a track that is visible in too few frames to be assigned."""
LARGEST_COORDINATE = 1e6
"""Largest valid coordinate in pixels; anything larger is an error in a file and could overflow."""
LARGEST_LABEL = 1_000_000
"""Largest true label; a larger number is an identifier, or damage in a file."""
IGNORED = -3
"""True label of a track that is not counted (mask value 255)."""


replace = msgspec.structs.replace
"""``replace(record, field=value)``: a copy of a record with some fields changed."""
field = msgspec.field
"""``field(default_factory=dict)``: a field of a record whose default is made anew each time."""


class Record(msgspec.Struct, frozen=True):
    """Base class of immutable records, similar to a frozen dataclass.

    A dataclass generates and compiles its methods at every start. A msgspec struct is defined
    thirty times faster, and its instances are created faster too.
    """


class State(msgspec.Struct):
    """Base class of mutable records: the state of a computation."""


class Frame(Record, frozen=True):
    """One frame: an image file, or one frame of a video or a file of tracks.

    Attributes
    ----------
    path : str
        The path as given.
    width, height : int
        The size in pixels; 0 and 0 for data that is no picture.
    sha256 : str
        The SHA-256 of the file.
    index : int or None
        The index of the frame inside a video or a file of tracks; None for an image file.
    time : float or None
        When the frame is shown, in seconds from the first one of its video; None where the source
        has no times.
    """

    path: str
    width: int
    height: int
    sha256: str = ""
    index: int | None = None
    time: float | None = None


class Camera(Record, frozen=True):
    """A calibrated pinhole camera.

    Attributes
    ----------
    fx, fy : float
        Focal lengths in pixels.
    cx, cy : float
        Principal point in pixels; pixel centres are at whole numbers from 0.
    distortion : tuple of float
        Distortion coefficients in OpenCV's order: k1, k2, p1, p2, k3, ...; of a fisheye lens k1,
        k2, k3, k4.
    distortion_model : {"brown", "fisheye"}
        What the coefficients are of: Brown's polynomial, or the equidistant projection of a
        fisheye lens (Kannala and Brandt).
    width, height : int or None
        The size of the pictures that the camera was calibrated for, where it is known.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    distortion_model: Literal["brown", "fisheye"] = "brown"
    width: int | None = None
    height: int | None = None

    @property
    def matrix(self) -> Floats:
        """The 3x3 calibration matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


class Corners(Record, frozen=True):
    """The corners of one frame.

    Attributes
    ----------
    points : ndarray [n, 2] of float64
        Positions (x, y) in pixels.
    responses : ndarray [n] of float64
        Harris responses.
    scales : ndarray [n] of float64
        Scale of the pyramid level on which each was detected, in pixels per pixel of the level.
    """

    points: Floats
    responses: Floats
    scales: Floats


class Tracks(Record, frozen=True):
    """Tracks: scene points followed through the frames. With two frames they are matches.

    Attributes
    ----------
    points : ndarray [P, F, 2] of float64
        Positions (x, y) in pixels, NaN (null in JSON) where a point is not visible in a frame. For
        data that is no picture [P, F, d], in any unit: a point cloud or a table has F = 1, two
        matched sets of points F = 2.
    affines : ndarray [P, 2, 2] of float64, optional
        Local affine map of each match from the first to the second frame, if the matcher
        estimates it.
    labels : ndarray [P] of int64, optional
        True labels, if known: 0 outlier, 1..n motions.
    ids : tuple of str [P], optional
        The names that the tracks have in the file they come from; None if it has none.
    """

    points: Floats
    affines: Floats | None = None
    labels: Integers | None = None
    ids: tuple[str, ...] | None = None

    @property
    def visible(self) -> npt.NDArray[np.bool_]:
        """Whether each point is visible in each frame, [P, F]."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))


class Normalization(Record, frozen=True):
    """The map from pixels to the normalized coordinates in which a model is fitted.

    A position x in frame f maps to (x - ``centres[f]``) / ``scale``. For a calibrated camera these
    are the normalized image coordinates.

    Attributes
    ----------
    centres : ndarray [F, 2] or [F, d] of float64
        Origin of each frame, in pixels.
    scale : float
        Pixels per unit, the same for all frames; fx for a calibrated camera.
    aspect : float
        fy / fx for a calibrated camera, otherwise 1.
    rotation : ndarray [3, 3] of float64, optional
        For a calibrated camera, the rotation that maps the rays of the second frame into the
        orientation of the first; None if the camera did not rotate.
    """

    centres: Floats
    scale: float
    aspect: float = 1.0
    rotation: Floats | None = None


class HypothesisSet(Record, frozen=True):
    """Hypotheses of one motion model over one selection of frames.

    Attributes
    ----------
    model : str
        The name of the motion model.
    manifold : str
        The name of its manifold, as in ``manifolds.from_name``.
    frames : tuple of int
        Indices into the frames of the document.
    normalization : Normalization
        From pixels to the coordinates of the hypotheses.
    subsets : ndarray [n, k] of int64
        The tracks of each elemental subset.
    points : ndarray [n, ...] of float64
        The hypotheses, points on the manifold.
    drawn : int
        The number of elemental subsets drawn, of which n were kept.
    evidence : bool
        Whether consensus groups tracks by this set; with the others it only states motions.
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

    Attributes
    ----------
    strategy : {"modes", "mixture", "consensus"}
        ``modes``: motions are selected among the modes of the hypotheses. ``mixture``: the modes of
        a long sequence start a mixture of Student t distributions. ``consensus``: tracks that the
        same hypotheses fit best are grouped.
    sets : tuple of HypothesisSet
        The hypotheses.
    partition : {"spectral", "joinedness", "average_linkage"} or None
        How consensus groups the tracks: complete ones, incomplete ones, or those before a static
        camera; None for the other strategies.
    log_nfa : ndarray [P] of float64, or None
        Logarithm of the expected number of false alarms of each track (``sampling.chimeras``); from
        0 on the track is an outlier. NaN where a track was not tested.
    """

    strategy: Strategy
    sets: tuple[HypothesisSet, ...]
    partition: Partition | None = None
    log_nfa: Floats | None = None


class Mode(Record, frozen=True):
    """A local maximum of the kernel density of a set of hypotheses.

    Attributes
    ----------
    set_index : int
        The index of the set.
    hypotheses : int
        The number of hypotheses whose mean shift trajectories converge to this mode.
    kde : float
        The kernel density at the mode, equation (7) without its constant factor.
    point : ndarray of float64
        The mode, a point on the manifold of the set.
    motion : int
        The label of the motion that was selected from it; 0 if none.
    """

    set_index: int
    hypotheses: int
    kde: float
    point: Floats
    motion: int = 0


class Part(Record, frozen=True):
    """One of several motions that were joined: a plane or patch of a rigid body.

    Attributes
    ----------
    set_index : int
        The index of the set that it comes from.
    model : str
        Its motion model.
    parameters : ndarray of float64
        The motion, a point on the manifold of the model, in normalized coordinates.
    inliers : ndarray of int64
        Indices of its tracks.
    rms : float
        Root mean square of its residuals, in pixels.
    """

    set_index: int
    model: str
    parameters: Floats
    inliers: Integers
    rms: float


class Motion(Record, frozen=True):
    """A selected mode, refitted to its inliers.

    Attributes
    ----------
    label : int
        The number of the motion; 1 has the most inliers.
    set_index : int
        The index of the set that it comes from.
    model : str
        The motion model; with ``auto`` each motion has its own.
    parameters : ndarray of float64
        The motion, a point on the manifold of the model, in normalized coordinates.
    inliers : ndarray of int64
        Indices of its tracks.
    scale : float
        Estimated standard deviation of the residuals, in pixels.
    rms : float
        Root mean square of the residuals of the inliers, in pixels.
    cost_saved : float, optional
        Description length that the motion saves, in nats; None for a selection that does not
        compute it.
    log_nfa : float, optional
        Natural logarithm of the expected number of false alarms: of groups of independent tracks
        that move as coherently (``consensus.group_test``); None if it was not tested.
    separation : float, optional
        Consensus: what telling the motion from the most similar other one saves, over what it must
        save (``consensus.split_test``); above 1 they are two motions. None if it was not tested.
    matrix : ndarray [3, 3] or [F, 3, 3] of float64, optional
        The motion in pixels, least squares over the inliers, or those of the largest part. Two
        views: the map from the first to the second, with last entry 1, as ``cv2.findHomography``
        returns it. More views: the affine map from the first frame that shows the motion to each
        frame; NaN where the inliers determine none. None for ``translation`` and ``essential``,
        which predict no points. Points must be free of lens distortion.
    direction : ndarray [3] of float64, optional
        ``translation``, ``essential``: the unit vector of the motion of the object relative to the
        camera, in the coordinates of the first view (x right, y down, z forward).
    epipole : ndarray [2] of float64, optional
        ``translation``, ``essential``: the vanishing point of ``direction`` in the first view, in
        pixels; NaN where it is at infinity.
    rotation : ndarray [3, 3] of float64, optional
        ``essential``: R of X2 = R (X1 + s ``direction``), where the length s is not known. What
        ``cv2.recoverPose`` calls t is R ``direction``.
    basis : ndarray [F, 2, k] of float64, optional
        ``factorization``: the subspace in pixels. The track with coefficients s [k] is
        ``origin`` + ``basis`` s.
    origin : ndarray [F, 2] of float64, optional
        ``factorization``: see ``basis``. Lines [1, d]: a point of the line, whose direction is
        ``basis`` [1, d, 1]; subspaces: the origin, with an orthonormal ``basis`` [1, d, k].
    coefficients : ndarray [d + 1] of float64, optional
        Planes and hyperplanes: (a, b, ..., e) of ax + by + ... + e = 0 with (a, b, ...) of length
        1.
    parts : tuple of Part
        The motions that were joined to this one, the largest first, if one epipolar geometry holds
        them together (``segmentation.rigid_join``). ``model`` and ``parameters`` are then those of
        the largest; residuals are from the part that a track belongs to.
    rigid_evidence : float, optional
        Evidence, in nats, for the parts to be one rigid body; None without parts.
    """

    label: int
    set_index: int
    model: str
    parameters: Floats
    inliers: Integers
    scale: float
    rms: float
    cost_saved: float | None = None
    log_nfa: float | None = None
    separation: float | None = None
    matrix: Floats | None = None
    direction: Floats | None = None
    epipole: Floats | None = None
    rotation: Floats | None = None
    basis: Floats | None = None
    origin: Floats | None = None
    coefficients: Floats | None = None
    parts: tuple[Part, ...] = ()
    rigid_evidence: float | None = None


class ClusterResult(Record, frozen=True):
    """The result of ``cluster``.

    Attributes
    ----------
    labels : ndarray [P] of int64
        1..m for a motion, ``OUTLIER``, ``BACKGROUND`` or ``NOT_JUDGED``.
    modes : tuple of Mode
        The modes, strongest first.
    motions : tuple of Motion
        The motions, label 1 first.
    bandwidths : tuple of float
        The bandwidth of each set of hypotheses, in the distance of its manifold.
    residuals : ndarray [m, P] of float64
        Residual of each track from each motion, in pixels; NaN where there is none.
    assignments : tuple of ndarray of int64
        For each set, the index of the mode that each hypothesis converges to; -1 for none.
    notes : tuple of str
        Notes for the user on decisions and limitations.
    camera_motion : int or None
        The label of the motion of the static world under a moving camera; None if it is not known.
    """

    labels: Integers
    modes: tuple[Mode, ...]
    motions: tuple[Motion, ...]
    bandwidths: tuple[float, ...]
    residuals: Floats
    assignments: tuple[Integers, ...] = ()
    notes: tuple[str, ...] = ()
    camera_motion: int | None = None


def by_size(labels: Integers) -> Integers:
    """The labels [P] with the positive ones numbered 1, 2, ..., the largest group first."""
    names, sizes = np.unique(labels[labels > 0], return_counts=True)
    numbered = labels.copy()
    for number, name in enumerate(names[np.argsort(-sizes, kind="stable")], start=1):
        numbered[labels == name] = number
    return numbered
