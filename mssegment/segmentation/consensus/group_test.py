"""Is a group of tracks a motion? It must be more coherent than tracks that move independently.

Surrogates of a group are drawn, whose tracks move as far and as smoothly as its own do, but not
together: the path of each track is turned about its start by a random angle. Where a group stands
still but for its noise, nothing would change; every step is turned by itself, so that the noise
adds up to random walks.

The coherence of a group is the median logarithm of the residuals of its tracks from the flats
around them. Under the null hypothesis of independent tracks without a preferred direction, that of
the group is one more draw of the same distribution as those of the surrogates, which a Student t
statistic tests. Tracks near each other share flats, so that their residuals depend on each other;
the surrogates show how much.

References
----------
Fisher, Statistical Methods for Research Workers, 4th ed., 1932 (combined probabilities).
Theiler, Eubank, Longtin, Galdrikian and Farmer, Testing for nonlinearity in time series: the method
of surrogate data, Physica D 58, 1992.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mssegment.geometry.flats import extent
from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.sampling.chimeras import (
    FLAT_DIMENSION,
    LocalFlats,
    noise_of_tracks,
    spread_of_tracks,
)
from mssegment.sampling.windows import MIN_WINDOW_TRACKS, window_length, window_starts
from mssegment.segmentation.consensus.split_test import LEAST_SPREAD
from mssegment.special import student_t_tail

Array = npt.NDArray[np.complex128]

LEVEL = 0.003
"""There is no motion at all if the groups together are as coherent in three of a thousand sequences
of noise."""
SURROGATES, MORE_SURROGATES = 9, 30
"""Groups that are drawn first, and where these do not decide. The tails of the Student t
distributions with 8 and 38 degrees of freedom say what they leave unknown; at ``LEVEL``, 39 ask of
a group what 9 ask at 0.01, 2.9 standard deviations."""
DECIDED = -math.log(1e4), math.log(0.1)
"""Nine surrogates decide outside these log probabilities: so coherent is one group of noise in ten
thousand, or one in ten."""
MOST_TRACKS = 60
"""Tracks of a group that are tested, at random; the coherence of so many is well known."""
MOVING = 2.0
"""A group moves if the spread of its median track exceeds its noise by this factor: a track that
stands still has 1.4, the noise of two coordinates."""
GOES_ON = 6
"""Tracks that moved with a group in the frames before, from which on the group that they are in now
goes on: twice the size of an elemental subset."""
TINY = 1e-12
"""Keeps logarithms finite for exact data, in pixels."""


def log_false_alarms_of_groups(
    points: Floats,
    labels: Integers,
    groups: int,
    rng: np.random.Generator,
    moved_before: Flags | None = None,
) -> Floats:
    """``log_false_alarms_of_group`` of each group, [m].

    Incomplete tracks are tested in windows of frames, which are evidence together.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int
        The groups 1..m; other labels are of no group.
    groups : int
        Number of groups that are tested.
    rng : numpy.random.Generator
        Draws the surrogates and the flats.
    moved_before : ndarray [P] of bool, optional
        Tracks that moved with a group in the frames before. A group with some of
        them goes on, and is not tested.

    Returns
    -------
    ndarray [m]
        Nats; NaN where neither all frames nor a window show tracks enough of the group, and for
        those that go on.
    """
    found = np.full(int(labels.max(initial=0)), math.nan)
    for label in range(1, len(found) + 1):
        own = labels == label
        if moved_before is None or moved_before[own].sum() < GOES_ON:
            found[label - 1] = _in_windows(points[own], groups, rng)
    return found


def by_chance(log_nfa: Floats, groups: int) -> Flags:
    """Which groups [m] are no motions.

    All are none if their probabilities together, by Fisher's method, are above ``LEVEL``. Where
    there is motion, those are none of which one or more is expected by chance.

    Parameters
    ----------
    log_nfa : ndarray [m]
        As of ``log_false_alarms_of_groups``; groups with NaN are motions.
    groups : int
        Number of groups that were tested.
    """
    known = log_nfa[~np.isnan(log_nfa)] - math.log(groups)
    noise = len(known) > 0 and log_combined(known) > math.log(LEVEL)
    return np.asarray((log_nfa >= 0) | (noise & ~np.isnan(log_nfa)))


def log_combined(log_probabilities: Floats) -> float:
    """Logarithm of the probability of so small a product of probabilities [m], m at least 1.

    Fisher's method: minus twice the logarithm of the product has a chi-square distribution with
    2 m degrees of freedom.
    """
    half = -float(np.minimum(log_probabilities, 0.0).sum())
    k = np.arange(len(log_probabilities))
    logs = k * math.log(half + TINY) - np.array([math.lgamma(i + 1) for i in k.tolist()])
    top = float(logs.max())
    return min(top + math.log(float(np.exp(logs - top).sum())) - half, 0.0)


def _in_windows(points: Floats, groups: int, rng: np.random.Generator) -> float:
    """Of one group of tracks [n, F, 2]: that of its windows together; NaN without any."""
    visible = np.asarray(np.isfinite(points).all(axis=2))
    complete = visible.all(axis=1)
    if 2 * complete.sum() > len(points) and complete.sum() > FLAT_DIMENSION + 1:
        return log_false_alarms_of_group(points[complete], groups, rng)
    length = window_length(visible)
    found = []
    for start in window_starts(points.shape[1], length).tolist():
        frames = slice(start, start + length)
        tracks = np.flatnonzero(visible[:, frames].all(axis=1))
        if len(tracks) >= MIN_WINDOW_TRACKS:
            found.append(log_false_alarms_of_group(points[tracks, frames], 1, rng))
    return math.log(groups) + log_combined(np.array(found)) if found else math.nan


def log_false_alarms_of_group(points: Floats, groups: int, rng: np.random.Generator) -> float:
    """Logarithm of the expected number of ``groups`` as coherent by chance as this one.

    Parameters
    ----------
    points : ndarray [n, F, 2]
        Complete tracks of one group, in pixels.
    groups : int
        Number of groups that are tested.
    rng : numpy.random.Generator
        Draws the surrogates and the flats.

    Returns
    -------
    float
        Nats; below 0 the group is a motion, if there are motions (``by_chance``).
    """
    if len(points) <= FLAT_DIMENSION + 1:
        return math.inf
    if len(points) > MOST_TRACKS:
        points = points[np.sort(rng.choice(len(points), MOST_TRACKS, replace=False))]
    turned = turned_paths if moves(points) else turned_steps

    def draw(count: int) -> list[float]:
        return [coherence(turned(points, rng), rng) for _ in range(count)]

    null, own = draw(SURROGATES), coherence(points, rng)
    found = log_probability_below(own, np.array(null))
    if DECIDED[0] < found < DECIDED[1]:
        found = log_probability_below(own, np.array(null + draw(MORE_SURROGATES)))
    return math.log(groups) + found


def moves(points: Floats) -> bool:
    """Whether a group of tracks [n, F, 2] moves by more than its noise and what is resolved."""
    # a tracker that drifts by less than what is resolved does not move
    least = np.maximum(MOVING * noise_of_tracks(points), LEAST_SPREAD * extent(points))
    return bool(np.median(spread_of_tracks(points) - least) > 0)


def coherence(points: Floats, rng: np.random.Generator) -> float:
    """Median logarithm of the residuals of tracks [n, F, 2]; smaller where they move together."""
    return float(np.median(np.log(LocalFlats(points, rng).own_residuals() + TINY)))


def turned_paths(points: Floats, rng: np.random.Generator) -> Floats:
    """Tracks [n, F, 2] with the same starts and paths, each turned about its start at random."""
    starts = _starts(points)
    path = _complex(points - starts) * _random_turns(rng, len(points), 1)
    return np.asarray(starts + _real(path))


def turned_steps(points: Floats, rng: np.random.Generator) -> Floats:
    """Tracks [n, F, 2] with the same starts and lengths of steps, whose directions are random."""
    steps = _complex(np.diff(points, axis=1))
    turned = steps * _random_turns(rng, *steps.shape)
    path = np.cumsum(np.where(np.isfinite(turned), turned, 0.0), axis=1)
    path = np.concatenate([np.zeros((len(points), 1)), path], axis=1)
    return np.where(np.isfinite(points), _starts(points) + _real(path), np.nan)


def _starts(points: Floats) -> Floats:
    """The first visible position of each track, [n, 1, 2]."""
    first = np.isfinite(points).all(axis=2).argmax(axis=1)
    return np.asarray(points[np.arange(len(points)), first][:, None])


def _random_turns(rng: np.random.Generator, *shape: int) -> Array:
    return np.asarray(np.exp(2j * np.pi * rng.random(shape)))


def _complex(vectors: Floats) -> Array:
    """Vectors [..., 2] as complex numbers [...]."""
    return np.asarray(vectors[..., 0] + 1j * vectors[..., 1])


def _real(numbers: Array) -> Floats:
    """Complex numbers [...] as vectors [..., 2]."""
    return np.stack([numbers.real, numbers.imag], axis=-1)


def log_probability_below(value: float, null: Floats) -> float:
    """Logarithm of the probability that one more draw is as small as ``value``.

    For draws ``null`` [n] of a normal distribution whose mean and variance are not known.
    """
    spread = float(null.std(ddof=1)) * math.sqrt(1 + 1 / len(null)) + TINY
    t = (value - float(null.mean())) / spread
    above = student_t_tail(abs(t), len(null) - 1)
    return math.log(above if t < 0 else 1 - above)
