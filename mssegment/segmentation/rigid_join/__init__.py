"""Motions that one epipolar geometry holds together are one rigid body.

- ``epipoles``: how likely the parallax of several groups is, over all directions of the epipole;
- ``residuals``: the noise about the epipolar geometries of the groups;
- ``bodies``: which groups one epipole explains better than epipoles of their own.
"""

from mssegment.segmentation.rigid_join.bodies import MIN_MATCHES, pair_evidence, rigid_bodies

__all__ = ["MIN_MATCHES", "pair_evidence", "rigid_bodies"]
