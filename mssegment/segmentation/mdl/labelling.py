"""Which track belongs to which motion, when labels have a cost.

Labels are coded in one of two ways. By frequency: a label costs the negative logarithm of its share
of all tracks; sets of motions are compared in this way. By neighbours: among the motions, the label
of a track is predicted by the labels of its nearest neighbours; the final labels are computed in
this way, where two motions explain a track about equally well.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest, without
from mssegment.records import Floats, Integers

MAX_LABEL_ROUNDS = 12
"""Maximum number of rounds of labels and their costs; they converge in 2 to 5."""
SMOOTHING_ROUNDS = 4
"""The same within the search."""
MIXTURE_ROUNDS, MIXTURE_TOLERANCE = 50, 1e-4
"""Rounds of expectation and maximization of the shares of a mixture, and where they end."""
LABEL_NEIGHBOURS = 8
"""Nearest assigned neighbours that predict a label."""
STORED_FACTOR = 3
"""Stored neighbours per neighbour used, because some are assigned to no motion."""
LABEL_PRIOR = 0.5
"""Initial count of each label (Krichevsky and Trofimov)."""
SEARCH_PRIOR = 0.1
"""The same within the search for motions that leave parallax free, whose objects are coherent."""


class Neighbourhood:
    """The nearest assigned neighbours of each track, for any set of assigned tracks.

    Parameters
    ----------
    space : ndarray [P, d]
        Vectors whose distances define neighbours.
    """

    def __init__(self, space: Floats) -> None:
        self._space = space
        size = min(STORED_FACTOR * LABEL_NEIGHBOURS, len(space))
        self._stored = np.asarray(nearest(space, space, max(size, 1))[1], dtype=np.int64)
        self._itself = self._stored == np.arange(len(space))[:, None]

    def of(self, assigned: Flags) -> Integers:
        """The nearest assigned neighbours of each track, without itself, nearest first.

        Returns [P, k], where k is ``LABEL_NEIGHBOURS``, or less if fewer are assigned.
        """
        count = min(LABEL_NEIGHBOURS, int(assigned.sum()) - 1)
        if count < 1:
            return np.zeros((len(assigned), 0), dtype=np.int64)
        usable = assigned[self._stored] & ~self._itself
        first = np.argsort(~usable, axis=1, kind="stable")[:, :count]
        found = np.take_along_axis(self._stored, first, axis=1)
        # if too few of the stored neighbours are assigned, search among the assigned tracks
        short = np.flatnonzero(usable.sum(axis=1) < count)
        if len(short):
            tracks = np.flatnonzero(assigned)
            index = nearest(self._space[tracks], self._space[short], count + 1)[1]
            found[short] = without(tracks[index], short)
        return found


def frequency_labels(
    gains: Floats, label_cost: bool = True, common_frequency: bool = False
) -> tuple[Integers, float]:
    """Label tracks, with labels coded by frequency.

    Parameters
    ----------
    gains : ndarray [m, P]
        Nats that each motion saves on each track.
    label_cost : bool
        Whether labels cost anything.
    common_frequency : bool
        Whether the labels are computed as if all motions had the same frequency.

    Returns
    -------
    labels : ndarray [P] of int
        Labels 1..m; 0 for outliers.
    saved : float
        Nats saved.

    Examples
    --------
    >>> import numpy as np
    >>> gains = np.array([[5.0, 5.0, 5.0, -9.0], [-9.0, -9.0, -9.0, -9.0]])
    >>> labels, saved = frequency_labels(gains)
    >>> labels.tolist()
    [1, 1, 1, 0]
    """
    table = _with_outlier(gains)
    tracks = np.arange(table.shape[1])
    labels = table.argmax(axis=0)
    if not label_cost or not len(gains):
        return labels, float(table[labels, tracks].sum())
    for _ in range(MAX_LABEL_ROUNDS):
        count = np.bincount(labels, minlength=len(table))
        if common_frequency:
            outlier, motion = _log_share(np.array([count[0], count[1:].sum()]))
            share = np.where(np.arange(len(table)) == 0, outlier, motion)
        else:
            share = _log_share(count)
        updated = (table + share[:, None]).argmax(axis=0)
        if (updated == labels).all():
            break
        labels = updated
    return labels, float(table[labels, tracks].sum()) - frequency_cost(labels)


def mixture_labels(gains: Floats) -> tuple[Integers, float]:
    """Label tracks by the most likely component of a mixture of the motions and the outliers.

    Where motions overlap with each other or with many outliers, a hard label would cost more than
    what it says.

    Parameters
    ----------
    gains : ndarray [m, P]
        Nats that each motion saves on each track.

    Returns
    -------
    labels : ndarray [P] of int
        Labels 1..m; 0 for outliers.
    saved : float
        Nats saved.
    """
    table = _with_outlier(gains)
    peak = table.max(axis=0)
    likelihood = np.exp(table - peak)
    share = np.full(len(table), 1.0 / len(table))
    for _ in range(MIXTURE_ROUNDS):
        posterior = share[:, None] * likelihood
        total = posterior.sum(axis=0)
        before, share = share, (posterior / total).mean(axis=1)
        if np.abs(share - before).max() < MIXTURE_TOLERANCE:
            break
    weighted = share[:, None] * likelihood
    saved = float((np.log(weighted.sum(axis=0)) + peak).sum())
    return weighted.argmax(axis=0), saved


def frequency_cost(labels: Integers) -> float:
    """Nats to code labels [P] by their frequencies."""
    count = np.bincount(labels)
    used = count[count > 0]
    return float(-(used * np.log(used / max(len(labels), 1))).sum())


def neighbour_cost(labels: Integers, neighbours: Integers) -> float:
    """Nats to code labels [P] given those of the ``neighbours`` [P, k].

    Whether a track is an outlier is coded by frequency; its motion is predicted by the neighbours
    that belong to a motion.
    """
    assigned = labels > 0
    motions = int(labels.max(initial=0))
    neighbour_labels = labels[neighbours]
    same = (neighbour_labels == labels[:, None]).sum(axis=1)
    total = (neighbour_labels > 0).sum(axis=1)
    share = (same + SEARCH_PRIOR) / (total + SEARCH_PRIOR * max(motions, 1))
    return frequency_cost(assigned.astype(np.int64)) - float(np.log(share[assigned]).sum())


def smooth_labels(gains: Floats, neighbours: Integers, labels: Integers) -> Integers:
    """Update labels [P] given the ``gains`` [m, P] and the labels of the ``neighbours`` [P, k].

    Minimizes ``neighbour_cost`` minus gains. The neighbours do not depend on the labels, which
    makes this fast enough for every set of motions that a search compares.
    """
    table = _with_outlier(gains)
    motions = len(gains)
    names = np.arange(1, motions + 1)
    for _ in range(SMOOTHING_ROUNDS):
        of_neighbours = labels[neighbours]
        total = (of_neighbours > 0).sum(axis=1)
        votes = (of_neighbours[None] == names[:, None, None]).sum(axis=2)
        assigned = int((labels > 0).sum())
        outlier, motion = _log_share(np.array([len(labels) - assigned, assigned]))
        log_prior = np.log((votes + SEARCH_PRIOR) / (total + SEARCH_PRIOR * motions)) + motion
        log_prior = np.concatenate([np.full((1, len(labels)), outlier), log_prior])
        updated = (table + log_prior).argmax(axis=0)
        if (updated == labels).all():
            break
        labels = updated
    return labels


def neighbour_labels(gains: Floats, neighbourhood: Neighbourhood, labels: Integers) -> Integers:
    """Update labels [P] given the ``gains`` [m, P] and the labels of the assigned neighbours.

    Whether a track is an outlier is coded by frequency; its motion is predicted by the
    ``LABEL_NEIGHBOURS`` nearest tracks that belong to any.
    """
    table = _with_outlier(gains)
    motions = len(gains)
    if motions < 2:
        return frequency_labels(gains)[0]
    before, near = None, labels
    for _ in range(MAX_LABEL_ROUNDS):
        assigned = labels > 0
        if before is None or (assigned != before).any():
            before, near = assigned, neighbourhood.of(assigned)
        log_prior = np.empty_like(table)
        count = np.array([(~assigned).sum(), assigned.sum()])
        log_prior[0], log_prior[1:] = _log_share(count)[:, None]
        votes = (labels[near][None] == np.arange(1, motions + 1)[:, None, None]).sum(axis=2)
        log_prior[1:] += np.log((votes + LABEL_PRIOR) / (near.shape[1] + LABEL_PRIOR * motions))
        updated = (table + log_prior).argmax(axis=0)
        if (updated == labels).all():
            break
        labels = updated
    return labels


def _with_outlier(gains: Floats) -> Floats:
    """The gains with a first row of zeros, for outliers."""
    return np.concatenate([np.zeros((1, gains.shape[1])), gains])


def _log_share(count: Integers) -> Floats:
    """Logarithms of the shares of the labels, from their counts."""
    return np.asarray(np.log((count + LABEL_PRIOR) / (count.sum() + LABEL_PRIOR * len(count))))
