"""Elemental subsets and the hypotheses that they determine: points on the model's manifold.

Sampling is local, because the tracks of one motion are close to each other: a subset is a seed and
some of its nearest neighbours. A hypothesis is kept if further tracks near its seed support it,
which is the validation step of the paper's reference [17].
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import mssegment.models as motion_models
from mssegment.errors import DataError, UsageError
from mssegment.models import Flags, MotionModel
from mssegment.preprocessing.noise import reference_noise
from mssegment.progress import track
from mssegment.records import (
    Camera,
    Floats,
    HypothesisSet,
    Integers,
    Normalization,
    Record,
    State,
    replace,
)
from mssegment.sampling.neighbourhoods import nearest_neighbours, random_subset
from mssegment.sampling.options import DEFAULTS, Count, Sampling, SamplingOptions

SEED_NEIGHBOURS = 12
"""Nearest neighbours of a seed: the subset is drawn from them, and they may support it."""
MIN_SUPPORT = 3
"""Further tracks near the seed that must agree with a hypothesis."""
SUPPORT_TOLERANCE = 0.02
"""Largest residual of a supporting track, relative to the rms radius of all tracks (about 3 px in
640 x 480)."""
SUPPORT_DEVIATIONS = 2.0
"""The same over the measured noise of two views, where it is larger: 86 of 100 normal errors in
the plane are smaller."""
MAX_TOLERANCE_FACTOR = 3.0
"""How many times larger than relative to the radius it may be."""
MAX_TRACKS = 4000
"""Tracks that are sampled; of more, a random subset. If neighbours are too close, the noise of an
elemental subset dominates its motion, and the modes are smeared."""
MIN_HYPOTHESES, MAX_HYPOTHESES = 300, 2000
"""Range of an automatic number of hypotheses."""
MAX_DRAWS_PER_HYPOTHESIS = 60
"""Sampling ends after this many subsets per requested hypothesis."""
LOCAL_OPTIMIZATION_ROUNDS = 2
"""Least-squares rounds on a hypothesis and the tracks that support it."""
SUBSETS_PER_BATCH = 192
"""Subsets fitted at a time; memory is one residual per subset and track."""


class _Scene(Record, frozen=True):
    """The eligible tracks as one model observes them.

    ``observed`` [n, F, 2] are normalized; ``neighbours`` [n, k] are the nearest neighbours of each,
    ``seeds`` those that moved enough; ``tolerance`` is in pixels.
    """

    model: MotionModel
    observed: Floats
    normalization: Normalization
    neighbours: Integers
    seeds: Integers
    tolerance: float


class _Batch(Record, frozen=True):
    """Hypotheses of one batch: ``subsets`` [n, k], ``points`` [n, ...], ``inliers`` [n, P].

    ``valid`` counts the subsets that were not degenerate.
    """

    subsets: Integers
    points: Floats
    inliers: Flags
    valid: int


def hypothesize(
    points: Floats,
    *,
    models: Sequence[str] = ("affine",),
    options: SamplingOptions = DEFAULTS,
    camera: Camera | None = None,
    eligible: Flags | None = None,
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    """Sample motion hypotheses from elemental subsets of tracks.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible. Incomplete tracks are not sampled.
    models : sequence of str
        Names in ``models.MODELS``, one set each.
    options : SamplingOptions
        Rank, number of hypotheses per set, sampling and compensation of rotation. By default
        sampling goes on until further hypotheses explain the tracks no better; the second set of
        two has fewer hypotheses. The default rank is 3. ``model`` is ignored.
    camera : Camera, optional
        The calibration, for models that need one.
    eligible : ndarray [P] of bool, optional
        Tracks that may be sampled; all by default.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    list of HypothesisSet
        One set per model, with fewer hypotheses than requested if no more subsets are supported.
        A model without a supported hypothesis has no set.

    Raises
    ------
    DataError
        If no hypothesis can be computed from the tracks.
    UsageError
        If an argument is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> first = np.random.default_rng(0).uniform(0, 200, (60, 2))
    >>> points = np.stack([first, first + [5.0, 2.0]], axis=1)
    >>> options = SamplingOptions(count=50)
    >>> (found,) = hypothesize(points, options=options, rng=np.random.default_rng(1))
    >>> found.model, found.manifold, found.points.shape
    ('affine', 'affine(2)', (50, 3, 3))
    """
    _check_arguments(models, points, camera, options)
    complete = np.asarray(np.isfinite(points).all(axis=(1, 2)))
    usable = complete if eligible is None else complete & eligible
    indices = np.flatnonzero(random_subset(usable, MAX_TRACKS, rng))
    tracks = points[indices]
    rotation = _camera_rotation(models, tracks, camera, options, rng)
    neighbours: Integers | None = None
    sets = []
    for name in track(models, "models"):
        rank = 3 if options.rank == "auto" else options.rank
        model = motion_models.make(name, frames=points.shape[1], rank=rank)
        _check_tracks(model, len(tracks))
        if neighbours is None:
            neighbours = nearest_neighbours(tracks, SEED_NEIGHBOURS)
        scene = _scene(model, tracks, neighbours, camera, rotation)
        # of two sets the first finds the motions; the second need not be as dense
        smaller = options.count == "auto" and name != models[0]
        count = MIN_HYPOTHESES // 2 if smaller else options.count
        found = _sample(scene, count, options.sampling, rng)
        sets.append(replace(found, subsets=indices[found.subsets]))
    return [found for found in sets if len(found.points)]


def _check_arguments(
    names: Sequence[str], points: Floats, camera: Camera | None, options: SamplingOptions
) -> None:
    """Raise UsageError or DataError for what cannot work."""
    frames = points.shape[1]
    for name in names:
        if name not in motion_models.MODELS:
            known = ", ".join([*motion_models.MODELS, "auto"])
            raise UsageError(f"model: {name!r} is unknown; choose one of {known}")
        model = motion_models.MODELS[name]
        if model.needs_camera and camera is None:
            raise DataError(
                f"model {name} needs a calibrated camera: give camera.fx, camera.fy, camera.cx "
                "and camera.cy (--camera fx,fy,cx,cy, or in Python camera=Camera(fx, fy, cx, cy))"
            )
        if not model.accepts(frames):
            expected = (
                f"{model.max_frames}"
                if model.max_frames == model.min_frames
                else f"at least {model.min_frames}"
            )
            raise DataError(
                f"model {name} needs {expected} frames, but the tracks have {frames}: "
                + _advice(frames)
            )
    if options.count != "auto" and options.count < 1:
        raise UsageError(f"count is {options.count}; expected 1 or more, or auto")
    if options.sampling not in ("local", "uniform"):
        raise UsageError(f"sampling: {options.sampling!r} is unknown; choose local or uniform")


def _advice(frames: int) -> str:
    """What to do if a model does not accept this number of frames."""
    known = [n for n in motion_models.of_pictures() if motion_models.MODELS[n].accepts(frames)]
    if not known:
        return "use more images"
    names = " or ".join([", ".join(known[:-1]), known[-1]] if known[1:] else known)
    return f"choose two frames, or model {names}" if frames > 2 else f"choose model {names}"


def _camera_rotation(
    models: Sequence[str],
    tracks: Floats,
    camera: Camera | None,
    options: SamplingOptions,
    rng: np.random.Generator,
) -> Floats | None:
    """The rotation of the camera to compensate [3, 3], or None."""
    assumed = any(motion_models.MODELS[name].assumes_no_rotation for name in models)
    if options.derotate is False or not assumed or camera is None:
        return None
    from mssegment.preprocessing.rotation_compensation import find_rotation

    found = find_rotation(tracks, camera, rng)
    return None if found is None else found.rotation


def _check_tracks(model: MotionModel, count: int) -> None:
    """Raise DataError if ``count`` eligible tracks are too few."""
    needed = model.subset_size + 1
    if count < needed:
        raise DataError(
            f"model {model.name} needs at least {needed} tracks that move and are visible in every "
            f"frame; found {count}: use more corners or images with more texture, or set "
            "background.remove to no"
        )


def _scene(
    model: MotionModel,
    tracks: Floats,
    neighbours: Integers,
    camera: Camera | None,
    rotation: Floats | None,
) -> _Scene:
    """The tracks [n, F, 2] (pixels) as ``model`` observes them."""
    normalization = model.normalization(tracks, camera)
    if rotation is not None:
        normalization = replace(normalization, rotation=rotation)
    observed = model.observe(tracks, normalization)
    moved = np.linalg.norm(observed - observed[:, :1], axis=-1).max(axis=1) * normalization.scale
    seeds = np.flatnonzero(moved >= model.min_displacement)
    if len(seeds) < model.subset_size:
        raise DataError(
            f"only {len(seeds)} tracks moved {model.min_displacement:g} px or more, but model "
            f"{model.name} needs {model.subset_size}: choose frames further apart"
        )
    radius = np.sqrt(((tracks - tracks.mean(axis=0)) ** 2).sum(axis=-1).mean())
    tolerance = SUPPORT_TOLERANCE * float(radius)
    if tracks.shape[1] == 2:
        # mismatches among the neighbours may make the measured noise too large
        noise = SUPPORT_DEVIATIONS * reference_noise(tracks)
        tolerance = float(np.clip(noise, tolerance, MAX_TOLERANCE_FACTOR * tolerance))
    return _Scene(model, observed, normalization, neighbours, seeds, tolerance)


def _sample(
    scene: _Scene, count: Count, sampling: Sampling, rng: np.random.Generator
) -> HypothesisSet:
    """Sample until there are enough hypotheses, or no more are to be expected."""
    target = MAX_HYPOTHESES if count == "auto" else count
    subsets: list[Integers] = []
    points: list[Floats] = []
    progress = _Progress(np.zeros(len(scene.observed)))
    drawn = kept = valid = 0
    while kept < target and drawn < MAX_DRAWS_PER_HYPOTHESIS * target:
        batch = _draw_batch(scene, sampling, rng)
        subsets.append(batch.subsets)
        points.append(batch.points)
        drawn += SUBSETS_PER_BATCH
        kept += len(batch.points)
        valid += batch.valid
        converged = progress.converged(batch.inliers)
        if count == "auto" and kept >= MIN_HYPOTHESES and converged:
            break
        if drawn >= 20 * SUBSETS_PER_BATCH and kept == 0:
            break
    if valid == 0:
        raise DataError(
            f"all {drawn} elemental subsets are degenerate for model {scene.model.name} (points on "
            "a line, equal or parallel motions): choose frames further apart, or another model"
        )
    return HypothesisSet(
        model=scene.model.name,
        manifold=scene.model.manifold.name,
        frames=tuple(range(scene.observed.shape[1])),
        normalization=scene.normalization,
        subsets=np.concatenate(subsets)[:target],
        points=np.concatenate(points)[:target],
        drawn=drawn,
    )


def _draw_batch(scene: _Scene, sampling: Sampling, rng: np.random.Generator) -> _Batch:
    """Draw elemental subsets; keep, and optimize, the hypotheses that have support."""
    subsets = _draw_subsets(scene, sampling, rng)
    points, valid = scene.model.minimal_fit(scene.observed[subsets])
    valid &= (np.diff(np.sort(subsets, axis=1), axis=1) > 0).all(axis=1)
    subsets, points = subsets[valid], points[valid]
    inliers = scene.model.residuals(points, scene.observed, scene.normalization) < scene.tolerance
    kept = _has_support(scene, subsets, inliers)
    subsets = subsets[kept]
    points = local_optimization(scene, subsets, points[kept])
    return _Batch(subsets, points, inliers[kept], int(valid.sum()))


def _draw_subsets(scene: _Scene, sampling: Sampling, rng: np.random.Generator) -> Integers:
    """Elemental subsets [SUBSETS_PER_BATCH, k], the seed first; a track may occur twice."""
    k = scene.model.subset_size
    if sampling == "uniform":
        return np.asarray(rng.choice(scene.seeds, size=(SUBSETS_PER_BATCH, k)))
    seeds = rng.choice(scene.seeds, size=SUBSETS_PER_BATCH)
    order = rng.random((SUBSETS_PER_BATCH, scene.neighbours.shape[1])).argsort(axis=1)
    others = np.take_along_axis(scene.neighbours[seeds], order[:, : k - 1], axis=1)
    return np.concatenate([seeds[:, None], others], axis=1)


def _outside(near: Integers, subsets: Integers) -> Flags:
    """Which of the tracks ``near`` [n, m] the seeds are not in the ``subsets`` [n, k]."""
    return np.asarray(~(near[:, :, None] == subsets[:, None, :]).any(axis=2))


def _has_support(scene: _Scene, subsets: Integers, inliers: Flags) -> Flags:
    """Whether enough tracks near the seed, outside the subset, are inliers of the hypothesis."""
    near = scene.neighbours[subsets[:, 0]]
    outside = _outside(near, subsets)
    support = (np.take_along_axis(inliers, near, axis=1) & outside).sum(axis=1)
    # if there are fewer tracks than MIN_SUPPORT, all must agree
    needed = np.minimum(MIN_SUPPORT, outside.sum(axis=1))
    return np.asarray((support >= needed) & (needed > 0))


def local_optimization(scene: _Scene, subsets: Integers, points: Floats) -> Floats:
    """Refit each hypothesis to its subset and the tracks near its seed that support it.

    Otherwise the noise of the elemental subsets would smear the modes: one motion of a scene like
    Fig. 2 would have five of them.
    """
    near = scene.neighbours[subsets[:, 0]]
    outside = _outside(near, subsets)
    tracks = scene.observed[np.concatenate([subsets, near], axis=1)]
    weights = np.ones(tracks.shape[:2])
    size = subsets.shape[1]
    for _ in range(LOCAL_OPTIMIZATION_ROUNDS):
        residuals = scene.model.residuals(points, tracks[:, size:], scene.normalization)
        weights[:, size:] = outside & (residuals < scene.tolerance)
        refitted, valid = scene.model.fit(tracks, weights)
        points[valid] = refitted[valid]
    return points


class _Progress(State):
    """Whether further hypotheses still explain the tracks better.

    ``largest`` [P] is, for each track, the largest number of inliers of any hypothesis that it is
    an inlier of. Sampling has converged when a batch increases its mean by less than one per cent.
    """

    largest: Floats

    def converged(self, inliers: Flags) -> bool:
        """Add the ``inliers`` [n, P] of a batch of hypotheses."""
        before = self.largest.mean()
        if len(inliers):
            support = inliers * inliers.sum(axis=1, keepdims=True)
            self.largest = np.maximum(self.largest, support.max(axis=0))
        return bool(self.largest.mean() < 1.01 * before)
