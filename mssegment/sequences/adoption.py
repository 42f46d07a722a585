"""Tracks of no group that lie on an object and move with it.

The groups of a window are found so that their tracks agree over all of their frames: a track that
begins while its window of the picture still shows the border of something, or slips once, is none
of them. Most of its frames say whose it is.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import NOT_JUDGED, OUTLIER, Floats, Integers
from mssegment.sequences.body_frame import CONNECTED, LEAST_TRACKS, BodyFrame, spacing_of
from mssegment.sequences.membership import DEVIATIONS, HALF_STEP, predicted
from mssegment.sequences.parts import LARGEST_RELIEF
from mssegment.special import nan_median


def adopted(points: Floats, labels: Integers, shown: Flags) -> Integers:
    """Label the tracks of no group that lie on one and move with it in most of their frames.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups, ``OUTLIER`` or ``NOT_JUDGED`` for the tracks that may be labelled.
    shown : ndarray [P, F] of bool
        The frames in which each track moves with its group (``membership.members``).

    Returns
    -------
    ndarray [P] of int64
        The labels; of several groups it is the one that agrees best.
    """
    visible = np.asarray(np.isfinite(points[..., 0]))
    free = (labels == OUTLIER) | (labels == NOT_JUDGED)
    rows = np.flatnonzero(free & (visible.sum(axis=1) > 1))
    found, best = labels.copy(), np.full(len(labels), 0.5)
    for label in range(1, int(labels.max(initial=0)) + 1):
        own = np.flatnonzero(labels == label)
        near = rows[_lies_on(points[own], shown[own], points[rows])]
        share = _agreement(points[own], shown[own], points[near])
        better = near[share > best[near]]
        found[better], best[better] = label, share[share > best[near]]
    return found


def _lies_on(own: Floats, shown: Flags, others: Floats) -> Flags:
    """Which of some tracks [n, F, 2] lie among those of a group, in the frame that moves along."""
    body = BodyFrame.of(own, shown)
    reach = CONNECTED * spacing_of(own, shown)
    found = np.zeros(len(others), dtype=bool)
    for episode in np.unique(body.episodes[body.episodes >= 0]):
        frames = np.flatnonzero(body.episode == episode)
        seen = np.isfinite(others[:, frames, 0])
        some = np.flatnonzero(seen.any(axis=1))
        if not len(some):
            continue
        places = nan_median(others[some][:, frames] - body.path[frames], axis=1)
        distance, _ = nearest(body.places[body.episodes == episode], places)
        found[some] |= distance[:, 0] <= reach
    return found


def _agreement(own: Floats, shown: Flags, others: Floats) -> Floats:
    """The share of the moments that show a group moving in which each track [n, F, 2] does too."""
    visible = np.asarray(np.isfinite(others[..., 0]))
    frames = own.shape[1]
    agree, judged = np.zeros(len(others)), np.zeros(len(others))
    for low in range(0, frames - 1, HALF_STEP):
        high = min(frames - 1, low + HALF_STEP)
        known = shown[:, low] & shown[:, high]
        here = visible[:, low : high + 1]
        start = low + here.argmax(axis=1)
        end = high - here[:, ::-1].argmax(axis=1)
        rows = np.flatnonzero(here.any(axis=1) & (start < end))
        if known.sum() < LEAST_TRACKS or not len(rows):
            continue
        start, end = start[rows], end[rows]
        whole = own[known, high] - own[known, low]
        expected, noise = predicted(own[known, low], whole, others[rows, start])
        part = (end - start) / (high - low)
        expected = expected * part[:, None]
        moved = others[rows, end] - others[rows, start]
        speed = np.linalg.norm(expected, axis=1)
        moves = speed > DEVIATIONS * noise
        judged[rows[moves]] += 1
        fits = moves & (np.linalg.norm(moved - expected, axis=1) <= LARGEST_RELIEF * speed)
        agree[rows[fits]] += 1
    return np.asarray(agree / np.maximum(judged, 1))
