"""The settings of ``hypothesize`` as one record."""

from __future__ import annotations

from typing import Literal

from mssegment import models
from mssegment.records import Record

Count = int | Literal["auto"]
Sampling = Literal["local", "uniform"]


class SamplingOptions(Record, frozen=True):
    """How hypotheses are sampled.

    Attributes
    ----------
    model : str
        A name in ``models.MODELS``, or ``auto``.
    rank : int or "auto"
        Dimension of the subspaces of a model with ranks.
    count : int or "auto"
        Number of hypotheses per set.
    sampling : {"local", "uniform"}
        Whether elemental subsets are a seed and some of its neighbours, or any tracks.
    derotate : bool or "auto"
        Whether to compensate the rotation of the camera for models that assume none; ``auto`` does
        so where the matches support it (``preprocessing.rotation_compensation``).
    """

    model: str = "auto"
    rank: int | Literal["auto"] = "auto"
    count: Count = "auto"
    sampling: Sampling = "local"
    derotate: bool | Literal["auto"] = "auto"

    def models(self, frames: int, calibrated: bool = False) -> tuple[str, ...]:
        """The models to use for tracks over ``frames`` frames, before a ``calibrated`` camera."""
        if self.model == "auto":
            return models.automatic(max(frames, 2), calibrated)
        return (self.model,)


DEFAULTS = SamplingOptions()
