"""Compensation of the small rotation of a camera that is supposed to translate.

Half a degree between two frames moves a distant background by several pixels, more than the noise
across its epipolar lines, and equation (25) no longer holds. The rotation is estimated from the
matches: it is the one with which a few translations describe all of them best. A single translation
is not enough, because the rotation would then compensate for other motions: the static background
may be only a third of the matches.
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.epipolar import (
    cheirality_residual_sq,
    cross,
    rotated_translation_jacobian,
    step_rotated_translation,
    translation_errors,
)
from mssegment.geometry.levenberg_marquardt import State, damped_step, minimize
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import degrees, rotate_rays, rotation, step_on_sphere
from mssegment.models.translation import Translation
from mssegment.neighbours import nearest
from mssegment.records import Camera, Floats, Integers, Record

SUBSETS, SUBSET_SIZE, SUBSET_FIT_ROUNDS = 400, 7, 8
"""Number and size of the subsets to which a rotation is fitted: two matches more than there are
parameters; and rounds of the fit. Half of the subsets are from one region with a quarter of the
matches."""
SAMPLED_MATCHES = 250
"""Matches on which the candidates are evaluated."""
CANDIDATES_PER_SCALE = 3
"""Rotations, per scale, that are evaluated with several motions."""
SCALES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Scales of the residuals of a motion that are tried, in pixels: from a good tracker on the static
background to an object that rotates slightly."""
SEEDS, GROUP_NEIGHBOURS = 100, 8
"""Number of groups of neighbouring matches to which a translation is fitted, and neighbours in
each."""
MAX_MOTIONS = 5
"""Maximum number of translations."""
REFINED_CANDIDATES = 2
"""Number of candidates, the best ones, that are fitted to all matches."""
CANDIDATE_ROUNDS, REFINEMENT_ROUNDS, GAUSS_NEWTON_STEPS = 1, 6, 3
"""Rounds of alternation between motions and rotation: for every candidate, and at most for the best
ones; and Gauss-Newton steps per round."""
DOMINANT_FIT_ROUNDS, INLIER_MEDIANS = 10, 4.0
"""Rounds of the fit to the largest motion alone; its inliers have residuals below this many
medians."""
SUPPORT_PIXELS, MIN_SUPPORT_SHARE = 1.0, 0.25
"""The largest motion must explain at least this share of the matches to this residual in pixels;
less is chance."""
RIDGE = 1e-6
"""Share of the diagonal added to the normal equations, which are singular if two motions are
equal."""
MIN_DISPLACEMENT = 2.0
"""Matches that moved less, in pixels, do not constrain a direction."""
MAX_DEGREES = 10.0
"""Largest rotation in degrees; a camera that rotates more is not supposed to translate."""
NO_DIRECTIONS = np.zeros((0, 3))


class RotationCompensation(Record, frozen=True):
    """The rotation of a camera between two views.

    Attributes
    ----------
    rotation : ndarray [3, 3]
        Maps rays of view 2 to the orientation of view 1.
    degrees : float
        Its angle in degrees.
    share : float
        Share of the matches that the largest motion then explains to a pixel.
    """

    rotation: Floats
    degrees: float
    share: float


class _Matches(Record, frozen=True):
    """Rays (x, y, 1) of both views, [P, 3], and what is needed to evaluate motions.

    ``focal`` is the focal length and ``extent`` that of the displacements, both in pixels;
    ``groups`` [S, k] are neighbouring matches.
    """

    first: Floats
    second: Floats
    focal: float
    extent: float
    groups: Integers


class _Motions(Record, frozen=True):
    """A few translations: ``directions`` [m, 3] and ``scales`` [m] (pixels).

    ``labels`` [P] is the motion of each match (-1: none), ``saved`` the description length in nats
    that the motions save.
    """

    directions: Floats
    scales: Floats
    labels: Integers
    saved: float


