"""Checks between stages, and the result if nothing moves.

Documents may be edited by hand. Errors that would otherwise appear deep in the mathematics are
reported here in one line.
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

ADVICE = "run `mssegment hypothesize` again"


def check_kind(pictures: bool, names: Sequence[str]) -> None:
    """Check that the models are for this kind of data: positions in pictures, or other data.

    Raises
    ------
    ConfigurationError
        If they are for the other kind.
    """
    wrong = [name for name in names if models.class_named(name).of_pictures != pictures]
    if not wrong:
        return
    able = models.of_pictures() if pictures else models.of_data()
    if pictures:
        raise ConfigurationError(
            f"hypothesize.model is {wrong[0]}, which is for data that is no picture, but these are "
            f"tracks in pictures: choose {' or '.join(able)}, or import the file with --points"
        )
    raise ConfigurationError(
        f"hypothesize.model is {' and '.join(wrong)} for tracks in pictures, but this is data that "
        f"is no picture: choose {' or '.join(able)} (--model)"
    )


def check_selection(selection: str) -> None:
    """Check that a selection of motions is one of data that is no picture too.

    Raises
    ------
    ConfigurationError
        If it is not.
    """
    if selection != "mdl":
        raise ConfigurationError(
            f"segment.selection is {selection}, which is for tracks in pictures; use mdl for data "
            "that is no picture"
        )


def nothing_moves(status: Integers, names: Sequence[str]) -> bool:
    """Whether too few tracks remain for a hypothesis after the background is removed.

    Parameters
    ----------
    status : ndarray [P] of int
        ``BACKGROUND``, or ``OUTLIER`` for tracks to segment.
    names : sequence of str
        Names of the models.
    """
    least = min(models.make(name, frames=3).subset_size for name in names)
    moving = int((status == OUTLIER).sum())
    return bool((status == BACKGROUND).any()) and moving <= least


def no_motion(status: Integers) -> ClusterResult:
    """The segmentation without motions, in which every track keeps its status."""
    return ClusterResult(
        labels=status,
        modes=(),
        motions=(),
        bandwidths=(),
        residuals=np.zeros((0, len(status))),
    )


def check_sets(sets: Sequence[HypothesisSet]) -> None:
    """Check that model, manifold, frames and points of each set agree.

    Raises
    ------
    DataError
        With the index of the first set that is invalid.
    """
    for i, hypotheses in enumerate(sets):
        try:
            models.of_set(hypotheses)
        except (DataError, ConfigurationError) as error:
            raise DataError(f"sets[{i}]: {error}; {ADVICE}") from None


def check_method(method: str, strategy: Strategy) -> None:
    """Check that ``cluster.method`` agrees with the strategy of the hypotheses.

    Raises
    ------
    ConfigurationError
        If it does not.
    """
    if method != "auto" and (method == "consensus") != (strategy == "consensus"):
        raise ConfigurationError(
            f"cluster.method is {method}, but the hypotheses were drawn for strategy {strategy}: "
            f"run `mssegment hypothesize --method {method}`, or leave cluster.method at auto"
        )
