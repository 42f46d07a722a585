"""Motion models. A model is one file here and one line in ``registry.py``."""

from __future__ import annotations

from collections.abc import Sequence

from mssegment.errors import DataError
from mssegment.manifolds import from_name
from mssegment.models.base import EXAMPLE_CAMERA, Flags, MotionModel
from mssegment.records import Floats, HypothesisSet
from mssegment.registry import EVIDENCE, MODELS, Registry

__all__ = ["EVIDENCE", "EXAMPLE_CAMERA", "MODELS", "Flags", "MotionModel"]
__all__ += ["automatic", "class_named", "make", "of_set", "remarks"]


def make(name: str, *, frames: int = 2, rank: int = 3) -> MotionModel:
    """The motion model ``name`` for tracks over ``frames`` frames.

    ``rank`` is the dimension k of the subspaces of a model that has ranks (3 planar, 4 general).
    Raises KeyError for an unknown name.
    """
    return class_named(name).build(frames, rank)


def class_named(name: str) -> type[MotionModel]:
    """The class of the model ``name``, one of ``MODELS`` or ``EVIDENCE``; raises KeyError."""
    registry: Registry[type[MotionModel]] = MODELS if name in MODELS else EVIDENCE
    return registry[name]


def automatic(frames: int) -> tuple[str, ...]:
    """The models that ``auto`` means for tracks over so many frames."""
    return tuple(n for n, model in MODELS.items() if model.in_auto and model.accepts(frames))


def of_set(hypotheses: HypothesisSet) -> MotionModel:
    """The model whose hypotheses a set holds.

    Raises DataError where the model is unknown, or where model, manifold, number of frames and
    shape of the points do not fit together.
    """
    name = hypotheses.model
    if name not in MODELS and name not in EVIDENCE:
        known = ", ".join([*MODELS, *EVIDENCE])
        raise DataError(f"no model is called {name!r}; known are {known}")
    model = class_named(name).on_manifold(from_name(hypotheses.manifold), len(hypotheses.frames))
    shape = hypotheses.points.shape
    if len(hypotheses.points) and shape[1:] != model.manifold.point_shape:
        found = " x ".join(str(n) for n in shape[1:])
        raise DataError(f"points are {found}, that is not on {model.manifold.name}")
    return model


def remarks(models: Sequence[MotionModel], points: Sequence[Floats]) -> tuple[str, ...]:
    """What a user should know about motions 1, 2, ... with these models and parameters."""
    import numpy as np

    found: list[str] = []
    for kind in dict.fromkeys(type(model) for model in models):
        own = [i for i, model in enumerate(models) if type(model) is kind]
        labels = [i + 1 for i in own]
        found += models[own[0]].remarks(labels, np.stack([points[i] for i in own]))
    return tuple(found)