def find_rotation(
    points: Floats, camera: Camera, rng: np.random.Generator
) -> RotationCompensation | None:
    """Estimate the rotation of a camera between two views.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.
    camera : Camera
        The calibration.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    RotationCompensation or None
        None if the rotation is not small, if it saves less than its three parameters cost, or if no
        motion explains enough matches to rely on it.
    """
    model = Translation()
    normalization = model.normalization(points, camera)
    moved = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    if np.count_nonzero(moved >= MIN_DISPLACEMENT) <= SUBSET_SIZE:
        return None
    matches = homogeneous(model.observe(points, normalization))
    extent = 2 * float(moved.max())
    every = _matches(points, matches, normalization.scale, extent, np.arange(len(points)))
    chosen = np.sort(rng.permutation(len(points))[:SAMPLED_MATCHES])
    sample = _matches(points, matches, normalization.scale, extent, chosen)
    candidates = _candidates(points, every, sample, rng)
    # the first candidate is no rotation, which is the most likely one a priori
    first = [_alternate(sample, one, CANDIDATE_ROUNDS) for one in candidates]
    order = np.argsort([motions.saved for _, motions in first])
    best = sorted({0, *order[-REFINED_CANDIDATES:].tolist()})
    refined = [_alternate(every, first[i][0], REFINEMENT_ROUNDS) for i in best]
    found, motions = max(refined, key=lambda pair: pair[1].saved)
    found, share = _fit_dominant(every, found, motions)
    unrotated = _motions(every, np.eye(3), motions.directions)
    angle, saved = float(degrees(found)), motions.saved - unrotated.saved
    # three parameters within MAX_DEGREES, to the precision that the largest motion allows
    largest = np.bincount(motions.labels + 1)[1:].max(initial=1)
    scale = float(motions.scales[0]) if len(motions.scales) else 1.0
    span = np.radians(2 * MAX_DEGREES) * normalization.scale
    cost = 3 * np.log(span * np.sqrt(largest) / scale)
    supported = share >= MIN_SUPPORT_SHARE and angle < MAX_DEGREES
    return RotationCompensation(found, angle, share) if supported and saved > cost else None


