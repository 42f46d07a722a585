"""The pages of motion models and manifolds, made from their registries."""

from __future__ import annotations

import ast
from itertools import pairwise

from docs.api import is_text, source_of
from docs.docstrings import prose
from mssegment.manifolds import MANIFOLDS, Manifold, from_name
from mssegment.models import EVIDENCE, MODELS, MotionModel, example

MODELS_HEAD = """\
# Motion models

A motion model says how an elemental subset of tracks becomes a hypothesis, a point on a manifold,
and how far a track is from a motion. Choose one with `--model`; [how to add
one](extending.md#a-motion-model) is described step by step.

| model | manifold | dimension | elemental subset | frames | camera |
|---|---|---|---|---|---|
"""
EVIDENCE_HEAD = """\
## Further models

These models cannot be chosen; long sequences use their hypotheses as evidence of which tracks
belong together.
"""
MANIFOLDS_HEAD = """\
# Manifolds

Mean shift runs on every manifold below; [`from_name`][mssegment.manifolds.from_name] constructs one
by its name. [How to add one](extending.md#a-manifold) is described step by step.

| name | dimension | point | traits |
|---|---|---|---|
"""


def models_page() -> str:
    """Every motion model in the registry with its facts."""
    rows = [_model_row(name, _typical(name)) for name in MODELS]
    sections = [_section(name, cls, f"For {cls.purpose}. ") for name, cls in MODELS.items()]
    further = [_section(*entry) for entry in EVIDENCE.items()]
    return MODELS_HEAD + "\n".join([*rows, "", *sections, EVIDENCE_HEAD, *further])


def manifolds_page() -> str:
    """Every manifold in the registry with its facts and traits."""
    members = [from_name(name) for family in MANIFOLDS.values() for name in family.examples]
    traits = {
        name: text
        for name, text in documented_attributes(Manifold).items()
        if all(isinstance(getattr(member, name, None), bool) for member in members)
    }
    rows = [_manifold_row(member, list(traits)) for member in members]
    meanings = [f"- `{name}`: {text}" for name, text in traits.items()]
    parts = [*rows, "\n## Traits\n", "The law tests check each trait.\n", *meanings, ""]
    return MANIFOLDS_HEAD + "\n".join([*parts, *(_section(*entry) for entry in MANIFOLDS.items())])


def documented_attributes(cls: type) -> dict[str, str]:
    """The string below each attribute in the body of a class, by name."""
    tree = source_of(cls.__module__)
    body = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == cls.__name__).body
    found = {}
    for item, following in pairwise(body):
        if isinstance(item, ast.AnnAssign) and is_text(following):
            text = ast.literal_eval(following.value)  # type: ignore[attr-defined]
            found[ast.unparse(item.target)] = " ".join(text.split())
    return found


def _typical(name: str) -> MotionModel:
    return example(name)


def _model_row(name: str, model: MotionModel) -> str:
    fixed = {1: "one", 2: "two"}
    frames = fixed.get(model.max_frames or 0, f"{model.min_frames} or more")
    camera = "calibrated" if model.needs_camera else ""
    return (
        f"| [`{name}`](#{name}) | `{model.manifold.name}` | {model.manifold.dim} | "
        f"{model.subset_size} {'tracks' if model.of_pictures else 'points'} | {frames} | {camera} |"
    )


def _manifold_row(member: Manifold, traits: list[str]) -> str:
    shape = " x ".join(map(str, member.point_shape)) or "number"
    own = ", ".join(f"`{trait}`" for trait in traits if getattr(member, trait))
    return f"| `{member.name}` | {member.dim} | {shape} | {own} |"


def _section(name: str, cls: type, purpose: str = "") -> str:
    reference = f"API: [`{cls.__name__}`][{cls.__module__}.{cls.__qualname__}]."
    return f"## {name}\n\n{prose(cls)}\n\n{purpose}{reference}\n"
