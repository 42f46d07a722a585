"""The shortest description of all tracks, and the motions that give it.

What a motion saves on each track (``likelihood``, ``displacement``), what the labels cost
(``labelling``), what the parameters cost (``description``); modes grown to candidates
(``candidates``), the search for the set that saves most (``search``, ``refinement``), and what the
user calls one thing (``granularity``, ``continuity``).
"""

from mssegment.segmentation.mdl.choice import mdl

__all__ = ["mdl"]
