"""Hypotheses of one model in all of its ranks, pooled: subspaces of planar and general bodies."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, HypothesisSet
from mssegment.sampling.elemental_subsets import Count, Sampling, hypothesize

HYPOTHESES = 200
"""Hypotheses of each rank."""


def draw_all_ranks(
    points: Floats,
    *,
    model: str,
    count: Count,
    sampling: Sampling,
    eligible: Flags,
    rank: int | Literal["auto"],
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    """One set of hypotheses per rank (3 planar, 4 general; ``auto``: both), as ``hypothesize``.

    ``count`` is per set; ``auto`` means HYPOTHESES.
    """
    ranks = (3, 4) if rank == "auto" else (rank,)
    wanted = HYPOTHESES if count == "auto" else count
    return [
        entry
        for own in ranks
        for entry in hypothesize(
            points,
            models=(model,),
            count=wanted,
            sampling=sampling,
            eligible=eligible,
            rank=own,
            rng=rng,
        )
    ]
