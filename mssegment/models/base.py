"""The interface of motion models: elemental subset, fits, residuals, and the manifold.

Everything is batched: B hypotheses at a time against P tracks. Models work in normalized
coordinates (``MotionModel.normalization``, ``records.Normalization``); residuals are in pixels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.manifolds import Manifold
from mssegment.records import Camera, Floats, Normalization

Flags = npt.NDArray[np.bool_]

EXAMPLE_CAMERA = Camera(800.0, 780.0, 320.0, 240.0)
"""The camera of the example tracks of calibrated models."""


class MotionModel(ABC):
    """A motion model for a given number of frames F.

    A model defines its manifold, its elemental subset, its fits and its residual. Sampling, mean
    shift and selection are the same for all models. Other differences between models are class
    variables; no code compares names of models.

    Shapes: B hypotheses or motions, P tracks, F frames, k tracks in an elemental subset.

    Attributes
    ----------
    manifold : Manifold
        The manifold of the hypotheses.
    frames : int
        Number of frames F.
    subset_size : int
        Number of tracks k in an elemental subset.
    parameters : int
        Degrees of freedom of one motion.
    residual_dimension : int
        Dimension c of the residual vector of a track; its distribution is used as a likelihood.
    residual_terms : int
        Ratio of the squared norm of the residual vector to the squared residual: 1, or F if the
        residual is per frame. With noise of standard deviation sigma in each coordinate the
        expected squared norm is c sigma^2.
    """

    name: ClassVar[str]
    purpose: ClassVar[str]
    """What the model is for, in a few words."""
    of_pictures: ClassVar[bool] = True
    """The data are positions in pictures, in pixels; otherwise see ``models.data``."""
    coordinates: ClassVar[int | None] = 2
    """Number of coordinates of a point; None for any."""
    in_auto: ClassVar[bool] = False
    """``hypothesize.model: auto`` includes this model if it accepts the number of frames and, where
    it needs a camera, there is one."""
    needs_camera: ClassVar[bool] = False
    assumes_no_rotation: ClassVar[bool] = False
    """The model does not allow for rotation of the camera, which must be compensated first."""
    min_frames: ClassVar[int] = 2
    max_frames: ClassVar[int | None] = 2
    has_ranks: ClassVar[bool] = False
    """The dimension k of its subspaces is an option: 3 planar, 4 general."""
    min_displacement: ClassVar[float] = 0.0
    """Matches that moved less, in pixels, do not constrain a motion and are not sampled."""
    leaves_parallax_free: ClassVar[bool] = False
    """A motion and the point in one frame do not determine the point in the other frames."""
    planar_under_perspective: ClassVar[bool] = False
    """A motion is that of a plane under perspective, which may be part of a larger object."""
    is_local: ClassVar[bool] = False
    """A hypothesis holds only near its elemental subset, like that of a plane or a patch."""
    sampling_neighbours: ClassVar[int] = 12
    """In long sequences, a subset is a seed and some of this many nearest neighbours."""
    marked_share: ClassVar[float] = 0.1
    """Share of the hypotheses of a set that a track marks: those that fit it best."""

    manifold: Manifold
    frames: int = 2
    subset_size: int
    parameters: int
    residual_dimension: int
    residual_terms: int = 1

    @classmethod
    def build(cls, frames: int, rank: int, dimension: int = 2) -> MotionModel:
        """Construct the model for ``frames`` frames of points with ``dimension`` coordinates.

        ``rank`` matters if it ``has_ranks``.
        """
        del frames, rank, dimension
        return cls()

    @classmethod
    def on_manifold(cls, manifold: Manifold, frames: int, dimension: int = 2) -> MotionModel:
        """Construct the model whose hypotheses over ``frames`` frames lie on ``manifold``.

        Points have ``dimension`` coordinates.

        Raises
        ------
        DataError
            If the model does not accept the number of frames or coordinates, or has another
            manifold.
        """
        if not cls.accepts(frames):
            raise DataError(f"model {cls.name} does not accept {frames} frames")
        if dimension != (cls.coordinates or dimension):
            raise DataError(
                f"model {cls.name} is for points with {cls.coordinates} coordinates; found "
                f"{dimension}"
            )
        model = cls._for_manifold(manifold, frames, dimension)
        if model.manifold.name != manifold.name:
            raise DataError(
                f"model {cls.name} over {frames} frames belongs to manifold "
                f"{model.manifold.name}; found {manifold.name}"
            )
        return model

    @classmethod
    def _for_manifold(cls, manifold: Manifold, frames: int, dimension: int) -> MotionModel:
        """The model with the parameters of ``manifold``; ``on_manifold`` checks that they agree."""
        del manifold
        return cls.build(frames, 3, dimension) if not cls.of_pictures else cls.build(frames, 3)

    @classmethod
    def accepts(cls, frames: int) -> bool:
        """Whether the model accepts tracks over ``frames`` frames."""
        return cls.min_frames <= frames <= (cls.max_frames or frames)

    @abstractmethod
    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Generate exact tracks of one random motion, as seen by ``EXAMPLE_CAMERA``.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of random numbers.
        count : int
            Number of tracks.

        Returns
        -------
        ndarray [count, F, 2]
            Positions in pixels, without noise.
        """

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """Determine the normalized coordinates for these tracks.

        By default each frame is centred, and all are divided by their common rms radius. (In
        pixels, distances on the manifold would depend on where the image has its origin.)

        Parameters
        ----------
        points : ndarray [P, F, 2]
            Tracks in pixels.
        camera : Camera, optional
            The calibration; required if ``needs_camera``.

        Returns
        -------
        Normalization
        """
        del camera
        centres = points.mean(axis=0)
        radius = float(np.sqrt(((points - centres) ** 2).sum(axis=-1).mean()))
        return Normalization(centres, max(radius, 1.0))

    def observe(self, points: Floats, normalization: Normalization) -> Floats:
        """Normalize tracks: pixels [P, F, 2] to normalized coordinates [P, F, 2]."""
        return np.asarray((points - normalization.centres) / normalization.scale)

    @abstractmethod
    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Compute hypotheses from elemental subsets (the minimal solver).

        Parameters
        ----------
        samples : ndarray [B, k, F, 2]
            Elemental subsets, normalized.

        Returns
        -------
        points : ndarray [B, ...]
            Hypotheses, points on the manifold; arbitrary for invalid subsets.
        valid : ndarray [B] of bool
            False for degenerate subsets and for implausible motions.
        """

    @abstractmethod
    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Fit motions by weighted least squares (the non-minimal solver).

        Parameters
        ----------
        observed : ndarray [P, F, 2] or [B, n, F, 2]
            Normalized tracks: the same for all motions, or n for each motion.
        weights : ndarray [B, P] or [B, n]
            Nonnegative weights of the tracks.

        Returns
        -------
        points : ndarray [B, ...]
            Motions, points on the manifold; arbitrary where not valid.
        valid : ndarray [B] of bool
            Whether the weighted tracks determine a plausible motion.
        """

    def algebraic_fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Minimize the mean square of ``algebraic_residuals``: M-hat of equation (24)."""
        return self.fit(observed, weights)

    @abstractmethod
    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Compute the distances of tracks from motions, in pixels per frame.

        Parameters
        ----------
        points : ndarray [B, ...]
            Motions, points on the manifold.
        observed : ndarray [P, F, 2] or [B, n, F, 2]
            Normalized tracks: the same for all motions, or n for each motion.
        normalization : Normalization
            The normalization of the tracks.

        Returns
        -------
        ndarray [B, P] or [B, n]
            Residuals in pixels, infinite where a point would be behind the camera.
        """

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """Compute |M(p_i)| of equations (23) and (24), [B, P], in the units of the paper's tables.

        By default these are the ``residuals``.
        """
        return self.residuals(points, observed, normalization)

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared residuals by which a track ranks the hypotheses, in normalized units, [P, B].

        Tracks are along the first axis, because the hypotheses are ranked for each track
        separately.
        """
        unit = Normalization(np.zeros((self.frames, observed.shape[-1])), 1.0)
        return np.asarray(self.residuals(points, observed, unit).T ** 2)

    def orientations(self, points: Floats) -> Floats:
        """List the oriented motions that points [B, ...] of the manifold may represent.

        Returns [n B, ...]: the first orientation of all points, then the second, and so on. The
        default is n = 1.
        """
        return points

    def displacements(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats | None:
        """Displacement of each track along the direction that a motion leaves free.

        Returns pixels [B, P], or None if the model predicts points.
        """
        del points, observed, normalization
        return None

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """State one motion in pixels.

        Parameters
        ----------
        point : ndarray
            The motion, a point on the manifold.
        normalization : Normalization
            The normalization of the tracks.

        Returns
        -------
        dict of str to ndarray
            By field of ``records.Motion``: ``matrix``, or what describes a motion that predicts no
            points. By default nothing.
        """
        del point, normalization
        return {}

    def remarks(self, labels: Sequence[int], points: Floats) -> tuple[str, ...]:
        """Notes for the user on motions ``points`` [m, ...] with the given labels."""
        del labels, points
        return ()

    def log_free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """Natural logarithm of the extent, in pixels, along which a motion leaves a track free.

        The description length of a track codes the part that a motion does not predict as uniform
        over this extent: 1 pixel (zero) for affine and homography, which predict the point in view
        2 from that in view 1; the epipolar line for translation; the k dimensions of the subspace
        for factorization.
        """
        del observed, normalization
        return 0.0


def drop_unweighted(weights: Floats, observed: Floats) -> tuple[Floats, Floats]:
    """Gather the tracks of positive weight of each motion, to make the arrays smaller.

    Parameters
    ----------
    weights : ndarray [B, P]
        Weights of the tracks.
    observed : ndarray [P, F, 2]
        Tracks.

    Returns
    -------
    weights : ndarray [B, n]
    observed : ndarray [B, n, F, 2]
        Both unchanged if a motion gives weight to more than half of the tracks, or if each motion
        has its own tracks already.
    """
    positive = weights > 0
    count = positive.sum(axis=1)
    largest = max(int(count.max(initial=0)), 1)
    if observed.ndim == 4 or 2 * largest > weights.shape[1]:
        return weights, observed
    row, track = np.nonzero(positive)
    column = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    gathered = np.zeros((len(weights), largest))
    tracks = np.zeros(gathered.shape, dtype=np.int64)
    gathered[row, column], tracks[row, column] = weights[row, track], track
    return gathered, observed[tracks]


def weighted_sums(weights: Floats, values: Floats) -> Floats:
    """Sums [B, d] of ``values``, [P, d] or [B, P, d], with weights [B, P]."""
    if values.ndim == 2:
        return np.asarray(weights @ values)
    return np.asarray((weights[:, None] @ values)[:, 0])
