"""The leading eigenvectors of many tracks, against those of the dense decomposition."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from mssegment.records import Floats
from mssegment.segmentation.consensus import spectral

SIZES = (120, 60, 30, 15)


def four_groups(between: float, rng: np.random.Generator) -> Floats:
    """The affinity of four groups; without any agreement ``between`` them where that is 0."""
    truth = np.repeat(np.arange(4), SIZES)
    marks = np.repeat(np.eye(4), SIZES, axis=0) + between
    marks = np.concatenate([marks, rng.random((len(truth), 30)) * 0.5], axis=1)
    affinity = spectral.sharpen(marks @ marks.T, 4)
    if between == 0.0:
        affinity *= truth[:, None] == truth
        affinity += spectral.FLOOR
    return affinity


def iterated(affinity: Floats, count: int, monkeypatch: pytest.MonkeyPatch) -> Floats:
    """The embedding by Lanczos; the dense solver is out of reach."""
    with monkeypatch.context() as patch:
        patch.setattr(spectral, "DENSE", 10)
        patch.setattr(scipy.linalg, "eigh", None)
        return spectral.embedding(affinity, count)


def normalised(affinity: Floats) -> Floats:
    root = 1.0 / np.sqrt(affinity.sum(axis=1))
    return np.asarray(affinity * root[:, None] * root)


def same_space(a: Floats, b: Floats) -> bool:
    return bool(np.linalg.svd(a.T @ b)[1].min() > 1 - 1e-4)


@pytest.mark.parametrize("between", [0.0, 0.05, 0.3])
def test_leading_eigenvectors_are_those_of_the_dense_decomposition(
    between: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Groups that never agree have an eigenvalue of 1 each: none of them may be missed."""
    affinity = four_groups(between, rng)
    assert same_space(spectral.embedding(affinity, 4), iterated(affinity, 4, monkeypatch))


@pytest.mark.parametrize(
    ("copies", "dimensions", "power", "count"), [(3, 6, 4, 6), (4, 10, 8, 8), (4, 40, 16, 4)]
)
def test_no_copy_of_a_multiple_eigenvalue_is_missed(
    copies: int,
    dimensions: int,
    power: int,
    count: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Equal groups that never agree: every eigenvalue is there once for each of them.

    Lanczos from one start vector misses some of these.
    """
    rng = np.random.default_rng(1)
    marks = rng.random((100, dimensions))
    marks /= np.linalg.norm(marks, axis=1, keepdims=True)
    affinity = np.kron(np.eye(copies), (marks @ marks.T) ** power) + spectral.FLOOR
    values, vectors = np.linalg.eigh(normalised(affinity))
    found = iterated(affinity, count, monkeypatch)
    quotients = np.sum(found * (normalised(affinity) @ found), axis=0)
    np.testing.assert_allclose(quotients, values[: -count - 1 : -1], atol=1e-4)
    assert same_space(vectors[:, -count:], found)
    labels = spectral.partition(found, copies, rng)
    assert [len(set(group)) for group in labels.reshape(copies, -1)] == [1] * copies
    assert len(set(labels)) == copies


@pytest.mark.parametrize("count", [2, 5, 9])
def test_blocks_of_ones(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five eigenvalues of 1, all others 0: fewer, as many, and more vectors than that."""
    affinity = np.kron(np.eye(5), np.ones((30, 30))) + spectral.FLOOR
    found = iterated(affinity, count, monkeypatch)
    np.testing.assert_allclose(found.T @ found, np.eye(count), atol=1e-4)
    quotients = np.sum(found * (normalised(affinity) @ found), axis=0)
    np.testing.assert_allclose(quotients, (np.arange(count) < 5).astype(float), atol=1e-4)


@pytest.mark.parametrize("between", [0.0, 0.05])
def test_the_same_affinity_gives_the_same_bytes(
    between: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    affinity = four_groups(between, rng)
    first, second = (iterated(affinity, 6, monkeypatch) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_without_convergence_the_dense_solver_takes_over(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An affinity of noise has no gap between its eigenvalues."""
    noise = rng.random((300, 300))
    affinity = noise + noise.T
    dense = spectral.embedding(affinity, 12)
    monkeypatch.setattr(spectral, "DENSE", 10)
    monkeypatch.setattr(spectral, "MAX_RESTARTS", 1)
    assert spectral._lanczos(normalised(affinity).astype(np.float32), 12) is None
    np.testing.assert_array_equal(spectral.embedding(affinity, 12), dense)
