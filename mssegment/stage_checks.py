"""What must hold between a stage and the one before it, and the answer where nothing moves.

Documents may be edited by hand; what the mathematics would trip over is said here in one line.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.manifolds import from_name
from mssegment.records import BACKGROUND, HypothesisSet, Integers, Segmentation

AGAIN = "run `mssegment hypothesize` again"


def nothing_moves(status: Integers, model: str) -> bool:
    """Whether, once the background is removed, too few tracks are left for one hypothesis."""
    least = models.make("affine" if model == "auto" else model, frames=3).subset_size
    left = int((status == 0).sum())
    return bool((status == BACKGROUND).any()) and left <= least


def no_motion(status: Integers) -> Segmentation:
    """The segmentation in which every track keeps its status and there is no motion."""
    return Segmentation(
        labels=status,
        modes=(),
        motions=(),
        bandwidths=(),
        residuals=np.zeros((0, len(status))),
    )


def check_sets(sets: Sequence[HypothesisSet]) -> None:
    """Raises DataError for a set whose model, manifold, frames and points do not fit together."""
    for i, chosen in enumerate(sets):
        frames, shape = len(chosen.frames), chosen.points.shape
        if chosen.model in models.MODELS:
            model = models.MODELS[chosen.model]
            if frames < model.min_frames or frames > (model.max_frames or frames):
                raise DataError(f"sets[{i}]: model {model.name} over {frames} frames; {AGAIN}")
            expected = models.make(model.name, frames=frames, rank=_rank(shape)).manifold.name
        else:
            from mssegment.models.evidence import EVIDENCE

            if chosen.model not in EVIDENCE:
                known = ", ".join(models.MODELS | EVIDENCE)
                found = f"no model is called {chosen.model!r}"
                raise DataError(f"sets[{i}]: {found}; known are {known}")
            expected = EVIDENCE[chosen.model].manifold(frames)
        if chosen.manifold != expected:
            raise DataError(
                f"sets[{i}]: model {chosen.model} over {frames} frames lives on {expected}, "
                f"found {chosen.manifold}; {AGAIN}"
            )
        if len(chosen.points) and shape[1:] != from_name(expected).point_shape:
            found = " x ".join(str(n) for n in shape[1:])
            raise DataError(f"sets[{i}]: points are {found}, that is not on {expected}; {AGAIN}")


def _rank(shape: tuple[int, ...]) -> int:
    """The rank of a factorization, from the shape of its points; 3 where they have none."""
    return shape[-1] if len(shape) == 3 and shape[-1] in (3, 4) else 3
