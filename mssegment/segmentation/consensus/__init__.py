"""Consensus: tracks that fit the same hypotheses belong together.

``sampling.frame_pairs.draw_for_consensus`` samples the hypotheses, ``cluster_by_consensus`` groups
the tracks, and ``segment_by_consensus`` adds motions and modes.
"""

from mssegment.segmentation.consensus.clustering import Consensus, cluster_by_consensus
from mssegment.segmentation.consensus.segment import segment_by_consensus

__all__ = [
    "Consensus",
    "cluster_by_consensus",
    "segment_by_consensus",
]
