"""How well a partition describes the tracks: clouds, and labels predicted by the modes.

A group is a Student-t cloud in the principal components of the tracks. Each track is judged by its
group without itself, since a small group in many dimensions follows whatever is put into it. A
label is predicted by the others whose hypotheses climb to the same modes.

``members`` [G, P] says, for any groups, which tracks are theirs (0 or 1). Costs are in nats.
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.robust import StudentTFit, hard_em
from mssegment.records import Floats, Integers

LEAST_SPREAD = 0.5
"""Standard deviation, in the units of the components, below which differences say nothing: what
perspective does to one body is more than the noise."""
FREEDOM = 5.0
"""Degrees of freedom of the Student-t cloud."""
MOST_LEVERAGE = 0.98
EM_ROUNDS = 20
FEWEST = 5
"""Tracks without which a group is no body."""
SURPRISE = 0.02
"""Share of the labels that the modes do not predict."""


class Likelihood:
    """Costs of groups of tracks, in components [P, D] and with their company in modes [P, M]."""

    def __init__(self, components: Floats, votes: Floats) -> None:
        self._components, self._votes = components, votes
        self._tracks, self._dimensions = components.shape
        self._student_t = StudentTFit(components, FREEDOM, LEAST_SPREAD)
        others = votes.sum(axis=0) - votes
        # what one track says about another of the same mode; a mode of one track says nothing
        self._says = np.where(others > 1e-9, votes / np.maximum(others, 1e-9), 0.0)
        self._own = (self._says * votes).sum(axis=1)
        self._silent = np.maximum(1 - self._says @ votes.sum(axis=0) + self._own, 0.0)

    def cost(self, labels: Integers, weight: float) -> float:
        """Of a partition with labels 0.. [P]; ``weight`` is that of the labels."""
        return float(self.group_costs(membership(labels), weight).sum())

    def group_costs(self, members: Floats, weight: float) -> Floats:
        """Of each group [G]: its tracks as a cloud, and ``weight`` times their labels."""
        costs = self.track_costs(members) + weight * self.label_costs(members)
        return np.asarray((costs * members).sum(axis=1))

    def track_costs(self, members: Floats) -> Floats:
        """Of each track in each group [G, P], ((D + 5) ln(1 + q / 5) + ln|S|) / 2.

        q is the squared Mahalanobis distance; both are those of the cloud without the track, which
        its leverage h tells: q / (1 - h) and |S| (1 - h).
        """
        fitted = self._student_t(members)
        sizes = members.sum(axis=1)[:, None]
        leverage = np.minimum(fitted.weights * fitted.squared / sizes, MOST_LEVERAGE)
        tails = np.log1p(fitted.squared / (1 - leverage) / FREEDOM)
        scale = fitted.log_det[:, None] + np.log1p(-leverage)
        return np.asarray(((self._dimensions + FREEDOM) * tails + scale) / 2)

    def label_costs(self, members: Floats) -> Floats:
        """Of the label of each track [G, P]: - ln of the share of the group in its company.

        Modes without further tracks, and SURPRISE, count as the share of the group in all tracks.
        """
        sizes = members.mean(axis=1)[:, None]
        share = (members @ self._votes) @ self._says.T - members * self._own
        known = np.maximum(share, 0.0) + self._silent * sizes
        return np.asarray(-np.log((1 - SURPRISE) * known + SURPRISE * sizes))

    def refine(self, labels: Integers, weight: float) -> Integers:
        """Hard expectation maximization of labels [P]; groups below FEWEST tracks dissolve."""

        def costs(members: Floats) -> Floats:
            return np.asarray(self.track_costs(members) + weight * self.label_costs(members))

        return hard_em(labels, costs, EM_ROUNDS, FEWEST)


def membership(labels: Integers) -> Floats:
    """``members`` [G, P] of labels 0.. [P]."""
    return np.asarray(np.eye(int(labels.max()) + 1)[:, labels])
