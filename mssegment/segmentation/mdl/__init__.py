"""Selection by minimum description length.

- ``likelihood``, ``displacement``: what a motion saves on each track;
- ``labelling``, ``contact``: what the labels cost;
- ``degrees``, ``description``: what the parameters cost, and the total;
- ``candidates``: from modes to candidate motions;
- ``search``, ``refinement``, ``pieces``: the set of motions that saves most;
- ``preparation``, ``choice``, ``final_labels``: from the problem to the result;
- ``granularity``, ``continuity``: whether planar surfaces are one object;
- ``blends``: motions that are none, of matches at the border of two others.
"""

from mssegment.segmentation.mdl.choice import mdl

__all__ = ["mdl"]
