"""What a motion model is: an elemental subset, two fits, a residual, and the manifold it lives on.

Everything is batched: B hypotheses at a time against P tracks. Observations are coordinates, not
pixels: ``coordinates`` says how the model wants to see the tracks, ``records.Coordinates`` keeps
it, and residuals come back in pixels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Manifold
from mssegment.records import Camera, Coordinates, Floats

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

    manifold: Manifold
    subset_size: int
    """Tracks in an elemental subset."""
    parameters: int
    """Degrees of freedom of one motion: p in the price of a motion."""
    residual_dimension: int
    """Dimension c of the residual of one track, in the likelihood of a track."""

    @abstractmethod
    def coordinates(self, points: Floats, camera: Camera | None) -> Coordinates:
        """The coordinates in which this model sees the tracks ``points`` [P, F, 2] (pixels)."""

    def observe(self, points: Floats, coordinates: Coordinates) -> Floats:
        """The tracks [P, F, 2] in the model's coordinates."""
        return np.asarray((points - coordinates.centres) / coordinates.scale)

    @abstractmethod
    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Hypotheses of the elemental subsets [B, k, F, 2]: points [B, ...] and which are sound.

        Degenerate and absurd subsets are False in the second array; their points are arbitrary.
        """

    @abstractmethod
    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least-squares motions of the tracks [P, F, 2] under the weights [B, P]; as above."""

    @abstractmethod
    def residuals(self, points: Floats, observed: Floats, coordinates: Coordinates) -> Floats:
        """Distances in pixels (per frame) of the tracks [P, F, 2] from the motions, [B, P]."""

    @abstractmethod
    def algebraic_residuals(self, points: Floats, observed: Floats) -> Floats:
        """|M(p_i)| of equations (23) and (24), [B, P], in the units of the paper's table."""

    @abstractmethod
    def free_extent(self, observed: Floats, coordinates: Coordinates) -> float:
        """Natural log of the extent (pixels) along which a motion leaves a track free.

        The part of a track's description that a motion does not predict, coded as uniform: zero
        for affine and homography, the epipolar line for translation.
        """
