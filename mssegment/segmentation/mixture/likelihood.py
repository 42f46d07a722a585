"""Description length of a partition: Student t distributions, and labels predicted by the modes.

A group is a Student t distribution in the principal components of the tracks. The cost of a track
is that with respect to the distribution of its group without the track itself, because a small
group in many dimensions fits any track it includes. A label is predicted by the labels of the
tracks whose hypotheses converge to the same modes.

``members`` [G, P] are the tracks of G groups (0 or 1). Costs are in nats.
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.robust import StudentTFit, hard_em
from mssegment.records import Floats, Integers

MIN_SPREAD = 0.5
"""Standard deviation, in the units of the components, below which differences are not
significant: the effects of perspective on one motion are larger than the noise."""
DEGREES_OF_FREEDOM = 5.0
"""Of the Student t distribution."""
MAX_LEVERAGE = 0.98
EM_ROUNDS = 20
MIN_GROUP_SIZE = 5
"""Smallest number of tracks of a group."""
UNPREDICTED_SHARE = 0.02
"""Share of the labels that the modes do not predict."""


class Likelihood:
    """Costs of groups of tracks.

    Parameters
    ----------
    components : ndarray [P, D]
        Principal components of the tracks.
    votes : ndarray [P, M]
        Shares of the hypotheses of each track that converge to each mode (``ModeVotes``).
    """

    def __init__(self, components: Floats, votes: Floats) -> None:
        self._votes = votes
        self._dimensions = components.shape[1]
        self._student_t = StudentTFit(components, DEGREES_OF_FREEDOM, MIN_SPREAD)
        others = votes.sum(axis=0) - votes
        # weight of another track of the same mode in the prediction; none in a mode of one track
        self._weights = np.where(others > 1e-9, votes / np.maximum(others, 1e-9), 0.0)
        self._self_weight = (self._weights * votes).sum(axis=1)
        predicted = self._weights @ votes.sum(axis=0) - self._self_weight
        self._unpredicted = np.maximum(1 - predicted, 0.0)

    def cost(self, labels: Integers, weight: float) -> float:
        """Cost of a partition with labels 0, 1, ... [P]; ``weight`` is that of the labels."""
        return float(self.group_costs(membership(labels), weight).sum())

    def group_costs(self, members: Floats, weight: float) -> Floats:
        """Cost of each group [G]: its tracks, and ``weight`` times their labels."""
        costs = self.track_costs(members) + weight * self.label_costs(members)
        return np.asarray((costs * members).sum(axis=1))

    def track_costs(self, members: Floats) -> Floats:
        """Cost of each track in each group [G, P], ((D + nu) ln(1 + q / nu) + ln|S|) / 2.

        q is the squared Mahalanobis distance, and S the scatter matrix. Both are those of the
        distribution without the track, which follow from its leverage h: q / (1 - h) and |S| (1 -
        h).
        """
        fitted = self._student_t(members)
        sizes = members.sum(axis=1)[:, None]
        leverage = np.minimum(fitted.weights * fitted.squared / sizes, MAX_LEVERAGE)
        tails = np.log1p(fitted.squared / (1 - leverage) / DEGREES_OF_FREEDOM)
        scale = fitted.log_det[:, None] + np.log1p(-leverage)
        return np.asarray(((self._dimensions + DEGREES_OF_FREEDOM) * tails + scale) / 2)

    def label_costs(self, members: Floats) -> Floats:
        """Cost of the label of each track [G, P]: minus the logarithm of its predicted probability.

        The prediction is the share of the group among the other tracks of the same modes. Where
        there are none, and with probability ``UNPREDICTED_SHARE``, it is the share of the group
        among all tracks.
        """
        sizes = members.mean(axis=1)[:, None]
        share = (members @ self._votes) @ self._weights.T - members * self._self_weight
        predicted = np.maximum(share, 0.0) + self._unpredicted * sizes
        return np.asarray(-np.log((1 - UNPREDICTED_SHARE) * predicted + UNPREDICTED_SHARE * sizes))

    def refine(self, labels: Integers, weight: float) -> Integers:
        """Refine labels [P] by hard EM; groups below ``MIN_GROUP_SIZE`` are dissolved."""

        def costs(members: Floats) -> Floats:
            return np.asarray(self.track_costs(members) + weight * self.label_costs(members))

        return hard_em(labels, costs, EM_ROUNDS, MIN_GROUP_SIZE)


def membership(labels: Integers) -> Floats:
    """``members`` [G, P] of labels 0, 1, ... [P]."""
    return np.asarray(np.eye(int(labels.max()) + 1)[:, labels])
