"""What must hold between a stage and the one before it, and the answer where nothing moves.

Documents may be edited by hand; what the mathematics would trip over is said here in one line.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.errors import ConfigurationError, DataError
from mssegment.records import (
    BACKGROUND,
    OUTLIER,
    ClusterResult,
    HypothesisSet,
    Integers,
    Strategy,
)

AGAIN = "run `mssegment hypothesize` again"


def nothing_moves(status: Integers, names: Sequence[str]) -> bool:
    """Whether, without the background, too few tracks are left for a hypothesis of ``names``."""
    least = min(models.make(name, frames=3).subset_size for name in names)
    left = int((status == OUTLIER).sum())
    return bool((status == BACKGROUND).any()) and left <= least


def no_motion(status: Integers) -> ClusterResult:
    """The segmentation in which every track keeps its status and there is no motion."""
    return ClusterResult(
        labels=status,
        modes=(),
        motions=(),
        bandwidths=(),
        residuals=np.zeros((0, len(status))),
    )


def check_sets(sets: Sequence[HypothesisSet]) -> None:
    """Raises DataError for a set whose model, manifold, frames and points do not fit together."""
    for i, hypotheses in enumerate(sets):
        try:
            models.of_set(hypotheses)
        except (DataError, ConfigurationError) as error:
            raise DataError(f"sets[{i}]: {error}; {AGAIN}") from None


def check_method(method: str, strategy: Strategy) -> None:
    """Raises ConfigurationError where ``cluster.method`` contradicts the strategy."""
    if method != "auto" and (method == "consensus") != (strategy == "consensus"):
        raise ConfigurationError(
            f"cluster.method is {method}, but the hypotheses were drawn for strategy {strategy}: "
            f"run `mssegment hypothesize --method {method}`, or leave cluster.method at auto"
        )
