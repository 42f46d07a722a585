"""Hyperplanes of R^d: linear regression with errors in all variables."""

from __future__ import annotations

from typing import ClassVar

from mssegment.models.affine_flat import AffineFlat


class Hyperplane(AffineFlat):
    """n'x = c in any dimension: a line among points of the plane, a plane among points of space.

    An elemental subset is d points. Errors may be in every coordinate (total least squares); for
    the regression of y on x, the points are (x, y).
    """

    name: ClassVar[str] = "hyperplane"
    purpose: ClassVar[str] = "linear relations in a table: several regressions at once"

    def __init__(self, dimension: int) -> None:
        super().__init__(dimension, dimension - 1)

    @classmethod
    def build(cls, frames: int, rank: int, dimension: int = 2) -> Hyperplane:
        """Hyperplanes of R^``dimension``."""
        del frames, rank
        return cls(dimension)
