"""What a set of hypotheses sees of the tracks."""

from __future__ import annotations

import numpy as np

from mssegment.models.evidence import EVIDENCE
from mssegment.records import Floats, HypothesisSet, Integers


def observe(points: Floats, entry: HypothesisSet) -> tuple[Integers, Floats]:
    """The tracks that are seen in all frames of a set, and what the set sees of them."""
    tracks = points[:, entry.frames]
    seen = np.flatnonzero(np.isfinite(tracks).all(axis=(1, 2)))
    where = entry.normalization
    return seen, np.asarray((tracks[seen] - where.centres) / where.scale)


def residuals_of(points: Floats, entry: HypothesisSet) -> tuple[Integers, Floats]:
    """Tracks [n] that a set sees and their squared residuals [n, hypotheses], coordinates."""
    seen, observed = observe(points, entry)
    return seen, EVIDENCE[entry.model].squared_residuals(entry.points, observed)
