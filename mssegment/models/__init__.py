"""Motion models. Adding one takes a file in this package and a line in ``registry.py``."""

from __future__ import annotations

from collections.abc import Sequence

from mssegment.errors import DataError
from mssegment.manifolds import from_name
from mssegment.models.base import EXAMPLE_CAMERA, Flags, MotionModel
from mssegment.records import Floats, HypothesisSet
from mssegment.registry import EVIDENCE, MODELS, Registry

__all__ = ["EVIDENCE", "EXAMPLE_CAMERA", "MODELS", "Flags", "MotionModel"]
__all__ += ["automatic", "class_named", "example", "make", "of_data", "of_pictures", "of_set"]
__all__ += ["remarks"]


def make(name: str, *, frames: int = 2, rank: int = 3, dimension: int = 2) -> MotionModel:
    """Construct a motion model by name.

    Parameters
    ----------
    name : str
        A name in ``MODELS`` or ``EVIDENCE``.
    frames : int
        Number of frames F of the tracks.
    rank : int
        Dimension k of the subspaces of a model that has ranks: 3 for planar, 4 for general motions.
        Of ``subspace``, their dimension. Other models ignore it.
    dimension : int
        Number of coordinates d of a point; models of pictures ignore it.

    Returns
    -------
    MotionModel

    Raises
    ------
    KeyError
        If no model has this name.

    Examples
    --------
    Fit an affine motion to twenty exact matches and compute their residuals in pixels:

    >>> import numpy as np
    >>> model = make("affine")
    >>> points = model.example_tracks(np.random.default_rng(0), 20)
    >>> normalization = model.normalization(points)
    >>> observed = model.observe(points, normalization)
    >>> motions, valid = model.fit(observed, weights=np.ones((1, 20)))
    >>> motions.shape, valid.tolist()
    ((1, 3, 3), [True])
    >>> bool(model.residuals(motions, observed, normalization).max() < 1e-6)
    True
    """
    kind = class_named(name)
    return kind.build(frames, rank) if kind.of_pictures else kind.build(frames, rank, dimension)


def example(name: str) -> MotionModel:
    """A model of this name with the usual number of frames, coordinates and rank.

    Examples
    --------
    >>> example("subspace").manifold.name
    'grassmann(3,2)'
    """
    kind = class_named(name)
    frames = kind.max_frames or kind.min_frames
    rank = 3 if kind.of_pictures else 2
    return make(name, frames=frames, rank=rank, dimension=kind.coordinates or 3)


def of_pictures() -> list[str]:
    """The names of the models of tracks in pictures."""
    return [name for name, model in MODELS.items() if model.of_pictures]


def of_data() -> list[str]:
    """The names of the models of data that is no picture."""
    return [name for name, model in MODELS.items() if not model.of_pictures]


def class_named(name: str) -> type[MotionModel]:
    """Look up the class of a model in ``MODELS`` and ``EVIDENCE``; raises KeyError."""
    registry: Registry[type[MotionModel]] = MODELS if name in MODELS else EVIDENCE
    return registry[name]


def automatic(frames: int, calibrated: bool = False) -> tuple[str, ...]:
    """List the models that ``hypothesize.model: auto`` uses for tracks over ``frames`` frames.

    ``calibrated`` says whether the camera is known, which some models need.
    """
    return tuple(
        name
        for name, model in MODELS.items()
        if model.in_auto and model.accepts(frames) and (calibrated or not model.needs_camera)
    )


def of_set(hypotheses: HypothesisSet) -> MotionModel:
    """Construct the model of a set of hypotheses.

    Raises
    ------
    DataError
        If the model is unknown, or if model, manifold, number of frames and shape of the
        hypotheses do not agree.
    """
    name = hypotheses.model
    if name not in MODELS and name not in EVIDENCE:
        known = ", ".join([*MODELS, *EVIDENCE])
        raise DataError(f"no model is called {name!r}; expected one of {known}")
    model = class_named(name).on_manifold(
        from_name(hypotheses.manifold),
        len(hypotheses.frames),
        hypotheses.normalization.centres.shape[1],
    )
    shape = hypotheses.points.shape
    if len(hypotheses.points) and shape[1:] != model.manifold.point_shape:
        found = " x ".join(str(n) for n in shape[1:])
        raise DataError(f"points have shape {found}, which is not that of {model.manifold.name}")
    return model


def remarks(models: Sequence[MotionModel], points: Sequence[Floats]) -> tuple[str, ...]:
    """Collect notes for the user on motions 1, 2, ... with these models and parameters."""
    import numpy as np

    found: list[str] = []
    # factorization has motions of several ranks, whose parameters differ in shape
    kinds = [(type(model), point.shape) for model, point in zip(models, points, strict=True)]
    for kind in dict.fromkeys(kinds):
        own = [i for i, other in enumerate(kinds) if other == kind]
        labels = [i + 1 for i in own]
        found += models[own[0]].remarks(labels, np.stack([points[i] for i in own]))
    return tuple(found)
