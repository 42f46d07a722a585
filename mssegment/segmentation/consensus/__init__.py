"""Consensus: tracks that fit the same hypotheses belong together.

``draw_consensus_sets`` draws the hypotheses, ``cluster_by_consensus`` reads them and nothing else;
``segment_by_consensus`` adds motions and modes.
"""

from mssegment.segmentation.consensus.clustering import Consensus, cluster_by_consensus
from mssegment.segmentation.consensus.drawing import draw_consensus_sets
from mssegment.segmentation.consensus.segment import (
    AUTO_FRAMES,
    drawn_for_consensus,
    is_long,
    segment_by_consensus,
    uses_consensus,
)

__all__ = [
    "AUTO_FRAMES",
    "Consensus",
    "cluster_by_consensus",
    "draw_consensus_sets",
    "drawn_for_consensus",
    "is_long",
    "segment_by_consensus",
    "uses_consensus",
]
