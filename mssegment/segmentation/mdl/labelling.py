"""Which track belongs to which motion, when a label has a price.

Labels are coded in one of two ways. By frequency: a label costs minus the logarithm of its share
of all tracks; this is how a set of motions is judged. By neighbours: among the motions, the label
of a track is predicted from the labels of its nearest neighbours; this is how the tracks are
assigned at last, where two motions explain a track about equally well.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest, without
from mssegment.records import Floats, Integers

TURNS = 12
"""Turns of labels and their prices; they settle in 2 to 5."""
SMOOTHING = 4
"""Turns of it inside the search."""
NEIGHBOURS = 8
"""Nearest assigned tracks that predict a label."""
WIDER = 3
"""Times as many tracks are looked at, because some are assigned to no motion."""
PRIOR = 0.5
"""Count that each label has before anything is seen (Krichevsky and Trofimov)."""
STRAY = 0.1
"""The same inside the search for motions that leave parallax free: their bodies are coherent."""


class Neighbourhood:
    """The tracks near each track in ``space`` [P, d], whichever of them count."""

    def __init__(self, space: Floats) -> None:
        self._space = space
        size = min(WIDER * NEIGHBOURS, len(space))
        near = nearest(space, space, max(size, 1))[1]
        self._around = np.asarray(near, dtype=np.int64)
        self._itself = self._around == np.arange(len(space))[:, None]

    def of(self, assigned: Flags) -> Integers:
        """The NEIGHBOURS assigned tracks nearest to each track, itself left out, nearest first.

        [P, k], with k smaller where fewer are assigned.
        """
        count = min(NEIGHBOURS, int(assigned.sum()) - 1)
        if count < 1:
            return np.zeros((len(assigned), 0), dtype=np.int64)
        useful = assigned[self._around] & ~self._itself
        first = np.argsort(~useful, axis=1, kind="stable")[:, :count]
        found = np.take_along_axis(self._around, first, axis=1)
        # where too few of those around are assigned, a tree of the assigned ones finds the others
        short = np.flatnonzero(useful.sum(axis=1) < count)
        if len(short):
            others = np.flatnonzero(assigned)
            place = nearest(self._space[others], self._space[short], count + 1)[1]
            found[short] = without(others[place], short)
        return found


def frequency_labels(
    gains: Floats, label_cost: bool = True, together: bool = False
) -> tuple[Integers, float]:
    """The labels [P] (0 outlier) that save most, and the nats they save, given gains [m, P].

    ``together``: the labels are found as if all motions shared one frequency.
    """
    table = _with_outlier(gains)
    tracks = np.arange(table.shape[1])
    labels = table.argmax(axis=0)
    if not label_cost or not len(gains):
        return labels, float(table[labels, tracks].sum())
    for _ in range(TURNS):
        count = np.bincount(labels, minlength=len(table))
        if together:
            outlier, motion = _log_share(np.array([count[0], count[1:].sum()]))
            share = np.where(np.arange(len(table)) == 0, outlier, motion)
        else:
            share = _log_share(count)
        again = (table + share[:, None]).argmax(axis=0)
        if (again == labels).all():
            break
        labels = again
    return labels, float(table[labels, tracks].sum()) - frequency_cost(labels)


def frequency_cost(labels: Integers) -> float:
    """Nats to state the labels [P] by the frequency of each."""
    count = np.bincount(labels)
    used = count[count > 0]
    return float(-(used * np.log(used / max(len(labels), 1))).sum())


def neighbour_cost(labels: Integers, nearest: Integers) -> float:
    """Nats to state the labels [P] by those of the tracks ``nearest`` [P, k] to each.

    Outlier or not by frequency; which motion, by the nearest tracks that belong to any.
    """
    assigned = labels > 0
    motions = int(labels.max(initial=0))
    around = labels[nearest]
    same = (around == labels[:, None]).sum(axis=1)
    known = (around > 0).sum(axis=1)
    share = (same + STRAY) / (known + STRAY * max(motions, 1))
    return frequency_cost(assigned.astype(np.int64)) - float(np.log(share[assigned]).sum())


def smooth_labels(gains: Floats, nearest: Integers, labels: Integers) -> Integers:
    """The labels [P] that ``neighbour_cost`` and the ``gains`` [m, P] prefer, from ``labels``.

    The tracks ``nearest`` [P, k] to each are the same whatever the labels, so that this is fast
    enough for every set of motions that a search tries.
    """
    table = _with_outlier(gains)
    motions = len(gains)
    names = np.arange(1, motions + 1)
    for _ in range(SMOOTHING):
        around = labels[nearest]
        known = (around > 0).sum(axis=1)
        votes = (around[None] == names[:, None, None]).sum(axis=2)
        assigned = int((labels > 0).sum())
        outlier, motion = _log_share(np.array([len(labels) - assigned, assigned]))
        price = np.log((votes + STRAY) / (known + STRAY * motions)) + motion
        again = (table + np.concatenate([np.full((1, len(labels)), outlier), price])).argmax(axis=0)
        if (again == labels).all():
            break
        labels = again
    return labels


def neighbour_labels(gains: Floats, neighbourhood: Neighbourhood, labels: Integers) -> Integers:
    """The labels [P] when each is predicted by its neighbours, from the ``labels`` [P] before.

    Outlier or not is coded by frequency; which motion, by the NEIGHBOURS nearest tracks that
    belong to any.
    """
    table = _with_outlier(gains)
    motions = len(gains)
    if motions < 2:
        return frequency_labels(gains)[0]
    before, known = None, labels
    for _ in range(TURNS):
        assigned = labels > 0
        if before is None or (assigned != before).any():
            before, known = assigned, neighbourhood.of(assigned)
        price = np.empty_like(table)
        count = np.array([(~assigned).sum(), assigned.sum()])
        price[0], price[1:] = _log_share(count)[:, None]
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
