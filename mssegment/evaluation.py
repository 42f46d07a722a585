"""Evaluation of a segmentation: confusion matrix, misclassification, residual errors (23), (24).

The misclassification is 1 - correct / counted. A track is correct if its found motion is matched to
its true motion by the best one-to-one matching, or if it is a true outlier labelled as an outlier.
Tracks that are not judged, tracks whose true label is ignored, and true outliers labelled as
background are not counted. A track of a true motion that is labelled as background is an error.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import BACKGROUND, IGNORED, NOT_JUDGED, OUTLIER, Floats, Integers, Record
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
    """

    misclassification: float
    counted: int
    confusion: Integers
    true_motions: tuple[int, ...]
    found_motions: tuple[int, ...]
    matching: dict[int, int]


def is_counted(found: Integers, truth: Integers) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which tracks are counted, from their found and true labels [P]."""
    return np.asarray(
        (found != NOT_JUDGED) & (truth != IGNORED) & ~((truth == OUTLIER) & (found == BACKGROUND))
    )


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


def evaluate(found: Integers, truth: Integers) -> Evaluation:
    """Compare the found labels with the true labels.

    Parameters
    ----------
    found : ndarray [P] of int64
        1..m for a motion, 0 outlier, -1 background, -2 not judged.
    truth : ndarray [P] of int64
        1..n for a motion, 0 outlier, ``IGNORED`` for tracks that are not counted.

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
    keep = is_counted(found, truth)
    found, truth = found[keep], truth[keep]
    matching = match_labels(found, truth)
    true_motions = [int(t) for t in distinct(truth[truth > 0])]
    back = {t: f for f, t in matching.items()}
    found_motions = [back[t] for t in true_motions if t in back]
    found_motions += [int(f) for f in distinct(found[found > 0]) if int(f) not in matching]
    # matched motions come first, so that they are on the diagonal
    true_motions.sort(key=lambda t: t not in back)
    confusion = _confusion(found, truth, found_motions, true_motions)
    right = sum(int(((found == f) & (truth == t)).sum()) for f, t in matching.items())
    right += int(((found == OUTLIER) & (truth == OUTLIER)).sum())
    counted = int(keep.sum())
    return Evaluation(
        misclassification=1.0 - right / counted if counted else 0.0,
        counted=counted,
        confusion=confusion,
        true_motions=tuple(true_motions),
        found_motions=tuple(found_motions),
        matching=matching,
    )


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
