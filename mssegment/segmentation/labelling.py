"""Which track belongs to which motion, when a label has a price.

Labels are coded in one of two ways. By frequency: a label costs minus the logarithm of its share
of all tracks; this is how a set of motions is judged. By neighbours: among the motions, the label
of a track is predicted from the labels of its nearest neighbours; this is how the tracks are
assigned at last, where two motions explain a track about equally well.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Integers

TURNS = 12
"""Turns of labels and their prices; they settle in 2 to 5."""
NEIGHBOURS = 8
"""Nearest assigned tracks that predict a label."""
PRIOR = 0.5
"""Count that each label has before anything is seen (Krichevsky and Trofimov)."""


def frequency_labels(gains: Floats, label_cost: bool = True) -> tuple[Integers, float]:
    """The labels [P] (0 outlier) that save most, and the nats they save, given gains [m, P]."""
    table = _with_outlier(gains)
    tracks = np.arange(table.shape[1])
    labels = table.argmax(axis=0)
    if not label_cost:
        return labels, float(table[labels, tracks].sum())
    for _ in range(TURNS):
        count = np.bincount(labels, minlength=len(table))
        again = (table + _log_share(count)[:, None]).argmax(axis=0)
        if (again == labels).all():
            break
        labels = again
    count = np.bincount(labels, minlength=len(table))
    used = count[count > 0]
    return labels, float(table[labels, tracks].sum() + (used * np.log(used / len(tracks))).sum())


def neighbour_labels(gains: Floats, space: Floats) -> Integers:
    """The labels [P] when each is predicted by its neighbours in ``space`` [P, d].

    Outlier or not is coded by frequency; which motion, by the NEIGHBOURS nearest tracks that
    belong to any.
    """
    table = _with_outlier(gains)
    motions = len(gains)
    labels, _ = frequency_labels(gains)
    if motions < 2:
        return labels
    nearest = _by_distance(space)
    for _ in range(TURNS):
        assigned = labels > 0
        price = np.empty_like(table)
        count = np.array([(~assigned).sum(), assigned.sum()])
        price[0], price[1:] = _log_share(count)[:, None]
        known = _first(nearest, assigned, NEIGHBOURS)
        votes = (labels[known][None] == np.arange(1, motions + 1)[:, None, None]).sum(axis=2)
        price[1:] += np.log((votes + PRIOR) / (known.shape[1] + PRIOR * motions))
        again = (table + price).argmax(axis=0)
        if (again == labels).all():
            break
        labels = again
    return labels


def _with_outlier(gains: Floats) -> Floats:
    return np.concatenate([np.zeros((1, gains.shape[1])), gains])


def _log_share(count: Integers) -> Floats:
    return np.asarray(np.log((count + PRIOR) / (count.sum() + PRIOR * len(count))))


def _by_distance(space: Floats) -> Integers:
    """All other tracks of each track, nearest first, [P, P - 1]."""
    square = (space**2).sum(axis=1)
    distance = square[:, None] + square - 2 * space @ space.T
    np.fill_diagonal(distance, np.inf)
    return np.argsort(distance, axis=1, kind="stable")[:, :-1]


def _first(nearest: Integers, allowed: np.ndarray, count: int) -> Integers:
    """The first ``count`` allowed columns of each row, or as many as every row has."""
    count = min(count, int(allowed.sum()) - 1)
    place = np.argsort(~allowed[nearest], axis=1, kind="stable")[:, : max(count, 0)]
    return np.take_along_axis(nearest, place, axis=1)
