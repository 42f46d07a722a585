"""From hypotheses to motions: ``cluster``; selections by name in ``SELECTIONS``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mssegment.errors import DataError, UsageError
from mssegment.records import OUTLIER, Floats, HypothesisSet, Integers, Segmentation
from mssegment.sampling.strategy import drawn_for_consensus, is_long
from mssegment.segmentation.dominant_modes import dominance as dominant_modes
from mssegment.segmentation.mdl import mdl as shortest_description
from mssegment.segmentation.mode_based import segment_by_modes
from mssegment.segmentation.selection import Granularity, Selection

__all__ = ["SELECTIONS", "cluster"]

SELECTIONS: dict[str, Selection] = {
    "mdl": shortest_description,
    "dominance": dominant_modes,
}
"""How modes become motions; a further selection is a line here."""


def cluster(
    points: Floats,
    sets: Sequence[HypothesisSet],
    *,
    status: Integers | None = None,
    bandwidth: float | Literal["auto"] = "auto",
    kernel: str = "gaussian",
    method: str = "auto",
    selection: str = "mdl",
    motions: int | Literal["auto"] = "auto",
    min_motions: int = 0,
    granularity: Granularity = "object",
    rng: np.random.Generator | None = None,
    threads: int = 1,
) -> Segmentation:
    """Segments the tracks ``points`` [P, F, 2] (pixels) by the hypotheses in ``sets``.

    ``status`` [P] is 0 for tracks to label, else the label they keep (background). ``bandwidth`` is
    in the distance of the manifold, ``auto`` by nearest neighbours. ``motions`` is their number,
    where it is known. The labels do not depend on ``threads``.

    Raises DataError where the hypotheses do not fit the tracks, UsageError for an unknown
    ``selection`` or ``method``.
    """
    if selection not in SELECTIONS:
        known = " or ".join(SELECTIONS)
        raise UsageError(f"segment.selection: {selection!r} is unknown; choose {known}")
    if method not in ("auto", "meanshift", "consensus"):
        raise UsageError(f"cluster.method: {method!r} is unknown; choose meanshift or consensus")
    if not sets:
        raise DataError("there are no hypotheses to cluster: run hypothesize")
    status = np.full(len(points), OUTLIER) if status is None else status
    count = None if motions == "auto" else motions
    rng = np.random.default_rng(0) if rng is None else rng
    if method == "consensus" or (method == "auto" and drawn_for_consensus(sets)):
        from mssegment.segmentation.consensus import segment_by_consensus

        return segment_by_consensus(
            points,
            sets,
            status=status,
            bandwidth=bandwidth,
            kernel=kernel,
            motions=count,
            min_motions=min_motions,
            rng=rng,
        )
    select = SELECTIONS[selection]
    if selection == "mdl" and is_long(sets):
        from mssegment.segmentation.mixture import mixture as select
    return segment_by_modes(
        points,
        sets,
        select=select,
        status=status,
        bandwidth=bandwidth,
        kernel=kernel,
        motions=count,
        min_motions=min_motions,
        granularity=granularity,
        rng=rng,
        threads=threads,
    )
