"""Closed-form logarithms of small symmetric matrices, against LAPACK's eigenvectors."""

import numpy as np
import pytest

from mssegment.manifolds.small_symmetric import (
    EntrywiseLogs,
    congruence,
    from_entries,
    to_entries,
)
from mssegment.manifolds.symmetric import symmetric_function
from mssegment.records import Floats

SPECTRA = {
    "apart": [0.3, 1.0, 4.0],
    "the identity": [1.0, 1.0, 1.0],
    "two equal, smaller": [0.5, 0.5, 2.0],
    "two equal, larger": [0.5, 2.0, 2.0],
    "two nearly equal": [0.5, 0.5 + 1e-9, 2.0],
    "about the limit of the series": [1.0, 1.0 + 0.9e-5, 1.0 + 1.1e-5],
    "all nearly equal": [1.0, 1.0 + 1e-13, 1.0 + 1e-7],
    "small": [1e-12, 3e-12, 5e-12],
    "near the limit of the closed form": [1.1e-6, 0.3, 1.0],
    "beyond it": [1e-8, 0.3, 1.0],
}


def matrices(values: list[float], n: int, count: int = 50) -> Floats:
    """Matrices [count, n, n] with these eigenvalues, the least and the largest for n = 2."""
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.standard_normal((count, n, n)))
    own = np.array(values if n == 3 else [values[0], values[-1]])
    x = (q * own) @ np.swapaxes(q, 1, 2)
    return np.asarray(0.5 * (x + np.swapaxes(x, 1, 2)))


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("name", SPECTRA)
def test_logarithms_are_those_of_eigenvectors(name: str, n: int) -> None:
    values = SPECTRA[name]
    x = matrices(values, n)
    expected = symmetric_function(np.log, x)
    found = EntrywiseLogs(to_entries(x)[:, None, :])
    rounding = 30 * 2.2e-16 * values[-1] / values[0] + 1e-14 * np.abs(np.log(values)).max()
    norms = np.linalg.norm(expected, axis=(1, 2))
    assert np.abs(np.sqrt(found.sq_norm[0]) - norms).max() <= rounding
    weights = np.random.default_rng(1).uniform(0.0, 1.0, (1, len(x)))
    weighted = np.einsum("n,nij->ij", weights[0], expected)
    assert np.abs(found.weighted_sum(weights)[0] - weighted).max() <= rounding * weights.sum()


@pytest.mark.parametrize("n", [2, 3])
def test_a_matrix_without_logarithm_is_infinitely_far_and_adds_nothing(n: int) -> None:
    x = np.tile(2.0 * np.eye(n), (4, 1, 1))
    x[0] = np.nan
    x[1, 0, 0] = -1.0
    x[2] = np.inf
    found = EntrywiseLogs(to_entries(x)[:, None, :])
    assert np.isinf(found.sq_norm[0]).tolist() == [True, True, True, False]
    assert np.isclose(found.sq_norm[0, 3], n * np.log(2.0) ** 2)
    assert np.allclose(found.weighted_sum(np.ones((1, 4))), np.log(2.0) * np.eye(n))


@pytest.mark.parametrize("n", [2, 3])
def test_entries_of_a_congruence(n: int) -> None:
    rng = np.random.default_rng(2)
    r, y = (a + np.swapaxes(a, 1, 2) for a in rng.standard_normal((2, 7, n, n)))
    found = np.einsum("mkl,lm->km", congruence(r), to_entries(y))
    assert np.allclose(from_entries(found, n), r @ y @ r)
