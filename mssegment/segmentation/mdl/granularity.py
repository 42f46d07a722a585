"""How large a misfit is still noise: the meaning of ``segment.granularity``.

A motion that predicts points (affine, homography) is exact only for a plane. An object that is not
flat has parallax, which grows with its displacement. Whether parallax is noise (``object``) or
makes two motions (``surface``) is an option. Motions that leave parallax free (translation,
factorization) do not need it. Over two views the scales are relative to the noise that was measured
in the matches, otherwise to lengths in the tracks, so that an image of twice the size has the same
labels.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import MotionModel
from mssegment.records import Floats, Integers
from mssegment.segmentation.options import Granularity

MIN_SCALE = 1e-6
"""Smallest scale in pixels, so that coincident tracks do not cause a division by zero."""
NOISE_SCALES = (1.16, 5.8)
"""Floor and cap of the scale of a motion that predicts points, over the measured noise: a plane is
no better than the noise, and no real surface is exactly planar."""
SURFACE_SCALES = (0.00125, 0.006)
"""Floor and cap of the scale of a motion that predicts points, relative to the diagonal of the
bounding box of the tracks: 1 to 5 pixels in 640 x 480. No real surface is exactly planar."""
AFFINE_CAMERA_SCALES = (0.0003, 0.001)
"""The same for motions that leave parallax free under an affine camera, an approximation."""
CALIBRATED_SCALES = (0.00007, 0.001)
"""The same for a calibrated camera: the noise of corners, from a good tracker to a matcher."""
PARALLAX_SHARE = 0.03
"""Parallax within an object that is noise, relative to its displacement."""


FLAT_SCALE = 0.0009
"""Scale below which surfaces count as flat, relative to the same diagonal: ``auto`` chooses
``surface`` below it (walls) and ``object`` above, where patches are not quite planar."""


def suggest(scales: Floats, inliers: Integers, points: Floats) -> Granularity:
    """Suggest ``surface`` if the surfaces found are flat, otherwise ``object``.

    Parameters
    ----------
    scales : ndarray [m]
        Scales in pixels of the homographies that were found with granularity ``surface``.
    inliers : ndarray [m] of int
        Number of inliers of each.
    points : ndarray [P, F, 2]
        The tracks in pixels.

    Returns
    -------
    {"surface", "object"}
    """
    if not inliers.sum():
        return "object"
    mean = float((scales * inliers).sum() / inliers.sum())
    return "surface" if mean < FLAT_SCALE * diagonal(points) else "object"


def diagonal(points: Floats) -> float:
    """Diagonal of the bounding box of the points [P, F, 2], in pixels."""
    return float(np.hypot(*np.ptp(points.reshape(-1, 2), axis=0))) if len(points) else 1.0


def scale_range(
    points: Floats,
    predicts_points: bool,
    calibrated: bool = False,
    *,
    flat: bool = False,
    noise: float = float("nan"),
) -> tuple[float, float]:
    """Smallest and largest scale of the residuals of a motion, in pixels.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels.
    predicts_points : bool
        Whether the model predicts points.
    calibrated : bool
        Whether the camera is calibrated.
    flat : bool
        Whether motions are those of planes under perspective, which nothing but noise makes
        inexact. The scales of others are at most those relative to the extent of the tracks.
    noise : float
        The noise in pixels, NaN where it is not known.
    """
    extent = diagonal(points)
    relative = (
        SURFACE_SCALES
        if predicts_points
        else CALIBRATED_SCALES
        if calibrated
        else AFFINE_CAMERA_SCALES
    )
    floor, cap = relative[0] * extent, relative[1] * extent
    if predicts_points and np.isfinite(noise):
        own = NOISE_SCALES[0] * noise, NOISE_SCALES[1] * noise
        floor, cap = own if flat else (min(floor, own[0]), min(cap, own[1]))
    return max(floor, MIN_SCALE), max(cap, MIN_SCALE)


def maps_the_plane(model: MotionModel) -> bool:
    """Whether motions are 3 x 3 matrices that map points of the first frame."""
    return not model.leaves_parallax_free and model.manifold.point_shape == (3, 3)


def parallax_noise(points: Floats, granularity: Granularity, predicts_points: bool) -> Floats:
    """Misfit of each track [P, F, 2] that is due to parallax within its object, in pixels [P]."""
    displacement = np.linalg.norm(points - points[:, :1], axis=-1).max(axis=1)
    share = PARALLAX_SHARE if granularity != "surface" and predicts_points else 0.0
    return np.asarray(share * displacement)
