"""mssegment: the independently moving things in an image pair or an image sequence.

Motion hypotheses are points on a manifold; mean shift finds the modes of their density; each
dominant mode is a motion and its inliers are its segment (Subbarao & Meer, "Nonlinear Mean Shift
for Clustering over Analytic Manifolds", CVPR 2006).
"""

__version__ = "0.1.0"
