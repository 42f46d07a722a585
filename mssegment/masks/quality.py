"""How good masks are: region similarity J and contour accuracy F, as DAVIS defines them.

Perazzi et al., "A benchmark dataset and evaluation methodology for video object segmentation",
CVPR 2016.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.evaluation import best_pairs
from mssegment.records import Integers, Record

Region = npt.NDArray[np.bool_]
"""[height, width]."""

IGNORED = 255
"""Value of pixels of true masks that are not judged."""
TOLERANCE = 0.008
"""Distance within which contours match, relative to the diagonal of the picture."""


class MaskQuality(Record, frozen=True):
    """The masks of one true object over the frames that have a true mask.

    Attributes
    ----------
    true : int
        The true object.
    motion : int or None
        The motion that is matched to it.
    region : float
        Mean of J over the frames.
    contour : float
        Mean of F over the frames.
    """

    true: int
    motion: int | None
    region: float
    contour: float


def mask_quality(
    found: Mapping[int, npt.NDArray[np.uint8]], truth: Mapping[int, Integers]
) -> tuple[MaskQuality, ...]:
    """Compare masks with true masks, by the best one-to-one matching of motions to objects.

    Parameters
    ----------
    found : mapping of int to ndarray [h, w] of uint8
        Masks by the index of their frame: 0 no object, 1, 2, ... motions, 255 not known.
    truth : mapping of int to ndarray [h, w] of int64
        True masks of the same frames: 0 no object, 1, 2, ... objects, 255 not judged.

    Returns
    -------
    tuple of MaskQuality
        For each true object.
    """
    frames = [frame for frame in sorted(truth) if frame in found]
    objects = _values([truth[frame] for frame in frames])
    motions = _values([found[frame] for frame in frames])
    scores = np.zeros((len(objects), len(motions), len(frames), 2))
    for k, frame in enumerate(frames):
        judged = truth[frame] != IGNORED
        for i, label in enumerate(objects):
            own = truth[frame] == label
            for j, motion in enumerate(motions):
                # what is not judged is right, whatever it is
                mask = np.where(judged, found[frame] == motion, False)
                scores[i, j, k] = (
                    region_similarity(mask, own),
                    contour_accuracy(
                        found[frame] == motion, np.where(judged, own, found[frame] == motion)
                    ),
                )
    means = scores.mean(axis=2) if frames else scores[:, :, 0]
    partner = dict(best_pairs(np.round(1e6 * means[..., 0]).astype(np.int64)))
    return tuple(
        MaskQuality(label, motions[partner[i]], *(float(v) for v in means[i, partner[i]]))
        if i in partner
        else MaskQuality(label, None, 0.0, 0.0)
        for i, label in enumerate(objects)
    )


def _values(masks: list[npt.NDArray[np.integer]]) -> list[int]:
    """The values of objects in some masks."""
    values = set().union(*(np.unique(mask).tolist() for mask in masks))
    return sorted(values - {0, IGNORED})


def region_similarity(found: Region, truth: Region) -> float:
    """J: intersection over union of two regions; 1 if both are empty.

    Examples
    --------
    >>> region_similarity(np.array([[True, True]]), np.array([[True, False]]))
    0.5
    """
    union = int((found | truth).sum())
    return int((found & truth).sum()) / union if union else 1.0


def contour_accuracy(found: Region, truth: Region) -> float:
    """F: harmonic mean of precision and recall of the contour; 1 if both are empty."""
    ours, theirs = _contour(found), _contour(truth)
    if not ours.any() or not theirs.any():
        return float(ours.any() == theirs.any())
    reach = int(np.ceil(TOLERANCE * np.hypot(*found.shape)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    near_ours, near_theirs = (
        cv2.dilate(line.astype(np.uint8), disc) > 0 for line in (ours, theirs)
    )
    precision, recall = (
        (ours & near_theirs).sum() / ours.sum(),
        (theirs & near_ours).sum() / theirs.sum(),
    )
    return float(2 * precision * recall / (precision + recall)) if precision + recall else 0.0


def _contour(region: Region) -> Region:
    """The pixels that differ from the right, the lower or the lower right neighbour."""
    padded = np.pad(region, ((0, 1), (0, 1)), mode="edge")
    here = padded[:-1, :-1]
    return np.asarray(
        (here != padded[:-1, 1:]) | (here != padded[1:, :-1]) | (here != padded[1:, 1:])
    )
