"""The leading eigenvectors of many tracks, against those of the dense decomposition."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.segmentation.consensus import spectral


@pytest.mark.parametrize("between", [0.0, 0.05, 0.3])
def test_leading_eigenvectors_are_those_of_the_dense_decomposition(
    between: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bodies that never agree give an eigenvalue of 1 each: none of them may be missed."""
    sizes = (120, 60, 30, 15)
    truth = np.repeat(np.arange(4), sizes)
    marks = np.repeat(np.eye(4), sizes, axis=0) + between
    marks = np.concatenate([marks, rng.random((len(truth), 30)) * 0.5], axis=1)
    affinity = spectral.sharpen(marks @ marks.T, 4)
    if between == 0.0:
        affinity *= truth[:, None] == truth
        affinity += spectral.FLOOR
    dense = spectral.embedding(affinity, 4)
    monkeypatch.setattr(spectral, "DENSE", 10)
    monkeypatch.setattr("scipy.linalg.eigh", None)
    sparse = spectral.embedding(affinity, 4)
    cosines = np.linalg.svd(dense.T @ sparse)[1]
    assert cosines.min() > 1 - 1e-4
