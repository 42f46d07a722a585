"""Misclassification and the confusion matrix, by their definition and by brute force."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mssegment.evaluation import evaluate, misclassification, residual_errors
from mssegment.records import BACKGROUND, IGNORED, NOT_JUDGED

labelled = st.lists(
    st.tuples(st.integers(-2, 3), st.sampled_from([IGNORED, 0, 1, 2, 3])), min_size=1, max_size=40
)


SLOW_IMPORT = settings(deadline=None)
"""The first example imports scipy.optimize, which may take longer than the usual deadline."""


def arrays(pairs: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    found, truth = np.array(pairs, dtype=np.int64).T
    return found, truth


def by_brute_force(found: np.ndarray, truth: np.ndarray) -> float:
    counted = [
        (f, t)
        for f, t in zip(found.tolist(), truth.tolist(), strict=True)
        if f != NOT_JUDGED and t != IGNORED and not (t == 0 and f == BACKGROUND)
    ]
    if not counted:
        return 0.0
    best = 0
    for names in permutations((1, 2, 3)):
        renamed = {1: names[0], 2: names[1], 3: names[2], 0: 0, BACKGROUND: None}
        best = max(best, sum(renamed[f] == t for f, t in counted))
    return 1 - best / len(counted)


@SLOW_IMPORT
@given(labelled)
def test_misclassification_is_the_best_one_to_one_matching(pairs: list[tuple[int, int]]) -> None:
    found, truth = arrays(pairs)
    assert misclassification(found, truth) == pytest.approx(by_brute_force(found, truth))


@SLOW_IMPORT
@given(labelled, st.permutations([1, 2, 3]), st.randoms())
def test_names_of_motions_and_order_of_tracks_do_not_matter(
    pairs: list[tuple[int, int]], names: list[int], random: object
) -> None:
    found, truth = arrays(pairs)
    renamed = np.where(found > 0, np.array([0, *names])[np.maximum(found, 0)], found)
    order = np.argsort([hash((i, names[0])) for i in range(len(found))])
    assert misclassification(renamed[order], truth[order]) == pytest.approx(
        misclassification(found, truth)
    )


@SLOW_IMPORT
@given(labelled)
def test_the_confusion_matrix_counts_every_counted_track_once(
    pairs: list[tuple[int, int]],
) -> None:
    found, truth = arrays(pairs)
    evaluation = evaluate(found, truth)
    confusion = evaluation.confusion
    assert confusion.sum() == evaluation.counted
    assert confusion.shape == (
        len(evaluation.true_motions) + 1,
        len(evaluation.found_motions) + 1,
    )
    matched = len(evaluation.matching)
    outliers = ((found == 0) & (truth == 0)).sum()
    right = np.trace(confusion[:matched, :matched]) + outliers
    if evaluation.counted:
        assert evaluation.misclassification == pytest.approx(1 - right / evaluation.counted)


def test_the_rules_for_background_and_ignored() -> None:
    truth = np.array([1, 1, 0, 0, IGNORED, 1])
    assert misclassification(np.array([1, 1, 0, 0, 2, 1]), truth) == 0.0
    # a true motion found as background is wrong, a true outlier found as background not counted
    assert misclassification(np.array([1, BACKGROUND, BACKGROUND, 0, 0, 1]), truth) == 1 / 4
    assert misclassification(np.array([1, NOT_JUDGED, 0, 0, 0, 1]), truth) == 0.0


def test_lengths_must_agree() -> None:
    with pytest.raises(ValueError, match="2 found labels, but 1 true labels"):
        evaluate(np.array([1, 2]), np.array([1]))


def test_equation_23_is_a_mean_of_squares_over_the_true_inliers() -> None:
    residuals, truth = np.array([1.0, 2.0, 100.0]), np.array([1, 1, 0])
    assert residual_errors(residuals, truth, 1) == pytest.approx(2.5)
    assert np.isnan(residual_errors(residuals, truth, 7))
