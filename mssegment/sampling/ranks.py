"""Hypotheses of one model with ranks, in each of its ranks."""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, HypothesisSet, replace
from mssegment.sampling.elemental_subsets import hypothesize
from mssegment.sampling.options import SamplingOptions

HYPOTHESES_PER_RANK = 200


def draw_all_ranks(
    points: Floats,
    *,
    model: str,
    options: SamplingOptions,
    eligible: Flags,
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    """Sample one set of hypotheses per rank: 3 (planar) and 4 (general), or that of ``options``.

    Parameters and errors are those of ``hypothesize``. The default number of hypotheses per set is
    ``HYPOTHESES_PER_RANK``.
    """
    ranks = (3, 4) if options.rank == "auto" else (options.rank,)
    count = HYPOTHESES_PER_RANK if options.count == "auto" else options.count
    sets = []
    for rank in ranks:
        of_rank = replace(options, rank=rank, count=count)
        sets += hypothesize(points, models=(model,), options=of_rank, eligible=eligible, rng=rng)
    return sets
