"""Evaluation of a segmentation: confusion matrix, misclassification, residual errors (23), (24).

The misclassification is 1 - correct / counted. A track is correct if its found motion is matched to
its true motion by the best one-to-one matching, or if it is a true outlier labelled as an outlier.
Tracks that are not judged, tracks whose true label is ignored, and true outliers labelled as
background are not counted. A track of a true motion that is labelled as background is an error.

In masks and in many labels, 0 is not an outlier but whatever is no object. Then the static world is
right there: the background, or the motion of the camera (``find_world``).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from mssegment.records import (
    BACKGROUND,
    IGNORED,
    NOT_JUDGED,
    OUTLIER,
    Floats,
    Integers,
    Record,
    field,
)
from mssegment.special import distinct


class Evaluation(Record, frozen=True):
    """The comparison of a segmentation with the ground truth.

    Attributes
    ----------
    misclassification : float
        The fraction of wrong tracks, 0 to 1.
    counted : int
        The number of tracks that are counted.
    confusion : ndarray [true + 1, found + 1] of int64
        Numbers of tracks, with true motions as rows and found motions as columns, outliers last.
        Rows and columns are ordered so that the best one-to-one matching is on the diagonal.
    true_motions, found_motions : tuple of int
        The labels of rows and columns, without the outliers.
    matching : dict of int to int
        The best one-to-one matching, found label to true label.
    world : int or None
        The found label that counts as the true label 0, which is then no outlier: ``BACKGROUND`` or
        a motion. That motion is the last of ``found_motions``.
    iou : dict of int to float
        Of each true motion, the tracks in it and in the matched motion over those in either; 0
        without a matched motion.
    adjusted_rand : float
        The adjusted Rand index (Hubert & Arabie 1985) of the two partitions of the counted tracks;
        1 if they are equal, about 0 for chance.
    """

    misclassification: float
    counted: int
    confusion: Integers
    true_motions: tuple[int, ...]
    found_motions: tuple[int, ...]
    matching: dict[int, int]
    world: int | None = None
    iou: dict[int, float] = field(default_factory=dict)
    adjusted_rand: float = 1.0


def is_counted(
    found: Integers, truth: Integers, world: int | None = None
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which tracks are counted, from their found and true labels [P]; ``world`` as in evaluate."""
    counted = (found != NOT_JUDGED) & (truth != IGNORED)
    if world is None:
        counted &= ~((truth == OUTLIER) & (found == BACKGROUND))
    return np.asarray(counted)


