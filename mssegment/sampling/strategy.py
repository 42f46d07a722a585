"""Which way leads from tracks to motions: modes, or for long sequences consensus or clouds.

Apart from those ways, so that two pictures load neither.
"""

from __future__ import annotations

from collections.abc import Sequence

from mssegment.models import MODELS
from mssegment.records import HypothesisSet

AUTO_FRAMES = 6
"""From so many frames on, ``cluster.method: auto`` means consensus for ``factorization``. On
Hopkins155 thinned to 4-6 frames: consensus 0.0 %, modes 12-13 %; five frames stay the paper's."""


def uses_consensus(method: str, model: str, frames: int) -> bool:
    """Whether ``cluster.method`` (auto, meanshift, consensus) means consensus here."""
    if method == "auto":
        return model == "factorization" and frames >= AUTO_FRAMES
    return method == "consensus"


def is_long(sets: Sequence[HypothesisSet]) -> bool:
    """Whether all hypotheses are subspaces over so many frames that modes alone say too little."""
    return all(
        entry.model == "factorization" and len(entry.frames) >= AUTO_FRAMES for entry in sets
    )


def drawn_for_consensus(sets: Sequence[HypothesisSet]) -> bool:
    """Whether the sets are those of ``draw_consensus_sets``.

    They hold evidence that is no motion model, or are over several frame pairs.
    """
    pairs = {tuple(entry.frames) for entry in sets if len(entry.frames) == 2}
    return any(entry.model not in MODELS for entry in sets) or len(pairs) > 1
