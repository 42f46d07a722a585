"""Long sequences after mean shift: modes start groups of tracks, and a likelihood refines them.

Over tens of frames, perspective spreads the hypotheses of one motion, and objects that move alike
share a subspace, so that modes alone are not enough. They start the search, and they remain
evidence: tracks whose hypotheses converge to the same mode are likely to have the same motion. In
addition, groups are Student t distributions in the leading principal components of the tracks. They
are refined by hard expectation maximization and merged, the pair whose union costs least first.
"""

from mssegment.segmentation.mixture.choice import mixture

__all__ = ["mixture"]
