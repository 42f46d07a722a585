"""What replaces slow imports agrees with what it replaces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.special import polygamma
from scipy.stats import chi2

from mssegment.evaluation import best_pairs
from mssegment.neighbours import nearest, pairs_within
from mssegment.special import (
    chi_square_quantile,
    distinct,
    median,
    quantile,
    trigamma_of_half,
)

finite = st.floats(-1e6, 1e6)


@pytest.mark.parametrize("freedom", [1, 2, 3, 5, 40, 600])
def test_special_functions(freedom):
    exact = 1e-9 if freedom <= 2 else 4e-2
    for share in (0.5, 0.95, 0.9999):
        expected = chi2.ppf(share, freedom)
        assert chi_square_quantile(freedom, share) == pytest.approx(expected, rel=exact)
    assert trigamma_of_half(freedom) == pytest.approx(polygamma(1, freedom / 2), rel=1e-11)


@given(
    arrays.arrays(
        np.int64, st.tuples(st.integers(0, 7), st.integers(0, 7)), elements=st.integers(0, 9)
    )
)
def test_matching_has_the_greatest_sum(gain):
    pairs = best_pairs(gain)
    rows, columns = [i for i, _ in pairs], [j for _, j in pairs]
    assert len(set(rows)) == len(set(columns)) == len(pairs) == min(gain.shape)
    assert gain[rows, columns].sum() == gain[linear_sum_assignment(gain, maximize=True)].sum()


@given(st.lists(st.integers(-3, 4) | st.integers(-(2**62), 2**62)))
def test_distinct_numbers(values):
    expected = np.unique(np.array(values, dtype=np.int64))
    np.testing.assert_array_equal(distinct(values), expected)


@given(arrays.arrays(float, st.integers(1, 9), elements=finite))
def test_median_to_the_last_bit(values):
    assert median(values) == np.median(values)


@given(
    arrays.arrays(float, st.tuples(st.integers(1, 3), st.integers(1, 9)), elements=finite),
    st.floats(0, 1),
)
def test_quantiles_to_the_last_bit(values, share):
    np.testing.assert_array_equal(quantile(values, share), np.quantile(values, share, axis=1))
    np.testing.assert_array_equal(quantile(values[0], share), np.quantile(values[0], share))


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
