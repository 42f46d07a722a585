"""Shortcuts for tests: hypotheses of a model by name, motions from sets of hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mssegment import models, segmentation
from mssegment.models import Flags
from mssegment.records import Camera, ClusterResult, Floats, Hypotheses, HypothesisSet, Integers
from mssegment.sampling.elemental_subsets import hypothesize as draw
from mssegment.sampling.options import SamplingOptions
from mssegment.segmentation import SegmentOptions


def hypothesize(
    points: Floats,
    *,
    model: str = "affine",
    camera: Camera | None = None,
    eligible: Flags | None = None,
    rng: np.random.Generator,
    **options: Any,
) -> list[HypothesisSet]:
    """The sets of ``model``, ``auto`` for all that suit the number of frames."""
    sampling = SamplingOptions(model, **options)
    names = models.automatic(points.shape[1]) if model == "auto" else (model,)
    return draw(points, models=names, options=sampling, camera=camera, eligible=eligible, rng=rng)


def cluster(
    points: Floats,
    hypotheses: Hypotheses | Sequence[HypothesisSet],
    *,
    status: Integers | None = None,
    rng: np.random.Generator | None = None,
    **options: Any,
) -> ClusterResult:
    """The segmentation; the strategy of bare sets is ``modes``."""
    if not isinstance(hypotheses, Hypotheses):
        hypotheses = Hypotheses("modes", tuple(hypotheses))
    return segmentation.cluster(
        points,
        hypotheses,
        status=status,
        options=SegmentOptions(**options),
        rng=np.random.default_rng(0) if rng is None else rng,
    )
