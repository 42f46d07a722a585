"""The strategy from tracks to motions, and the hypotheses that it needs."""

from __future__ import annotations

import numpy as np

from mssegment import models
from mssegment.errors import ConfigurationError, DataError
from mssegment.models import Flags, MotionModel
from mssegment.records import Camera, Floats, Hypotheses, Strategy, replace
from mssegment.sampling.options import DEFAULTS, SamplingOptions

CONSENSUS_FRAMES = 3
"""Number of frames from which on consensus is the automatic choice. On Hopkins155 thinned to 4-6
frames: consensus 0.0 %, modes 12-13 %."""
LONG_SEQUENCE = 6
"""Number of frames from which on mean shift needs a mixture; five frames are those of the paper."""


def choose_strategy(method: str, selection: str, names: tuple[str, ...], frames: int) -> Strategy:
    """Choose the strategy from tracks to motions.

    Parameters
    ----------
    method : {"auto", "meanshift", "consensus"}
        ``cluster.method``. By mean shift, long sequences of models with ranks are segmented by a
        mixture. The selection of the paper needs its modes, unless ``method`` is consensus.
    selection : str
        ``segment.selection``; ``dominance`` is that of the paper.
    names : tuple of str
        Names of the models.
    frames : int
        Number of frames.

    Returns
    -------
    {"modes", "mixture", "consensus"}

    Examples
    --------
    >>> choose_strategy("auto", "mdl", ("affine", "homography"), frames=2)
    'modes'
    >>> choose_strategy("auto", "mdl", ("factorization",), frames=20)
    'consensus'
    >>> choose_strategy("meanshift", "mdl", ("factorization",), frames=20)
    'mixture'
    """
    if of_data(names):
        return "modes"
    if method == "consensus":
        return "consensus"
    if selection != "mdl" or not has_ranks(names):
        return "modes"
    if method == "auto" and frames >= CONSENSUS_FRAMES:
        return "consensus"
    return "mixture" if frames >= LONG_SEQUENCE else "modes"


USED_ONLY_BY: dict[str, tuple[Strategy, ...]] = {
    "count": ("modes", "mixture"),
    "sampling": ("modes", "mixture"),
    "derotate": ("modes",),
}
"""Options that only these strategies use."""
REQUIRED_TRAIT = {"rank": "has_ranks", "derotate": "assumes_no_rotation"}
"""Options that only models with these traits use."""
KEYS = {"derotate": "camera.derotate"}
"""Configuration keys of options that are not in section ``hypothesize``."""


def check_sampling(options: SamplingOptions, strategy: Strategy, frames: int) -> None:
    """Check that every option that is set is used.

    Raises
    ------
    ConfigurationError
        If an option is set that neither the strategy nor the models use.
    """
    names = options.models(frames)
    if has_ranks(names) and options.rank not in ("auto", 3, 4) and not of_data(names):
        raise ConfigurationError(
            f"hypothesize.rank is {options.rank}; expected auto, 3 or 4 for model {names[0]}"
        )
    for name in ("rank", "count", "sampling", "derotate"):
        value, default = getattr(options, name), getattr(DEFAULTS, name)
        if value == default:
            continue
        key = KEYS.get(name, f"hypothesize.{name}")
        users = USED_ONLY_BY.get(name)
        if users and strategy not in users:
            raise ConfigurationError(
                f"{key} is {value}, but strategy {strategy} over {frames} frames does not use it: "
                f"leave it at {default}, or set cluster.method to meanshift"
            )
        trait = REQUIRED_TRAIT.get(name)
        if trait and not any(getattr(models.class_named(n), trait) for n in names):
            able = [n for n, model in models.MODELS.items() if getattr(model, trait)]
            raise ConfigurationError(
                f"{key} is {value}, but model {' or '.join(names)} does not use it: "
                f"leave it at {default}, or choose model {' or '.join(able)}"
            )


def draw(
    points: Floats,
    strategy: Strategy,
    options: SamplingOptions,
    *,
    eligible: Flags,
    static: bool,
    camera: Camera | None = None,
    rng: np.random.Generator,
) -> Hypotheses:
    """Sample the hypotheses that ``strategy`` needs.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    strategy : {"modes", "mixture", "consensus"}
        The strategy, see ``choose_strategy``.
    options : SamplingOptions
        The settings.
    eligible : ndarray [P] of bool
        Tracks that may be sampled: all but the background.
    static : bool
        Whether the camera is static and the background excluded.
    camera : Camera, optional
        The calibration, for models that need one.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    Hypotheses

    Raises
    ------
    DataError
        If no hypothesis can be computed from the tracks.
    """
    frames = points.shape[1]
    names = options.models(frames, calibrated=camera is not None)
    if of_data(names):
        from mssegment.sampling.structures import sample_structures

        model = model_of_data(names[0], options, points)
        found = sample_structures(points, model, options, eligible=eligible, rng=rng)
        return Hypotheses(strategy, (found,) if len(found.points) else ())
    if strategy == "consensus":
        from mssegment.sampling.frame_pairs import draw_for_consensus

        return draw_for_consensus(points, rng, eligible=eligible, static=static, rank=options.rank)
    if frames >= LONG_SEQUENCE and has_ranks(names):
        from mssegment.sampling.ranks import draw_all_ranks

        sets = draw_all_ranks(points, model=names[0], options=options, eligible=eligible, rng=rng)
        return Hypotheses(strategy, tuple(sets))
    from mssegment.sampling.elemental_subsets import hypothesize

    if options.derotate == "auto" and static:
        # a static camera does not rotate
        options = replace(options, derotate=False)
    sets = hypothesize(
        points, models=names, options=options, camera=camera, eligible=eligible, rng=rng
    )
    return Hypotheses(strategy, tuple(sets))


def has_ranks(names: tuple[str, ...]) -> bool:
    """Whether ``names`` is one model whose subspaces have a rank to choose."""
    return len(names) == 1 and names[0] in models.MODELS and models.MODELS[names[0]].has_ranks


def of_data(names: tuple[str, ...]) -> bool:
    """Whether ``names`` are models of data that is no picture."""
    return any(not models.class_named(name).of_pictures for name in names)


def model_of_data(name: str, options: SamplingOptions, points: Floats) -> MotionModel:
    """The model for points [P, F, d] that are no pictures.

    Raises
    ------
    DataError
        If it does not accept their number of views or coordinates.
    ConfigurationError
        If it needs a rank, and none is given, or none that is smaller than d.
    """
    kind, (frames, d) = models.class_named(name), points.shape[1:]
    if not kind.accepts(frames):
        expected = "one set" if kind.max_frames == 1 else "two matched sets"
        raise DataError(f"model {name} needs {expected} of points; found {frames}")
    if d != (kind.coordinates or d):
        raise DataError(
            f"model {name} is for points with {kind.coordinates} coordinates; found {d}"
        )
    if not kind.has_ranks:
        if d < 2:
            raise DataError(f"model {name} needs points with 2 coordinates or more; found {d}")
        return models.make(name, frames=frames, dimension=d)
    rank = options.rank
    if rank == "auto" or rank >= d:
        given = "auto" if rank == "auto" else str(rank)
        raise ConfigurationError(
            f"hypothesize.rank is {given}; expected the dimension of the subspaces, from 1 to "
            f"{d - 1} for vectors with {d} coordinates (--rank)"
        )
    return models.make(name, frames=frames, rank=rank, dimension=d)
