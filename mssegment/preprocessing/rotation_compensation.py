"""The small rotation of a camera that was meant to translate.

Half a degree between two frames moves a far background by several pixels and by more than the
noise across its epipolar lines, so that equation (25) holds for nothing any more. The rotation is
found from the matches themselves: it is the one under which a few translations describe them all
best. One translation alone would not do, because the rotation then makes up for what other bodies
do: the static world may be a third of the matches.
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

SUBSETS, SUBSET_SIZE, ROUNDS = 400, 7, 8
"""Subsets that a rotation is fitted to, and their size: two matches more than there are parameters.
Half of them come from a neighbourhood that holds a quarter of the matches."""
SAMPLE = 250
"""Matches that the candidates are judged by."""
CANDIDATES = 3
"""Rotations, per scale, that are judged by all bodies."""
SCALES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Scales of a body's residuals that are tried, pixels: from a good tracker on the static world to a
body that turns a little itself."""
SEEDS, NEIGHBOURS = 100, 8
"""Places where a translation is fitted, and the nearest matches that it is fitted to."""
BODIES = 5
REFINED = 2
"""Candidates, the best ones, that are fitted to all matches."""
SETTLING, REFINEMENTS, STEPS = 1, 6, 3
"""Turns of bodies and rotation for every candidate, and at most for the best ones; each turn has a
few steps of Gauss-Newton."""
POLISHINGS, NEAR = 10, 4.0
"""Steps on the largest motion alone, and how far its matches reach, in medians."""
PIXEL, LEAST_SHARE = 1.0, 0.25
"""The largest motion must explain such a share of the matches within a pixel; less is chance."""
RIDGE = 1e-6
"""Share of the diagonal of the normal equations that is added: two bodies may be one."""
LEAST_MOTION = 2.0
"""Pixels; a match that moved less says nothing about a direction."""
LARGEST = 10.0
"""Degrees; a camera that turns more was not meant to translate."""
NONE = np.zeros((0, 3))


class RotationCompensation(Record, frozen=True):
    """``rotation`` [3, 3] turns rays of frame 2 into the orientation of frame 1; ``degrees``.

    ``share`` of the matches fit the largest motion within a pixel after it.
    """

    rotation: Floats
    degrees: float
    share: float


class _Matches(Record, frozen=True):
    """Rays (x, y, 1) of both views [P, 3], the ``focal`` length in pixels and, in pixels, the
    ``extent`` of the displacements; ``groups`` [S, k] are matches that lie together."""

    first: Floats
    second: Floats
    focal: float
    extent: float
    groups: Integers


class _Bodies(Record, frozen=True):
    """A few translations: ``directions`` [m, 3], ``scales`` [m] (pixels), the body of each match
    ``labels`` [P] (-1: none), and the nats that they ``saved``."""

    directions: Floats
    scales: Floats
    labels: Integers
    saved: float


def find_rotation(
    points: Floats, camera: Camera, rng: np.random.Generator
) -> RotationCompensation | None:
    """The rotation of the camera between two views, from matches [P, 2, 2] (pixels).

    None where the rotation is not small, where it saves less than its three parameters cost, or
    where no motion explains enough matches to trust it.
    """
    model = Translation()
    normalization = model.normalization(points, camera)
    moved = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    if np.count_nonzero(moved >= LEAST_MOTION) <= SUBSET_SIZE:
        return None
    matches = homogeneous(model.observe(points, normalization))
    extent = 2 * float(moved.max())
    every = _matches(points, matches, normalization.scale, extent, np.arange(len(points)))
    some = np.sort(rng.permutation(len(points))[:SAMPLE])
    sample = _matches(points, matches, normalization.scale, extent, some)
    candidates = _candidates(points, every, sample, rng)
    # no rotation is the first candidate, and the likeliest before anything is seen
    settled = [_refined(sample, one, SETTLING) for one in candidates]
    best = sorted({0, *np.argsort([one[1].saved for one in settled])[-REFINED:].tolist()})
    refined = [_refined(every, settled[one][0], REFINEMENTS) for one in best]
    found, bodies = max(refined, key=lambda pair: pair[1].saved)
    found, share = _polished(every, found, bodies)
    unturned = _bodies(every, np.eye(3), bodies.directions)
    angle, saved = float(degrees(found)), bodies.saved - unturned.saved
    # three parameters, each to the precision that the largest body gives, within the largest turn
    largest = np.bincount(bodies.labels + 1)[1:].max(initial=1)
    scale = float(bodies.scales[0]) if len(bodies.scales) else 1.0
    span = np.radians(2 * LARGEST) * normalization.scale
    price = 3 * np.log(span * np.sqrt(largest) / scale)
    fits = share >= LEAST_SHARE and angle < LARGEST
    return RotationCompensation(found, angle, share) if fits and saved > price else None


