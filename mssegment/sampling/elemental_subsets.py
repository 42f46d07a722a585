"""Elemental subsets and the motion hypotheses they make: points on the model's manifold.

Sampling is local, because the tracks of one body lie together: a seed and some of its nearest
neighbours. A hypothesis must then be confirmed by a few further tracks near its seed, which is the
validation step of the paper's reference [17].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

import mssegment.models as motion_models
from mssegment.errors import DataError, UsageError
from mssegment.models import Flags, MotionModel
from mssegment.records import Camera, Floats, HypothesisSet, Integers, Normalization, Record
from mssegment.sampling.neighbourhoods import nearest_neighbours, some_of

Count = int | Literal["auto"]
Sampling = Literal["local", "uniform"]

NEIGHBOURS = 12
"""Nearest tracks of a seed: the subset comes from them, and they confirm the hypothesis."""
CONFIRMATIONS = 3
"""Further tracks near the seed that must agree with a hypothesis."""
AGREEMENT = 0.02
"""How near a confirming track must be, over the rms radius of the tracks (about 3 px in 640)."""
MOST_TRACKS = 4000
"""Tracks that make and confirm hypotheses, drawn at random of more: where tracks lie too close, the
noise of a subset decides its motion, and the modes are smeared."""
FEWEST, MOST = 300, 2000
"""Bounds of an automatic number of hypotheses."""
PATIENCE = 60
"""Subsets drawn per hypothesis asked for, before the sampler gives up."""
POLISHINGS = 2
"""Least-squares rounds on a confirmed hypothesis and the tracks that confirm it."""
BATCH = 192
"""Subsets fitted at a time; one batch needs [BATCH, tracks] residuals."""


class _Scene(Record, frozen=True):
    """The eligible tracks of one set, as one model sees them."""

    model: MotionModel
    observed: Floats
    normalization: Normalization
    indices: Integers
    neighbours: Integers
    seeds: Integers
    tolerance: float


def hypothesize(
    points: Floats,
    *,
    models: Sequence[str] = ("affine",),
    camera: Camera | None = None,
    count: Count = "auto",
    sampling: Sampling = "local",
    eligible: Flags | None = None,
    rank: int = 3,
    derotate: bool | Literal["auto"] = "auto",
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    """Motion hypotheses from elemental subsets of the tracks ``points`` [P, F, 2] (pixels).

    Parameters
    ----------
    points
        Tracks [P, F, 2], pixels, NaN where a point is not visible; incomplete tracks are in no
        subset.
    models
        Names in ``models.MODELS``, one set each.
    camera
        The calibration, for models that need one.
    count
        Hypotheses per set; ``auto`` draws until further hypotheses explain the tracks no better,
        and fewer for the second set.
    sampling
        ``local`` subsets are a seed and neighbours of it, ``uniform`` ones are drawn anywhere.
    eligible
        Tracks [P] that may be in a subset.
    rank
        Of a model with ranks.
    derotate
        Whether the rotation of the camera is compensated for models that assume none; ``auto``:
        where that explains the matches much better (``preprocessing.rotation_compensation``).
    rng
        Source of random numbers.

    Returns
    -------
    sets
        Fewer hypotheses than asked for where no more subsets are confirmed; a model without a
        confirmed hypothesis has no set.

    Raises
    ------
    DataError
        Where the tracks cannot make a hypothesis.
    UsageError
        For a wrong argument.
    """
    _check_arguments(models, points, camera, count, sampling)
    complete = np.asarray(np.isfinite(points).all(axis=(1, 2)))
    usable = complete if eligible is None else complete & eligible
    usable = some_of(usable, MOST_TRACKS, rng)
    frames = points.shape[1]
    rotation = None
    turning = any(motion_models.MODELS[name].assumes_no_rotation for name in models)
    if derotate is not False and turning and camera is not None:
        from mssegment.preprocessing.rotation_compensation import find_rotation

        found = find_rotation(points[usable], camera, rng)
        rotation = None if found is None else found.rotation
    neighbours: Integers | None = None
    sets = []
    for name in models:
        made = motion_models.make(name, frames=frames, rank=rank)
        scene = _scene(made, points, usable, camera, rotation, neighbours)
        neighbours = scene.neighbours
        # of two sets the first finds the bodies; the second need not be as dense
        fewer = count == "auto" and name != models[0]
        sets.append(_sample(scene, FEWEST // 2 if fewer else count, sampling, rng))
    return [one for one in sets if len(one.points)]


def _check_arguments(
    names: Sequence[str], points: Floats, camera: Camera | None, count: Count, sampling: Sampling
) -> None:
    frames = points.shape[1]
    for name in names:
        if name not in motion_models.MODELS:
            known = ", ".join([*motion_models.MODELS, "auto"])
            raise UsageError(f"model: {name!r} is unknown; choose one of {known}")
        model = motion_models.MODELS[name]
        if model.needs_camera and camera is None:
            raise DataError(f"model {name} needs a calibrated camera: give --camera fx,fy,cx,cy")
        most = model.max_frames
        if frames < model.min_frames or (most is not None and frames > most):
            wanted = f"{most}" if most == model.min_frames else f"at least {model.min_frames}"
            raise DataError(
                f"model {name} needs {wanted} frames, but the tracks have {frames}: "
                + _advice(frames)
            )
    if count != "auto" and count < 1:
        raise UsageError(f"count: {count} hypotheses were asked for; give 1 or more, or auto")
    if sampling not in ("local", "uniform"):
        raise UsageError(f"sampling: {sampling!r} is unknown; choose local or uniform")


def _advice(frames: int) -> str:
    """What to do about tracks over a number of frames that a model does not accept."""
    known = [name for name, model in motion_models.MODELS.items() if model.accepts(frames)]
    if not known:
        return "give more pictures"
    named = " or ".join([", ".join(known[:-1]), known[-1]] if known[1:] else known)
    return f"choose two frames, or model {named}" if frames > 2 else f"choose model {named}"


def _scene(
    model: MotionModel,
    points: Floats,
    usable: Flags,
    camera: Camera | None,
    rotation: Floats | None,
    neighbours: Integers | None,
) -> _Scene:
    """``neighbours`` are those of the same tracks, where they are known from another model."""
    indices = np.flatnonzero(usable)
    needed = model.subset_size + 1
    if len(indices) < needed:
        raise DataError(
            f"model {model.name} needs at least {needed} tracks that move and are seen in every "
            f"frame, found {len(indices)}: more matches or pictures with more texture "
            "help, or background.remove set to no"
        )
    tracks = points[indices]
    normalization = model.normalization(tracks, camera)
    if rotation is not None:
        normalization = Normalization(
            normalization.centres, normalization.scale, normalization.aspect, rotation
        )
    observed = model.observe(tracks, normalization)
    moved = np.linalg.norm(observed - observed[:, :1], axis=-1).max(axis=1) * normalization.scale
    seeds = np.flatnonzero(moved >= model.min_displacement)
    if len(seeds) < model.subset_size:
        raise DataError(
            f"only {len(seeds)} tracks moved {model.min_displacement:g} px or more, but model "
            f"{model.name} needs {model.subset_size}: choose frames further apart"
        )
    spread = np.sqrt(((tracks - tracks.mean(axis=0)) ** 2).sum(axis=-1).mean())
    return _Scene(
        model,
        observed,
        normalization,
        indices,
        nearest_neighbours(tracks, NEIGHBOURS) if neighbours is None else neighbours,
        seeds,
        AGREEMENT * float(spread),
    )


def _sample(
    scene: _Scene, count: Count, sampling: Sampling, rng: np.random.Generator
) -> HypothesisSet:
    """Draws batches until there are enough confirmed hypotheses, or no hope of more or of any."""
    wanted = MOST if count == "auto" else count
    subsets: list[Integers] = []
    hypotheses: list[Floats] = []
    progress = _Progress(len(scene.indices))
    drawn = kept = valid_count = 0
    while kept < wanted and drawn < PATIENCE * wanted:
        drawn_now = _draw(scene, BATCH, sampling, rng)
        found, valid = scene.model.minimal_fit(scene.observed[drawn_now])
        valid &= (np.diff(np.sort(drawn_now, axis=1), axis=1) > 0).all(axis=1)
        valid_count += int(valid.sum())
        drawn_now, found = drawn_now[valid], found[valid]
        agree = scene.model.residuals(found, scene.observed, scene.normalization) < scene.tolerance
        confirmed = _confirmed(scene, drawn_now, agree)
        drawn += BATCH
        subsets.append(drawn_now[confirmed])
        hypotheses.append(local_optimization(scene, drawn_now[confirmed], found[confirmed]))
        kept += int(confirmed.sum())
        settled = progress.settled(agree[confirmed])
        if count == "auto" and kept >= FEWEST and settled:
            break
        if drawn >= 20 * BATCH and kept == 0:
            break
    if valid_count == 0:
        raise DataError(
            f"all {drawn} elemental subsets are degenerate for model {scene.model.name} (points on "
            "a line, equal or parallel motions): choose frames further apart, or another model"
        )
    return HypothesisSet(
        model=scene.model.name,
        manifold=scene.model.manifold.name,
        frames=tuple(range(scene.observed.shape[1])),
        normalization=scene.normalization,
        subsets=scene.indices[np.concatenate(subsets)[:wanted]],
        points=np.concatenate(hypotheses)[:wanted],
        drawn=drawn,
    )


def _draw(scene: _Scene, size: int, sampling: Sampling, rng: np.random.Generator) -> Integers:
    """Elemental subsets [size, k], the seed first; a repeated track makes a subset unsound."""
    k = scene.model.subset_size
    if sampling == "uniform":
        return np.asarray(rng.choice(scene.seeds, size=(size, k)))
    seeds = rng.choice(scene.seeds, size=size)
    places = rng.random((size, scene.neighbours.shape[1])).argsort(axis=1)[:, : k - 1]
    others = np.take_along_axis(scene.neighbours[seeds], places, axis=1)
    return np.concatenate([seeds[:, None], others], axis=1)


def _confirmed(scene: _Scene, subsets: Integers, agree: Flags) -> Flags:
    """Which hypotheses at least CONFIRMATIONS tracks near the seed agree with, not made of them."""
    near = scene.neighbours[subsets[:, 0]]
    outside = ~(near[:, :, None] == subsets[:, None, :]).any(axis=2)
    confirming = (np.take_along_axis(agree, near, axis=1) & outside).sum(axis=1)
    # a handful of tracks cannot do more than agree altogether
    needed = np.minimum(CONFIRMATIONS, outside.sum(axis=1))
    return np.asarray((confirming >= needed) & (needed > 0))


def local_optimization(scene: _Scene, subsets: Integers, points: Floats) -> Floats:
    """Refits each hypothesis to its subset and the tracks near its seed that agree with it.

    The noise of an elemental subset would smear the modes: with it one motion of a scene like
    Fig. 2 has five of them.
    """
    near = scene.neighbours[subsets[:, 0]]
    outside = ~(near[:, :, None] == subsets[:, None, :]).any(axis=2)
    tracks = scene.observed[np.concatenate([subsets, near], axis=1)]
    weights = np.ones(tracks.shape[:2])
    size = subsets.shape[1]
    for _ in range(POLISHINGS):
        residuals = scene.model.residuals(points, tracks[:, size:], scene.normalization)
        weights[:, size:] = outside & (residuals < scene.tolerance)
        refitted, valid = scene.model.fit(tracks, weights)
        points[valid] = refitted[valid]
    return points


class _Progress:
    """Whether further hypotheses still explain the tracks better than those at hand.

    Each track remembers the largest number of tracks that any hypothesis brought it together
    with; when a batch makes the mean of these grow by less than one per cent, sampling settles.
    """

    def __init__(self, tracks: int) -> None:
        self._best = np.zeros(tracks)

    def settled(self, agree: Flags) -> bool:
        before = self._best.mean()
        if len(agree):
            support = agree * agree.sum(axis=1, keepdims=True)
            self._best = np.maximum(self._best, support.max(axis=0))
        return bool(self._best.mean() < 1.01 * before)
