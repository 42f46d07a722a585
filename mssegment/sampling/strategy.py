"""Which strategy leads from tracks to motions, and the hypotheses that it needs."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mssegment import models
from mssegment.errors import ConfigurationError
from mssegment.models import Flags
from mssegment.records import Camera, Floats, Hypotheses, Record, Strategy
from mssegment.sampling.elemental_subsets import Count, Sampling

LONG = 6
"""From so many frames on, the modes of subspaces alone say too little. On Hopkins155 thinned to 4-6
frames: consensus 0.0 %, modes 12-13 %; five frames stay the paper's."""


class SamplingOptions(Record, frozen=True):
    """How hypotheses are drawn: the settings of ``hypothesize``.

    ``model`` is a name in ``models.MODELS`` or ``auto``; ``rank`` that of a model with ranks;
    ``count`` the number of hypotheses per set; ``derotate`` whether the rotation of the camera is
    compensated for models that assume none.
    """

    model: str = "auto"
    rank: int | Literal["auto"] = "auto"
    count: Count = "auto"
    sampling: Sampling = "local"
    derotate: bool | Literal["auto"] = "auto"

    def models(self, frames: int) -> tuple[str, ...]:
        """The models that ``model`` means for tracks over so many frames."""
        return models.automatic(max(frames, 2)) if self.model == "auto" else (self.model,)


def choose_strategy(method: str, selection: str, names: tuple[str, ...], frames: int) -> Strategy:
    """The strategy for tracks over ``frames`` frames and the models ``names``.

    ``method`` is ``cluster.method`` (auto, meanshift, consensus): by mean shift, long sequences of
    models with ranks are a mixture, unless ``selection`` is that of the paper (``dominance``).
    """
    long = frames >= LONG and has_ranks(names)
    if method == "consensus" or (method == "auto" and long):
        return "consensus"
    return "mixture" if long and selection == "mdl" else "modes"


USED_ONLY_BY: dict[str, tuple[Strategy, ...]] = {
    "count": ("modes", "mixture"),
    "sampling": ("modes", "mixture"),
    "derotate": ("modes",),
}
"""The options that only these strategies use."""
_KEYS = {"derotate": "camera.derotate"}


def check_sampling(options: SamplingOptions, strategy: Strategy, frames: int) -> None:
    """Raises ConfigurationError for an option that is set although nothing uses it."""
    standard, names = SamplingOptions(), options.models(frames)
    for name in ("rank", "count", "sampling", "derotate"):
        value, usual = getattr(options, name), getattr(standard, name)
        if value == usual:
            continue
        key = _KEYS.get(name, f"hypothesize.{name}")
        users = USED_ONLY_BY.get(name)
        if users and strategy not in users:
            raise ConfigurationError(
                f"{key} is {value}, but strategy {strategy} over {frames} frames does not use it: "
                f"leave it at {usual}, or set cluster.method to meanshift"
            )
        used = _USED_BY_MODEL.get(name)
        if used and not any(getattr(models.class_named(n), used) for n in names):
            able = [n for n, model in models.MODELS.items() if getattr(model, used)]
            raise ConfigurationError(
                f"{key} is {value}, but model {' or '.join(names)} does not use it: "
                f"leave it at {usual}, or choose model {' or '.join(able)}"
            )


_USED_BY_MODEL = {"rank": "has_ranks", "derotate": "assumes_no_rotation"}
"""The options that only models with these traits use."""


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
    """Draw the hypotheses that ``strategy`` needs.

    Parameters
    ----------
    points
        Tracks [P, F, 2], pixels, NaN where a point is not visible.
    strategy, options
        What to draw.
    eligible
        Tracks [P] that may be in an elemental subset: all but the background.
    static
        Whether the camera is static and the background excluded.
    camera
        The calibration, for models that need one.

    Raises
    ------
    DataError
        Where the tracks cannot make a hypothesis.
    """
    frames = points.shape[1]
    names = options.models(frames)
    if strategy == "consensus":
        from mssegment.sampling.frame_pairs import draw_for_consensus

        return draw_for_consensus(points, rng, eligible=eligible, static=static, rank=options.rank)
    if frames >= LONG and has_ranks(names):
        from mssegment.sampling.ranks import draw_all_ranks

        sets = draw_all_ranks(
            points,
            model=names[0],
            count=options.count,
            sampling=options.sampling,
            eligible=eligible,
            rank=options.rank,
            rng=rng,
        )
        return Hypotheses(strategy, tuple(sets))
    from mssegment.sampling.elemental_subsets import hypothesize

    # a static camera does not rotate
    derotate = False if options.derotate == "auto" and static else options.derotate
    sets = hypothesize(
        points,
        models=names,
        camera=camera,
        count=options.count,
        sampling=options.sampling,
        eligible=eligible,
        rank=3 if options.rank == "auto" else options.rank,
        derotate=derotate,
        rng=rng,
    )
    return Hypotheses(strategy, tuple(sets))


def has_ranks(names: tuple[str, ...]) -> bool:
    """Whether the one model of ``names`` is of subspaces, whose rank may be chosen."""
    return len(names) == 1 and names[0] in models.MODELS and models.MODELS[names[0]].has_ranks
