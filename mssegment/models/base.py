"""What a motion model is: an elemental subset, fits, residuals, and the manifold it lives on.

Everything is batched: B hypotheses at a time against P tracks. A model sees the tracks normalized
(``normalization`` says how, ``records.Normalization`` keeps it); residuals come back in pixels.
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
"""The camera that took the example tracks of calibrated models."""


class MotionModel(ABC):
    """One motion model for a given number of frames.

    A model brings its manifold, its elemental subset, its fits and its residual; sampling, mean
    shift and selection are the same for every model. Where models differ otherwise, the class
    variables below say so; no code asks for a model's name.

    Attributes
    ----------
    manifold
        Where the hypotheses are points.
    subset_size
        Tracks in an elemental subset.
    parameters
        Degrees of freedom of one motion.
    residual_dimension
        Dimension c of the residual of one track, in the likelihood of a track.
    residual_terms
        The squared residual vector of a track is this times its residual squared: 1, or F where
        the residual is per frame. With noise sigma in each coordinate its mean is c sigma^2.
    """

    name: ClassVar[str]
    purpose: ClassVar[str]
    """What to use the model for, in a few words."""
    in_auto: ClassVar[bool] = False
    """``hypothesize.model: auto`` tries this model on tracks over the frames that it can see."""
    needs_camera: ClassVar[bool] = False
    assumes_no_rotation: ClassVar[bool] = False
    """The rotation of the camera must be compensated before."""
    min_frames: ClassVar[int] = 2
    max_frames: ClassVar[int | None] = 2
    has_ranks: ClassVar[bool] = False
    """The rank k of its subspaces may be chosen: 3 planar, 4 general."""
    min_displacement: ClassVar[float] = 0.0
    """Pixels; a match that moved less says nothing about a motion and is in no subset."""
    leaves_parallax_free: ClassVar[bool] = False
    """A motion and a point of one frame do not give the points of the other frames."""
    planar_under_perspective: ClassVar[bool] = False
    """A motion is that of a plane under perspective, which may be part of a larger body."""
    is_local: ClassVar[bool] = False
    """Hypotheses hold near their elemental subset only, as those of a plane or a patch."""
    neighbours: ClassVar[int] = 12
    """In long sequences a subset is a seed and some of so many nearest tracks."""
    marked_share: ClassVar[float] = 0.1
    """Share of a set's hypotheses, those that fit a track best, that the track marks."""

    manifold: Manifold
    frames: int = 2
    subset_size: int
    parameters: int
    residual_dimension: int
    residual_terms: int = 1

    @classmethod
    def build(cls, frames: int, rank: int) -> MotionModel:
        """The model for tracks over ``frames`` frames; ``rank`` where it ``has_ranks``."""
        del frames, rank
        return cls()

    @classmethod
    def on_manifold(cls, manifold: Manifold, frames: int) -> MotionModel:
        """The model whose hypotheses over ``frames`` frames lie on ``manifold``.

        Raises DataError where there is none.
        """
        if frames < cls.min_frames or frames > (cls.max_frames or frames):
            raise DataError(f"model {cls.name} over {frames} frames")
        model = cls._for_manifold(manifold, frames)
        if model.manifold.name != manifold.name:
            raise DataError(
                f"model {cls.name} over {frames} frames lives on {model.manifold.name}, "
                f"found {manifold.name}"
            )
        return model

    @classmethod
    def _for_manifold(cls, manifold: Manifold, frames: int) -> MotionModel:
        """The model that ``manifold`` suggests; ``on_manifold`` checks that it is the right one."""
        del manifold
        return cls.build(frames, 3)

    @classmethod
    def accepts(cls, frames: int) -> bool:
        """Whether the model is one of tracks over so many frames."""
        return cls.min_frames <= frames <= (cls.max_frames or frames)

    @abstractmethod
    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Exact tracks of one random motion, [count, F, 2] pixels; ``EXAMPLE_CAMERA`` took them."""

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """How this model sees the tracks ``points`` [P, F, 2] (pixels).

        Each view is centred, all are divided by their common rms radius (in raw pixels the distance
        on the manifold would depend on the corner of the picture).
        """
        del camera
        centres = points.mean(axis=0)
        radius = float(np.sqrt(((points - centres) ** 2).sum(axis=-1).mean()))
        return Normalization(centres, max(radius, 1.0))

    def observe(self, points: Floats, normalization: Normalization) -> Floats:
        """The tracks [P, F, 2] (pixels), normalized."""
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

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|M(p_i)| of equations (23) and (24), [B, P], in the units of the paper's table.

        For models of two views the residual itself, pixels.
        """
        return self.residuals(points, observed, normalization)

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared residuals that rank the hypotheses [B, ...] for each track, [P, B].

        Normalized coordinates; tracks come first because each is ranked by itself.
        """
        unit = Normalization(np.zeros((self.frames, 2)), 1.0)
        return np.asarray(self.residuals(points, observed, unit).T ** 2)

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

    def remarks(self, labels: Sequence[int], points: Floats) -> tuple[str, ...]:
        """What a user should know about the motions ``points`` [m, ...] with these labels."""
        del labels, points
        return ()

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
