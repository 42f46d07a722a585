"""Straight lines in the plane, in space, or in R^d."""

from __future__ import annotations

from typing import ClassVar

from mssegment.models.affine_flat import AffineFlat


class Line(AffineFlat):
    """A straight line of R^d; an elemental subset is two points."""

    name: ClassVar[str] = "line"
    purpose: ClassVar[str] = "straight lines among points of the plane or of space"

    def __init__(self, dimension: int) -> None:
        super().__init__(dimension, 1)

    @classmethod
    def build(cls, frames: int, rank: int, dimension: int = 2) -> Line:
        """Lines of R^``dimension``."""
        del frames, rank
        return cls(dimension)
