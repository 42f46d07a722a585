"""Selection of the paper: modes that dominate, each with its inliers, without a threshold."""

from mssegment.segmentation.dominant_modes.choice import dominance

__all__ = ["dominance"]