def _matches(
    points: Floats, matches: Floats, focal: float, extent: float, chosen: Integers
) -> _Matches:
    """The ``chosen`` matches, and groups of neighbours in the space of (x, y, x', y')."""
    flat = points[chosen].reshape(len(chosen), 4)
    moved = np.flatnonzero(np.linalg.norm(flat[:, 2:] - flat[:, :2], axis=1) >= MIN_DISPLACEMENT)
    seeds = moved[:: max(1, len(moved) // SEEDS)]
    _, groups = nearest(flat, flat[seeds], min(GROUP_NEIGHBOURS + 1, len(flat)))
    rays = matches[chosen]
    return _Matches(rays[:, 0], rays[:, 1], focal, extent, groups)


def _candidates(
    points: Floats, every: _Matches, sample: _Matches, rng: np.random.Generator
) -> Floats:
    """No rotation, and the rotations of subsets that explain the ``sample`` best, [n, 3, 3]."""
    subsets = _subsets(points, rng)
    first, second = every.first[subsets], every.second[subsets]
    rows = cross(first, second)
    starts = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)[1][:, :, 0]
    # uncompensated rotation looks like sideways translation: also start straight ahead
    starts[::2] = [0.0, 0.0, 1.0]
    directions, rotations = _fit_rotated_translations(starts, first, second)
    small = degrees(rotations) < MAX_DEGREES
    directions, rotations = directions[small], rotations[small]
    errors = translation_errors(directions, sample.first, rotate_rays(sample.second, rotations))
    squares = [cheirality_residual_sq(*errors, sign) for sign in (1.0, -1.0)]
    chosen: set[int] = set()
    for scale in SCALES:
        saved = [np.maximum(_gains(q, sample, scale), 0.0).sum(axis=1) for q in squares]
        chosen |= set(
            np.argsort(-np.maximum(*saved), kind="stable")[:CANDIDATES_PER_SCALE].tolist()
        )
    return np.concatenate([np.eye(3)[None], rotations[sorted(chosen)]])


def _fit_rotated_translations(
    starts: Floats, first: Floats, second: Floats
) -> tuple[Floats, Floats]:
    """Least squares of (t, R) for subsets of rays [B, k, 3], from t = ``starts`` [B, 3], R = I."""

    def linearize(state: State, rows: Integers) -> tuple[Floats, Floats]:
        directions, rotations = state
        return rotated_translation_jacobian(directions, rotations, first[rows], second[rows])

    def retract(state: State, steps: Floats) -> State:
        directions, rotations = state
        return step_rotated_translation(directions, rotations, steps)

    rotations = np.tile(np.eye(3), (len(starts), 1, 1))
    directions, rotations = minimize(
        (starts, rotations), linearize, retract, rounds=SUBSET_FIT_ROUNDS
    )
    return directions, rotations


def _subsets(points: Floats, rng: np.random.Generator) -> Integers:
    """Subsets of matches [SUBSETS, SUBSET_SIZE], half uniform, half from one region each."""
    count = len(points)
    half = SUBSETS // 2
    uniform = rng.random((half, count)).argsort(axis=1)[:, :SUBSET_SIZE]
    flat = points.reshape(count, 4)
    size = max(count // 4, SUBSET_SIZE)
    _, near = nearest(flat, flat[rng.integers(count, size=SUBSETS - half)], size)
    order = rng.random(near.shape).argsort(axis=1)[:, :SUBSET_SIZE]
    return np.concatenate([uniform, np.take_along_axis(near, order, axis=1)]).astype(np.int64)


def _gains(squares: Floats, matches: _Matches, scale: float) -> Floats:
    """Nats saved, relative to a uniform code, by Cauchy distributed residuals of this scale.

    ``squares`` are squared residuals in normalized coordinates.
    """
    spread = np.log1p(squares * (matches.focal / scale) ** 2)
    return np.asarray(np.log(matches.extent / (np.pi * scale)) - spread)


def _motions(matches: _Matches, camera_rotation: Floats, known: Floats = NO_DIRECTIONS) -> _Motions:
    """The translations, at most ``MAX_MOTIONS``, that describe the rotated matches best.

    Candidates are the ``known`` directions [n, 3] and those fitted to groups of neighbours. They
    are selected greedily, the one that saves most first.
    """
    first, second = matches.first, rotate_rays(matches.second, camera_rotation[None])[0]
    rows = cross(first, second)[matches.groups]
    directions = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)[1][:, :, 0]
    directions = np.concatenate([known, directions])
    count = len(directions)
    error, along = translation_errors(directions, first, second)
    # the sign of a direction is that of the matches it was fitted to
    fitted = np.take_along_axis(along[len(known) :], matches.groups, axis=1).sum(axis=1)
    sign = np.concatenate([along[: len(known)].sum(axis=1), fitted])
    sign = np.where(sign < 0, -1.0, 1.0)[:, None]
    squares = cheirality_residual_sq(error, along, sign)
    table = np.concatenate([_gains(squares, matches, s) for s in SCALES]).astype(np.float32)
    # a direction is coded to the precision of the residuals
    costs = np.repeat(2 * np.log(matches.extent / np.array(SCALES)), count)
    found = _Motions(NO_DIRECTIONS, np.zeros(0), np.full(len(first), -1), 0.0)
    gains, chosen = np.zeros((1, len(first)), np.float32), []
    for _ in range(MAX_MOTIONS):
        values = np.maximum(table, gains.max(axis=0)).sum(axis=1) - costs
        chosen.append(int(values.argmax()))
        gains = np.concatenate([gains, table[chosen[-1:]]])
        labels = gains.argmax(axis=0) - 1
        saved = float(gains.max(axis=0).sum() - costs[chosen].sum()) - _entropy(labels)
        if saved <= found.saved:
            break
        index = np.array(chosen)
        scales = np.array(SCALES)[index // count]
        found = _Motions(directions[index % count], scales, labels, saved)
    return found


def _entropy(labels: Integers) -> float:
    """Nats to code the labels [P], which start at -1, by their frequencies."""
    count = np.bincount(labels + 1)
    used = count[count > 0]
    return float(-(used * np.log(used / len(labels))).sum())


def _alternate(matches: _Matches, camera_rotation: Floats, rounds: int) -> tuple[Floats, _Motions]:
    """Alternate between the rotation given the motions and the motions given the rotation."""
    motions = _motions(matches, camera_rotation)
    best, rounds_without_gain = (camera_rotation, motions), 0
    for _ in range(rounds):
        if not len(motions.directions) or rounds_without_gain > 1:
            break
        camera_rotation, directions = _common_rotation(matches, camera_rotation, motions)
        motions = _motions(matches, camera_rotation, directions)
        gained = motions.saved > best[1].saved + 1
        rounds_without_gain = 0 if gained else rounds_without_gain + 1
        if motions.saved > best[1].saved:
            best = camera_rotation, motions
    return best


def _fit_dominant(
    matches: _Matches, camera_rotation: Floats, motions: _Motions
) -> tuple[Floats, float]:
    """Fit the rotation to the largest motion alone, since other objects may rotate slightly.

    Inliers are selected again after each step. The old rotation is kept if the other motions lose
    more than one direction costs. The second result is the share of all matches that the motion
    explains to a pixel.
    """
    if not len(motions.directions):
        return camera_rotation, 0.0
    direction, rotations = motions.directions[:1], camera_rotation[None]
    scale = motions.scales[0] / matches.focal
    square = _squared_residuals(matches, direction, rotations)
    for _ in range(DOMINANT_FIT_ROUNDS):
        inliers = square < (INLIER_MEDIANS * scale) ** 2
        if inliers.sum() <= SUBSET_SIZE:
            break
        scale = max(float(np.sqrt(np.median(square[inliers]))), SCALES[0] / matches.focal / 2)
        error, jacobian = rotated_translation_jacobian(
            direction, rotations, matches.first[inliers], matches.second[inliers]
        )
        weights = 1 / np.sqrt(scale**2 + error**2)
        steps = damped_step(jacobian * weights[..., None], error * weights, np.full(1, RIDGE))
        direction, rotations = step_rotated_translation(direction, rotations, steps)
        square = _squared_residuals(matches, direction, rotations)
    share = float((square < (SUPPORT_PIXELS / matches.focal) ** 2).mean())
    known = np.concatenate([direction, motions.directions[1:]])
    loss = motions.saved - _motions(matches, rotations[0], known).saved
    accepted = loss < 2 * np.log(matches.extent / SCALES[0])
    return (rotations[0] if accepted else camera_rotation), share


def _squared_residuals(matches: _Matches, direction: Floats, rotations: Floats) -> Floats:
    """Squared residuals [P] of one motion, with the sign of most matches."""
    error, along = translation_errors(
        direction, matches.first, rotate_rays(matches.second, rotations)
    )
    inliers = np.abs(error) < SUPPORT_PIXELS / matches.focal
    sign = -1.0 if (inliers * along).sum() < 0 else 1.0
    return np.asarray(cheirality_residual_sq(error, along, sign)[0])


def _common_rotation(
    matches: _Matches, camera_rotation: Floats, motions: _Motions
) -> tuple[Floats, Floats]:
    """Fit the rotation [3, 3] and all directions [m, 3] by Gauss-Newton with Cauchy weights."""
    directions = motions.directions
    unknowns = 3 + 2 * len(directions)
    members = [np.flatnonzero(motions.labels == j) for j in range(len(directions))]
    for _ in range(GAUSS_NEWTON_STEPS):
        normal, side = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
        for j, tracks in enumerate(members):
            if not len(tracks):
                continue
            error, jacobian = rotated_translation_jacobian(
                directions[[j]],
                camera_rotation[None],
                matches.first[tracks],
                matches.second[tracks],
            )
            # the scale of a Cauchy distribution is the median of the absolute values
            scale = max(float(np.median(np.abs(error[0]))), SCALES[0] / matches.focal)
            weights = 1 / (scale**2 + error[0] ** 2)
            index = np.array([3 + 2 * j, 4 + 2 * j, 0, 1, 2])
            normal[np.ix_(index, index)] += (jacobian[0].T * weights) @ jacobian[0]
            side[index] += (jacobian[0].T * weights) @ error[0]
        normal += np.diag(RIDGE * np.diag(normal) + 1e-18)
        steps = np.asarray(-np.linalg.solve(normal, side), dtype=np.float64)
        directions = step_on_sphere(directions, steps[3:].reshape(-1, 2))
        camera_rotation = rotation(steps[:3]) @ camera_rotation
    return camera_rotation, directions
