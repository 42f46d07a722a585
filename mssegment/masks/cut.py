"""Regularised labels: colours, edges and a minimum cut, one expansion per object.

The energy of Boykov and Jolly (ICCV 2001): the costs of the labels, minus the logarithm of the
probability of the colours under each label, plus a price for neighbours of different labels that
falls with their contrast. The minimum cut is SciPy's.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.masks.evidence import Costs, Picture

LabelMap = npt.NDArray[np.int64]
"""[height, width]: indices of labels."""

BINS = 16
"""Bins of the colour histogram per channel."""
COLOUR_FLOOR = 0.01
"""Share of a colour model that is uniform: colours that its label has not shown yet."""
MOST_COLOUR = 5.0
"""Largest cost of a colour, in nats: one colour alone does not decide."""
EDGE = 2.0
"""Price of a border between two pixels of equal colour, in nats."""
UNIT = 100.0
"""Capacities per nat; they are whole numbers."""


def colour_costs(picture: Picture, labels: LabelMap, count: int) -> Costs:
    """The negative log-probability of each pixel's colour under each of ``count`` labels.

    From smoothed histograms of the pixels that have the label now; relative to the most probable
    label.
    """
    bins = picture.astype(np.int64) * BINS // 256
    code = (bins[..., 0] * BINS + bins[..., 1]) * BINS + bins[..., 2]
    costs = []
    for label in range(count):
        chosen = code[labels == label]
        histogram = np.bincount(chosen, minlength=BINS**3).reshape(BINS, BINS, BINS)
        share = _smoothed(histogram.astype(np.float64)) / max(len(chosen), 1)
        share = (1 - COLOUR_FLOOR) * share + COLOUR_FLOOR / BINS**3
        costs.append(-np.log(share.reshape(-1))[code])
    stacked = np.array(costs)
    return np.asarray(np.minimum(stacked - stacked.min(axis=0), MOST_COLOUR), dtype=np.float32)


def _smoothed(histogram: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(histogram, 1.0, mode="nearest"))


def edge_prices(picture: Picture) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Prices of a border to the right neighbour [h, w - 1] and to the lower one [h - 1, w]."""
    colours = picture.astype(np.float64)
    across = ((colours[:, 1:] - colours[:, :-1]) ** 2).sum(axis=2)
    down = ((colours[1:] - colours[:-1]) ** 2).sum(axis=2)
    typical = np.concatenate([across.ravel(), down.ravel()]).mean() + 1e-9
    return EDGE * np.exp(-across / (2 * typical)), EDGE * np.exp(-down / (2 * typical))


def expand(costs: Costs, labels: LabelMap, picture: Picture) -> LabelMap:
    """One expansion of every label but the first: it takes the pixels that lower the energy."""
    prices = edge_prices(picture)
    for label in range(1, len(costs)):
        others = np.where(labels == label, 0, labels)
        present = np.take_along_axis(costs, others[None], axis=0)[0]
        taken = minimum_cut(costs[label] - present, *prices)
        labels = np.where(taken, label, others)
    return labels


def minimum_cut(
    cost: npt.NDArray[np.floating],
    across: npt.NDArray[np.floating],
    down: npt.NDArray[np.floating],
) -> npt.NDArray[np.bool_]:
    """The pixels to take, so that their costs and the prices of their border are least.

    Parameters
    ----------
    cost : ndarray [h, w]
        Cost of taking a pixel, negative for a gain.
    across, down : ndarray [h, w - 1] and [h - 1, w]
        Price of a border between neighbours.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    whole = np.round(cost * UNIT).astype(np.int32).ravel()
    # older versions of SciPy take no other kind of index
    index = np.arange(cost.size, dtype=np.int32).reshape(cost.shape)
    keep, take = cost.size, cost.size + 1
    dear, cheap = index.ravel()[whole > 0], index.ravel()[whole < 0]
    rows, columns = [np.full_like(dear, keep), cheap], [dear, np.full_like(cheap, take)]
    capacities = [whole[dear], -whole[cheap]]
    for first, second, price in (
        (index[:, :-1], index[:, 1:], across),
        (index[:-1], index[1:], down),
    ):
        capacity = np.round(price * UNIT).astype(np.int32).ravel()
        rows += [first.ravel(), second.ravel()]
        columns += [second.ravel(), first.ravel()]
        capacities += [capacity, capacity]
    places = (np.concatenate(rows), np.concatenate(columns))
    graph = coo_array((np.concatenate(capacities), places), shape=(take + 1, take + 1)).tocsr()
    left = graph - maximum_flow(graph, keep, take).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    taken = np.ones(take + 1, dtype=bool)
    taken[breadth_first_order(left, keep, return_predecessors=False)] = False
    return taken[:keep].reshape(cost.shape)


def guided_filter(
    guide: npt.NDArray[np.float32], values: npt.NDArray[np.float32], radius: int, noise: float
) -> npt.NDArray[np.float32]:
    """The guided filter (He, Sun and Tang, ECCV 2010): a mean that follows the edges of ``guide``.

    ``guide`` and ``values`` are [h, w], ``noise`` is the variance below which the guide is flat.
    """

    def mean(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        side = 2 * radius + 1
        return np.asarray(cv2.blur(array, (side, side), borderType=cv2.BORDER_REFLECT))

    of_guide, of_values = mean(guide), mean(values)
    variance = mean(guide * guide) - of_guide * of_guide
    slope = np.asarray((mean(guide * values) - of_guide * of_values) / (variance + noise))
    return np.asarray(mean(slope) * guide + mean(np.asarray(of_values - slope * of_guide)))
