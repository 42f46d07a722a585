"""Motion models: ``make`` builds one by name, ``MODELS`` lists them. A new model is one line."""

from __future__ import annotations

from mssegment.models.affine import Affine
from mssegment.models.base import Flags, MotionModel
from mssegment.models.factorization import Factorization
from mssegment.models.homography import Homography
from mssegment.models.translation import Translation

__all__ = ["MODELS", "Affine", "Factorization", "Flags", "Homography", "MotionModel"]
__all__ += ["Translation", "make"]

MODELS: dict[str, type[MotionModel]] = {
    model.name: model for model in (Translation, Factorization, Affine, Homography)
}
"""Name -> motion model, in the order in which a user sees them."""


def make(name: str, *, frames: int = 2, rank: int = 3) -> MotionModel:
    """The motion model ``name`` for tracks over ``frames`` frames.

    ``rank`` is the dimension k of the subspaces of ``factorization`` (3 planar, 4 general).
    Raises KeyError for an unknown name.
    """
    return MODELS[name].build(frames, rank)
