"""What replaces slow imports agrees with what it replaces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.special import gammainc, gammaincinv, polygamma

from mssegment.neighbours import nearest, pairs_within
from mssegment.special import gamma_quantile, gamma_share, trigamma


@pytest.mark.parametrize("a", [0.5, 1.0, 1.5, 2.0, 5.0, 40.5, 300.0])
def test_gamma_functions(a):
    for x in a * np.array([1e-6, 0.1, 0.9, 1.1, 3.0]):
        assert gamma_share(a, x) == pytest.approx(gammainc(a, x), rel=1e-11, abs=1e-300)
    for share in (1e-6, 0.05, 0.5, 0.95, 0.9999):
        assert gamma_quantile(a, share) == pytest.approx(gammaincinv(a, share), rel=1e-10)
    assert trigamma(a) == pytest.approx(polygamma(1, a), rel=1e-13)


@pytest.mark.parametrize(
    ("n", "d", "count", "within"),
    [
        (1, 2, 3, np.inf),
        (7, 4, 7, np.inf),
        (500, 2, 1, np.inf),
        (500, 4, 12, np.inf),
        (900, 2, 9, 5.0),
    ],
)
def test_nearest_neighbours(n, d, count, within, rng):
    points = 1e4 + rng.uniform(0, 500, (n, d))
    queries = np.concatenate([points[: n // 2], 1e4 + rng.uniform(-50, 550, (30, d))])
    ranks = list(range(1, count + 1))
    distance, index = cKDTree(points).query(queries, ranks, distance_upper_bound=within)
    found = nearest(points, queries, count, within)
    np.testing.assert_allclose(found[0], distance, rtol=1e-12)
    np.testing.assert_array_equal(found[1], index)


def test_equally_near_ones_come_in_order():
    points = np.repeat([[0.0, 0.0], [1.0, 0.0]], 6, axis=0)
    _, index = nearest(points, [[0.0, 0.0], [1.0, 0.0]], 6)
    assert index.tolist() == [list(range(6)), list(range(6, 12))]
    distance, index = nearest(np.zeros((0, 2)), [[0.0, 0.0]], 2)
    assert np.isinf(distance).all()
    assert (index == 0).all()


@pytest.mark.parametrize("radius", [0.0, 1.0, 30.0, 1000.0])
def test_pairs_within_a_radius(radius, rng):
    points = rng.uniform(-200, 300, (400, 2)).round(1)
    points[:20] = points[20:40]
    found = {tuple(sorted(pair)) for pair in pairs_within(points, radius).tolist()}
    assert len(found) == len(pairs_within(points, radius))
    assert found == cKDTree(points).query_pairs(radius)
    assert pairs_within(np.zeros((0, 2)), radius).shape == (0, 2)
