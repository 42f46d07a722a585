"""Planes in space: walls and floors in a point cloud."""

from __future__ import annotations

from typing import ClassVar

from mssegment.models.affine_flat import AffineFlat


class Plane(AffineFlat):
    """ax + by + cz + d = 0; an elemental subset is three points."""

    name: ClassVar[str] = "plane"
    purpose: ClassVar[str] = "walls, floors and facades in a point cloud or range image"
    coordinates: ClassVar[int | None] = 3
    is_local: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__(3, 2)
