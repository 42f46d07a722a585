"""Rigid motion of the picture plane: rotation and translation, a point of SE(2)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.manifolds import SE2
from mssegment.models.similarity import Similarity


class Rigid2D(Similarity):
    """x2 = R x1 + t; an elemental subset is two matches, the residual is the transfer error.

    The paper names SE(2) among its examples (section 5.5). Two matches are one equation more than
    three parameters need.
    """

    name: ClassVar[str] = "rigid2d"
    purpose: ClassVar[str] = "objects that turn and move in a plane parallel to the image"

    def __init__(self) -> None:
        super().__init__()
        self.manifold = SE2()
        self.parameters = 3

    def restricted(self, factors: np.ndarray) -> np.ndarray:
        """The factors [B] with magnitude 1: the least-squares rotations."""
        return np.asarray(factors / np.maximum(np.abs(factors), 1e-300))
