"""Long sequences after mean shift: modes, then groups, then a likelihood that refines them.

Over tens of frames one body's perspective spreads its hypotheses, and bodies that move alike share
a subspace, so modes alone say too little. They start the search, and they stay evidence: tracks
whose hypotheses climb to the same mode are likely to be of one body. Beside that, groups are
Student-t clouds in the leading principal components of the tracks, refined by hard expectation
maximization and merged, the pair that costs least first.
"""

from mssegment.segmentation.mixture.choice import mixture

__all__ = ["mixture"]