def is_correct(
    found: Integers, truth: Integers, matching: dict[int, int], world: int | None = None
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which tracks are correct, from their found and true labels [P]."""
    right = (found == OUTLIER) & (truth == OUTLIER)
    if world is not None:
        right |= np.isin(found, [world, BACKGROUND]) & (truth == OUTLIER)
    for f, t in matching.items():
        right |= (found == f) & (truth == t)
    return np.asarray(right)


def find_world(
    found: Integers,
    truth: Integers,
    camera_motion: int | None = None,
    rule: Literal["auto", "none", "motion"] = "auto",
) -> int | None:
    """Which found label is right where the true label is 0.

    Parameters
    ----------
    found, truth : ndarray [P] of int64
        The found and the true label of each track.
    camera_motion : int, optional
        The found label of the static world under a moving camera.
    rule : {"auto", "none", "motion"}
        ``none``: 0 is an outlier. ``auto``: 0 is the static world if most of the tracks with this
        label were found to be the background or the camera's motion. ``motion``: 0 is the
        background or a motion, the one that most of these tracks were found to be.

    Returns
    -------
    int or None
        ``BACKGROUND``, the label of a motion, or None if 0 is an outlier.
    """
    own = found[(truth == OUTLIER) & (found != NOT_JUDGED)]
    if rule == "none" or not len(own):
        return None
    labels, counts = np.unique(own[own != OUTLIER] if rule == "motion" else own, return_counts=True)
    if not len(labels):
        return None
    most = int(labels[counts.argmax()])
    if rule == "motion" or most in (BACKGROUND, camera_motion):
        return most
    return None


def match_labels(found: Integers, truth: Integers) -> dict[int, int]:
    """The one-to-one matching of found to true motions with the most tracks in common.

    Parameters
    ----------
    found, truth : ndarray [P] of int64
        The found and the true label of each track.

    Returns
    -------
    dict of int to int
        Found label to true label.
    """
    found_motions, true_motions = distinct(found[found > 0]), distinct(truth[truth > 0])
    pairs = best_pairs(_overlap(found, truth, found_motions, true_motions))
    return {int(found_motions[i]): int(true_motions[j]) for i, j in pairs}


def best_pairs(gain: Integers) -> list[tuple[int, int]]:
    """The assignment of rows to columns with the largest sum of ``gain``.

    Parameters
    ----------
    gain : ndarray [m, n] of int64
        The gain of each pair.

    Returns
    -------
    list of (int, int)
        min(m, n) pairs (row, column), sorted by row.
    """
    if len(gain) > gain.shape[1]:
        return sorted((i, j) for j, i in best_pairs(gain.T))
    best = gain.argmax(axis=1) if gain.size else np.zeros(0, dtype=np.int64)
    if len(distinct(best)) == len(best):
        # the usual case: the best columns are distinct, and scipy.optimize need not be imported
        return list(enumerate(best.tolist()))
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(-gain)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def misclassification(found: Integers, truth: Integers) -> float:
    """The fraction of misclassified tracks.

    Parameters
    ----------
    found, truth : ndarray [P] of int64
        The found and the true label of each track, as in the segmentation document.

    Returns
    -------
    float
        From 0 to 1; 0 if no track is counted.

    Raises
    ------
    ValueError
        If the two arrays differ in length.

    Examples
    --------
    >>> import numpy as np
    >>> misclassification(np.array([2, 2, 1, 0]), np.array([1, 1, 1, 0]))
    0.25
    """
    return evaluate(found, truth).misclassification


def evaluate(found: Integers, truth: Integers, world: int | None = None) -> Evaluation:
    """Compare the found labels with the true labels.

    Parameters
    ----------
    found : ndarray [P] of int64
        1..m for a motion, 0 outlier, -1 background, -2 not judged.
    truth : ndarray [P] of int64
        1..n for a motion, 0 outlier, ``IGNORED`` for tracks that are not counted.
    world : int, optional
        The found label of the static world, where the true label 0 stands for it and not for
        outliers (``find_world``). Outliers are right there too: they are no object.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        If the two arrays differ in length.
    """
    if found.shape != truth.shape:
        raise ValueError(f"{len(found)} found labels, but {len(truth)} true labels")
    keep = is_counted(found, truth, world)
    found, truth = found[keep], truth[keep]
    objects = found if world is None else np.where(found == world, BACKGROUND, found)
    matching = match_labels(objects, truth)
    true_motions = [int(t) for t in distinct(truth[truth > 0])]
    back = {t: f for f, t in matching.items()}
    found_motions = [back[t] for t in true_motions if t in back]
    found_motions += [int(f) for f in distinct(found[found > 0]) if int(f) not in matching]
    # matched motions come first, so that they are on the diagonal, and the world last
    true_motions.sort(key=lambda t: t not in back)
    found_motions.sort(key=lambda f: f == world)
    confusion = _confusion(found, truth, found_motions, true_motions)
    right = int(is_correct(found, truth, matching, world).sum())
    counted = int(keep.sum())
    overlaps = {t: _iou(found == back.get(t, NOT_JUDGED), truth == t) for t in true_motions}
    merged = found if world is None else np.maximum(objects, OUTLIER)
    return Evaluation(
        misclassification=1.0 - right / counted if counted else 0.0,
        counted=counted,
        confusion=confusion,
        true_motions=tuple(true_motions),
        found_motions=tuple(found_motions),
        matching=matching,
        world=world,
        iou=overlaps,
        adjusted_rand=adjusted_rand(merged, truth),
    )


def adjusted_rand(first: Integers, second: Integers) -> float:
    """The adjusted Rand index of two partitions [n] of the same things.

    Hubert & Arabie, "Comparing partitions", Journal of Classification 1985. 1 for equal partitions,
    0 on average for independent ones; 1 for fewer than two things.

    Examples
    --------
    >>> import numpy as np
    >>> adjusted_rand(np.array([0, 0, 1, 1]), np.array([7, 7, 3, 3]))
    1.0
    """
    table = _overlap(first, second, distinct(first), distinct(second)).astype(np.float64)
    pairs = float((table * (table - 1)).sum() / 2)
    rows, columns = (
        float((sums * (sums - 1)).sum() / 2) for sums in (table.sum(axis=1), table.sum(axis=0))
    )
    every = len(first) * (len(first) - 1) / 2
    expected = rows * columns / every if every else 0.0
    most = (rows + columns) / 2
    return 1.0 if most == expected else (pairs - expected) / (most - expected)


def _iou(
    one: np.ndarray[tuple[int], np.dtype[np.bool_]],
    other: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> float:
    """Intersection over union of two sets of tracks [P]; 0 if both are empty."""
    union = int((one | other).sum())
    return int((one & other).sum()) / union if union else 0.0


def residual_errors(residuals: Floats, truth: Integers, label: int) -> float:
    """The mean squared residual over the true inliers of a motion, equations (23) and (24).

    Parameters
    ----------
    residuals : ndarray [P] of float64
        Residual of each track: from the found motion for (23), from the least-squares motion of
        the true inliers for (24).
    truth : ndarray [P] of int64
        The true label of each track.
    label : int
        The true motion.

    Returns
    -------
    float
        In the squared units of the residuals; NaN if the motion has no inliers.
    """
    inliers = truth == label
    return float(np.mean(residuals[inliers] ** 2)) if inliers.any() else float("nan")


def _overlap(found: Integers, truth: Integers, rows: Integers, columns: Integers) -> Integers:
    return np.asarray(
        ((found[:, None] == rows).astype(np.int64)).T @ (truth[:, None] == columns), dtype=np.int64
    )


def _confusion(
    found: Integers, truth: Integers, found_motions: list[int], true_motions: list[int]
) -> Integers:
    # the last column counts the tracks in no found motion, including the background
    found = np.where(found > 0, found, OUTLIER)
    rows = np.array([*true_motions, OUTLIER])
    columns = np.array([*found_motions, OUTLIER])
    return _overlap(truth, found, rows, columns)
