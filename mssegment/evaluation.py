"""How good a segmentation is: confusion matrix, misclassification, residual errors (23), (24).

Misclassification = 1 - right / counted. Right are the tracks on the best one-to-one matching of
found to true motions, plus the true outliers that were found as outliers. Not counted are tracks
that were not judged, tracks whose true label is to be ignored, and true outliers found as
background; a track of a true motion found as background is wrong.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import BACKGROUND, IGNORED, NOT_JUDGED, OUTLIER, Floats, Integers, Record
from mssegment.special import distinct


class Evaluation(Record, frozen=True):
    """A segmentation beside the truth.

    ``confusion`` has the true motions as rows and the found ones as columns, outliers last, its
    columns ordered so that the best one-to-one matching lies on the diagonal. ``true_motions`` and
    ``found_motions`` are the labels of rows and columns (without the outliers).
    """

    misclassification: float
    counted: int
    confusion: Integers
    true_motions: tuple[int, ...]
    found_motions: tuple[int, ...]
    matching: dict[int, int]
    """Found label -> true label on the best one-to-one matching."""


def is_counted(found: Integers, truth: Integers) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which of the tracks [P] count."""
    return np.asarray(
        (found != NOT_JUDGED) & (truth != IGNORED) & ~((truth == OUTLIER) & (found == BACKGROUND))
    )


def match_labels(found: Integers, truth: Integers) -> dict[int, int]:
    """The best one-to-one matching of found motions to true ones, found label -> true label."""
    found_motions, true_motions = distinct(found[found > 0]), distinct(truth[truth > 0])
    pairs = best_pairs(_overlap(found, truth, found_motions, true_motions))
    return {int(found_motions[i]): int(true_motions[j]) for i, j in pairs}


def best_pairs(gain: Integers) -> list[tuple[int, int]]:
    """The pairs (row, column), one of each row or one of each column, whose gains sum to most."""
    if len(gain) > gain.shape[1]:
        return sorted((i, j) for j, i in best_pairs(gain.T))
    best = gain.argmax(axis=1) if gain.size else np.zeros(0, dtype=np.int64)
    if len(distinct(best)) == len(best):
        # each row has its best for itself: usual, and found without loading scipy.optimize
        return list(enumerate(best.tolist()))
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(-gain)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def misclassification(found: Integers, truth: Integers) -> float:
    """The share of wrong tracks, 0..1; 0 where no track counts.

    ``found`` and ``truth`` are label arrays [P] as in the segmentation document.
    """
    return evaluate(found, truth).misclassification


def evaluate(found: Integers, truth: Integers) -> Evaluation:
    """Compares the found labels [P] with the true labels [P].

    Raises ValueError where the two differ in length.
    """
    if found.shape != truth.shape:
        raise ValueError(f"{len(found)} found labels, but {len(truth)} true ones")
    keep = is_counted(found, truth)
    found, truth = found[keep], truth[keep]
    matching = match_labels(found, truth)
    true_motions = [int(t) for t in distinct(truth[truth > 0])]
    back = {t: f for f, t in matching.items()}
    found_motions = [back[t] for t in true_motions if t in back]
    found_motions += [int(f) for f in distinct(found[found > 0]) if int(f) not in matching]
    # a true motion without partner keeps its row; pairs come first, so they share the diagonal
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
    """Equation (23) (or (24)): the mean squared residual [P] over the true inliers of ``label``."""
    inliers = truth == label
    return float(np.mean(residuals[inliers] ** 2)) if inliers.any() else float("nan")


def _overlap(found: Integers, truth: Integers, rows: Integers, columns: Integers) -> Integers:
    return np.asarray(
        ((found[:, None] == rows).astype(np.int64)).T @ (truth[:, None] == columns), dtype=np.int64
    )


def _confusion(
    found: Integers, truth: Integers, found_motions: list[int], true_motions: list[int]
) -> Integers:
    # background counts as "found in no motion", which is what the Out column says
    found = np.where(found > 0, found, OUTLIER)
    rows = np.array([*true_motions, OUTLIER])
    columns = np.array([*found_motions, OUTLIER])
    return _overlap(truth, found, rows, columns)
