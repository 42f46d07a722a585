"""The stages with less to type: hypotheses by model, motions from sets of hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mssegment import models, segmentation
from mssegment.records import ClusterResult, Floats, Hypotheses, HypothesisSet, Integers
from mssegment.sampling.elemental_subsets import hypothesize as draw
from mssegment.segmentation import SegmentOptions


def hypothesize(
    points: Floats, *, model: str = "affine", rng: np.random.Generator, **options: Any
) -> list[HypothesisSet]:
    """The sets of ``model``, ``auto`` for all that suit the number of frames."""
    names = models.automatic(points.shape[1]) if model == "auto" else (model,)
    return draw(points, models=names, rng=rng, **options)


def cluster(
    points: Floats,
    hypotheses: Hypotheses | Sequence[HypothesisSet],
    *,
    status: Integers | None = None,
    rng: np.random.Generator | None = None,
    **options: Any,
) -> ClusterResult:
    """The motions; sets alone are of strategy ``modes``."""
    if not isinstance(hypotheses, Hypotheses):
        hypotheses = Hypotheses("modes", tuple(hypotheses))
    return segmentation.cluster(
        points,
        hypotheses,
        status=status,
        options=SegmentOptions(**options),
        rng=np.random.default_rng(0) if rng is None else rng,
    )