def _matches(
    points: Floats, matches: Floats, focal: float, extent: float, chosen: Integers
) -> _Matches:
    """The ``chosen`` matches, grouped with their neighbours in the space of (x, y, x', y')."""
    own = points[chosen].reshape(len(chosen), 4)
    moved = np.flatnonzero(np.linalg.norm(own[:, 2:] - own[:, :2], axis=1) >= LEAST_MOTION)
    seeds = moved[:: max(1, len(moved) // SEEDS)]
    _, groups = nearest(own, own[seeds], min(NEIGHBOURS + 1, len(own)))
    both = matches[chosen]
    return _Matches(both[:, 0], both[:, 1], focal, extent, groups)


def _candidates(
    points: Floats, every: _Matches, sample: _Matches, rng: np.random.Generator
) -> Floats:
    """No rotation, and the rotations of subsets that explain most of the ``sample``, [n, 3, 3]."""
    subsets = _subsets(points, rng)
    first, second = every.first[subsets], every.second[subsets]
    rows = cross(first, second)
    starts = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)[1][:, :, 0]
    # the shift of a camera that turned looks sideways: start from straight ahead as well
    starts[::2] = [0.0, 0.0, 1.0]
    directions, rotations = _fit_rotated_translations(starts, first, second)
    small = degrees(rotations) < LARGEST
    directions, rotations = directions[small], rotations[small]
    fit = translation_errors(directions, sample.first, rotate_rays(sample.second, rotations))
    squares = [cheirality_residual_sq(*fit, sign) for sign in (1.0, -1.0)]
    chosen: set[int] = set()
    for scale in SCALES:
        saved = [np.maximum(_gains(q, sample, scale), 0.0).sum(axis=1) for q in squares]
        chosen |= set(np.argsort(-np.maximum(*saved), kind="stable")[:CANDIDATES].tolist())
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
    directions, rotations = minimize((starts, rotations), linearize, retract, rounds=ROUNDS)
    return directions, rotations


def _subsets(points: Floats, rng: np.random.Generator) -> Integers:
    """Matches [SUBSETS, SUBSET_SIZE], half of the subsets from all over, half from one region."""
    count = len(points)
    half = SUBSETS // 2
    anywhere = rng.random((half, count)).argsort(axis=1)[:, :SUBSET_SIZE]
    flat = points.reshape(count, 4)
    around = max(count // 4, SUBSET_SIZE)
    _, near = nearest(flat, flat[rng.integers(count, size=SUBSETS - half)], around)
    places = rng.random(near.shape).argsort(axis=1)[:, :SUBSET_SIZE]
    return np.concatenate([anywhere, np.take_along_axis(near, places, axis=1)]).astype(np.int64)


def _gains(squares: Floats, matches: _Matches, scale: float) -> Floats:
    """Nats saved against a uniform code by residuals with a Cauchy distribution of this scale.

    ``squares`` of residuals in normalised coordinates.
    """
    spread = np.log1p(squares * (matches.focal / scale) ** 2)
    return np.asarray(np.log(matches.extent / (np.pi * scale)) - spread)


def _bodies(matches: _Matches, turned: Floats, known: Floats = NONE) -> _Bodies:
    """The translations, at most BODIES, that describe the matches best under the turn [3, 3].

    Candidates are the ``known`` directions [n, 3] and those fitted to groups of neighbours; the one
    that saves most comes first, and so on.
    """
    first, second = matches.first, rotate_rays(matches.second, turned[None])[0]
    rows = cross(first, second)[matches.groups]
    directions = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)[1][:, :, 0]
    directions = np.concatenate([known, directions])
    count = len(directions)
    error, along = translation_errors(directions, first, second)
    # each direction points where the matches go that it was fitted to
    fitted = np.take_along_axis(along[len(known) :], matches.groups, axis=1).sum(axis=1)
    sign = np.concatenate([along[: len(known)].sum(axis=1), fitted])
    sign = np.where(sign < 0, -1.0, 1.0)[:, None]
    squares = cheirality_residual_sq(error, along, sign)
    table = np.concatenate([_gains(squares, matches, s) for s in SCALES]).astype(np.float32)
    # a direction is stated to the precision of the residuals
    prices = np.repeat(2 * np.log(matches.extent / np.array(SCALES)), count)
    found = _Bodies(NONE, np.zeros(0), np.full(len(first), -1), 0.0)
    gains, chosen = np.zeros((1, len(first)), np.float32), []
    for _ in range(BODIES):
        values = np.maximum(table, gains.max(axis=0)).sum(axis=1) - prices
        chosen.append(int(values.argmax()))
        gains = np.concatenate([gains, table[chosen[-1:]]])
        labels = gains.argmax(axis=0) - 1
        value = float(gains.max(axis=0).sum() - prices[chosen].sum()) - _entropy(labels)
        if value <= found.saved:
            break
        index = np.array(chosen)
        scales = np.array(SCALES)[index // count]
        found = _Bodies(directions[index % count], scales, labels, value)
    return found


def _entropy(labels: Integers) -> float:
    """Nats to state the labels [P], from -1, by the frequency of each."""
    count = np.bincount(labels + 1)
    used = count[count > 0]
    return float(-(used * np.log(used / len(labels))).sum())


def _refined(matches: _Matches, turned: Floats, rounds: int) -> tuple[Floats, _Bodies]:
    """The turn fitted to all bodies together, and the bodies under the turn, by turns."""
    bodies = _bodies(matches, turned)
    best, idle = (turned, bodies), 0
    for _ in range(rounds):
        if not len(bodies.directions) or idle > 1:
            break
        turned, directions = _common_turn(matches, turned, bodies)
        bodies = _bodies(matches, turned, directions)
        idle = 0 if bodies.saved > best[1].saved + 1 else idle + 1
        if bodies.saved > best[1].saved:
            best = turned, bodies
    return best


def _polished(matches: _Matches, turned: Floats, bodies: _Bodies) -> tuple[Floats, float]:
    """The turn [3, 3] fitted to the largest motion alone: others may turn a little themselves.

    Its matches are those within its own noise, found again after each step. The turn is kept as it
    is where the other bodies lose more by it than one direction costs. The second result is the
    share of all matches that the motion explains to a pixel.
    """
    if not len(bodies.directions):
        return turned, 0.0
    direction, rotations = bodies.directions[:1], turned[None]
    scale = bodies.scales[0] / matches.focal
    square = _squares(matches, direction, rotations)
    for _ in range(POLISHINGS):
        own = square < (NEAR * scale) ** 2
        if own.sum() <= SUBSET_SIZE:
            break
        scale = max(float(np.sqrt(np.median(square[own]))), SCALES[0] / matches.focal / 2)
        error, jacobian = rotated_translation_jacobian(
            direction, rotations, matches.first[own], matches.second[own]
        )
        weights = 1 / np.sqrt(scale**2 + error**2)
        steps = damped_step(jacobian * weights[..., None], error * weights, np.full(1, RIDGE))
        direction, rotations = step_rotated_translation(direction, rotations, steps)
        square = _squares(matches, direction, rotations)
    share = float((square < (PIXEL / matches.focal) ** 2).mean())
    known = np.concatenate([direction, bodies.directions[1:]])
    loss = bodies.saved - _bodies(matches, rotations[0], known).saved
    taken = loss < 2 * np.log(matches.extent / SCALES[0])
    return (rotations[0] if taken else turned), share


def _squares(matches: _Matches, direction: Floats, rotations: Floats) -> Floats:
    """Squared distances [P] from the one motion, on the side where most matches go."""
    error, along = translation_errors(
        direction, matches.first, rotate_rays(matches.second, rotations)
    )
    near = np.abs(error) < PIXEL / matches.focal
    sign = -1.0 if (near * along).sum() < 0 else 1.0
    return np.asarray(cheirality_residual_sq(error, along, sign)[0])


def _common_turn(matches: _Matches, turned: Floats, bodies: _Bodies) -> tuple[Floats, Floats]:
    """One turn [3, 3] and the directions of all bodies [m, 3]: Gauss-Newton, Cauchy weights."""
    directions = bodies.directions
    unknowns = 3 + 2 * len(directions)
    members = [np.flatnonzero(bodies.labels == j) for j in range(len(directions))]
    for _ in range(STEPS):
        normal, side = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
        for j, own in enumerate(members):
            if not len(own):
                continue
            error, jacobian = rotated_translation_jacobian(
                directions[[j]], turned[None], matches.first[own], matches.second[own]
            )
            # the scale of a Cauchy distribution is the median
            scale = max(float(np.median(np.abs(error[0]))), SCALES[0] / matches.focal)
            weights = 1 / (scale**2 + error[0] ** 2)
            place = np.array([3 + 2 * j, 4 + 2 * j, 0, 1, 2])
            normal[np.ix_(place, place)] += (jacobian[0].T * weights) @ jacobian[0]
            side[place] += (jacobian[0].T * weights) @ error[0]
        normal += np.diag(RIDGE * np.diag(normal) + 1e-18)
        steps = np.asarray(-np.linalg.solve(normal, side), dtype=np.float64)
        directions = step_on_sphere(directions, steps[3:].reshape(-1, 2))
        turned = rotation(steps[:3]) @ turned
    return turned, directions
