"""Motions that one epipolar geometry holds together are one rigid body.

- ``epipoles``: how likely the parallax of several groups is, over all directions of the epipole;
- ``residuals``: the noise about the epipolar geometries of the groups;
- ``depths``: how likely the depths of several groups are those of one scene;
- ``bodies``: which groups one epipole explains better than epipoles of their own;
- ``matches``: which matches belong to a body.
"""

from mssegment.segmentation.rigid_join.bodies import MIN_MATCHES, pair_evidence, rigid_bodies
from mssegment.segmentation.rigid_join.matches import body_gains
from mssegment.segmentation.rigid_join.residuals import LEAST_GROUP

__all__ = ["LEAST_GROUP", "MIN_MATCHES", "body_gains", "pair_evidence", "rigid_bodies"]
