"""What a motion model is: an elemental subset, two fits, a residual, and the manifold it lives on.

Everything is batched: B hypotheses at a time against P tracks. Observations are coordinates, not
pixels: ``normalization`` says how the model wants to see the tracks, ``records.Coordinates`` keeps
it, and residuals come back in pixels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Manifold
from mssegment.records import Camera, Floats, Normalization

Flags = npt.NDArray[np.bool_]


class MotionModel(ABC):
    """One motion model for a given number of frames.

    A model adds its parameters, its residual and its fits; sampling, mean shift and selection are
    the same for every model.
    """

    name: ClassVar[str]
    needs_camera: ClassVar[bool] = False
    min_frames: ClassVar[int] = 2
    max_frames: ClassVar[int | None] = 2
    min_displacement: ClassVar[float] = 0.0
    """Pixels; a match that moved less says nothing about a motion and is in no subset."""

    manifold: Manifold
    frames: int = 2
    subset_size: int
    """Tracks in an elemental subset."""
    parameters: int
    """Degrees of freedom of one motion: p in the price of a motion."""
    residual_dimension: int
    """Dimension c of the residual of one track, in the likelihood of a track."""
    residual_terms: int = 1
    """The squared residual vector of a track is this times its residual squared: 1, or F where
    the residual is per frame. With noise sigma in each coordinate its mean is c sigma^2."""

    @classmethod
    def build(cls, frames: int, rank: int) -> MotionModel:
        """The model for tracks over ``frames`` frames; only ``factorization`` has a ``rank``."""
        del frames, rank
        return cls()

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """The coordinates in which this model sees the tracks ``points`` [P, F, 2] (pixels).

        Each view is centred, all are divided by their common rms radius (raw pixels make the
        distance on the manifold a matter of the picture's corner).
        """
        del camera
        centres = points.mean(axis=0)
        radius = float(np.sqrt(((points - centres) ** 2).sum(axis=-1).mean()))
        return Normalization(centres, max(radius, 1.0))

    def observe(self, points: Floats, normalization: Normalization) -> Floats:
        """The tracks [P, F, 2] in the model's coordinates."""
        return np.asarray((points - normalization.centres) / normalization.scale)

    @abstractmethod
    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Hypotheses of the elemental subsets [B, k, F, 2]: points [B, ...] and which are sound.

        Degenerate and absurd subsets are False in the second array; their points are arbitrary.
        """

    @abstractmethod
    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least-squares motions of the tracks [P, F, 2] under the weights [B, P]; as above.

        Or each of tracks of its own: [B, n, F, 2] under the weights [B, n].
        """

    def algebraic_fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """M-hat of equation (24): minimizes the mean square of ``algebraic_residuals``."""
        return self.fit(observed, weights)

    @abstractmethod
    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distances in pixels (per frame) of the tracks [P, F, 2] from the motions, [B, P].

        Or of each motion from tracks of its own, [B, n, F, 2], [B, n].
        """

    @abstractmethod
    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|M(p_i)| of equations (23) and (24), [B, P], in the units of the paper's table."""

    def orientations(self, points: Floats) -> Floats:
        """The motions that the points [B, ...] of the manifold may stand for, one or more each.

        All first ones, then all second ones, if any: [n B, ...].
        """
        return points

    def displacements(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats | None:
        """How far each track moved where the motions [B, ...] leave it free, pixels [B, P]."""
        del points, observed, normalization
        return None

    def free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """Natural log of the extent (pixels) along which a motion leaves a track free.

        The part of a track's description that a motion does not predict, coded as uniform: zero
        for affine and homography (the point of view 1 is given), for translation the epipolar
        line, for factorization the k dimensions of the subspace.
        """
        del observed, normalization
        return 0.0


def concentrated(weights: Floats, observed: Floats) -> tuple[Floats, Floats]:
    """Weights [B, n] and tracks [B, n, F, 2] without most of those that weigh nothing.

    All as they are, [B, P] and [P, F, 2], where many tracks weigh, or each motion has its own.
    """
    some = weights > 0
    count = some.sum(axis=1)
    most = max(int(count.max(initial=0)), 1)
    if observed.ndim == 4 or 2 * most > weights.shape[1]:
        return weights, observed
    row, track = np.nonzero(some)
    place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    few, places = np.zeros((len(weights), most)), np.zeros((len(weights), most), dtype=np.int64)
    few[row, place], places[row, place] = weights[row, track], track
    return few, observed[places]


def weighted_sums(weights: Floats, numbers: Floats) -> Floats:
    """Sums [B, d] of ``numbers``, [P, d] or [B, P, d], under the weights [B, P]."""
    if numbers.ndim == 2:
        return np.asarray(weights @ numbers)
    return np.asarray((weights[:, None] @ numbers)[:, 0])
