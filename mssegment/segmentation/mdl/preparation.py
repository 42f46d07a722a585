"""What the selection works with: the description, the noise of each model, and the candidates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Record
from mssegment.sampling.neighbourhoods import nearest_neighbours
from mssegment.segmentation.mdl.candidates import (
    Candidates,
    Family,
    concatenate,
    covering,
    from_modes,
)
from mssegment.segmentation.mdl.data_prices import data_families
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.granularity import maps_the_plane, parallax_noise, scale_range
from mssegment.segmentation.mdl.labelling import LABEL_NEIGHBOURS
from mssegment.segmentation.mdl.likelihood import Noise, uniform_cost
from mssegment.segmentation.selection import SelectionProblem


class Ingredients(Record, frozen=True):
    """What the ablation study removes, one at a time.

    Attributes
    ----------
    parameter_weight : float
        Factor of the cost of the parameters.
    degrees_of_freedom : float
        Of the distribution of residuals; infinite for a Gaussian.
    search : bool
        Whether the set is changed after the start.
    neighbour_labels : bool
        Whether the final labels depend on those of neighbours.
    relative_coding : bool
        Whether a motion may be coded relative to another.
    label_cost : bool
        Whether labels cost anything.
    """

    parameter_weight: float = 1.0
    degrees_of_freedom: float = 2.5
    search: bool = True
    neighbour_labels: bool = True
    relative_coding: bool = True
    label_cost: bool = True


ALL_INGREDIENTS = Ingredients()
PLANE_PARAMETERS = 6
"""Of a plane before an affine camera. Models with fewer misfit in other directions as well."""


def has_perspective_planes(problem: SelectionProblem) -> bool:
    """Whether motions may be those of planes under perspective, parts of something larger."""
    return any(
        observed_set.model.planar_under_perspective for observed_set in problem.observed_sets
    )


def is_of_pictures(problem: SelectionProblem) -> bool:
    """Whether the points are positions in pictures."""
    return all(observed_set.model.of_pictures for observed_set in problem.observed_sets)


def make_description(
    problem: SelectionProblem, families: Sequence[Family], ingredients: Ingredients
) -> Description:
    """The description for the options and models of ``problem``."""
    given = problem.options.motions
    if not is_of_pictures(problem):
        return Description(
            families,
            problem.points[:, 0],
            min_motions=problem.options.min_motions if given is None else given,
            max_motions=np.inf if given is None else given,
            parameter_weight=ingredients.parameter_weight,
            label_cost=ingredients.label_cost,
            shared_points=True,
        )
    surface = problem.options.granularity == "surface"
    exact = all(family.observed_set.model.leaves_parallax_free for family in families)
    # an object that rotates slightly has smooth residuals from its translation
    smooth = exact and any(one.model.needs_camera for one in problem.observed_sets)
    by_neighbours = surface or not smooth
    planes = has_perspective_planes(problem)
    # parallax, and drift over many frames, vary smoothly within an object: not a second motion
    coherent = exact or (surface and not planes)
    two_views = problem.points.shape[1] == 2
    rigid = surface and two_views
    return Description(
        families,
        problem.points[:, 0],
        min_motions=problem.options.min_motions if given is None else given,
        max_motions=np.inf if given is None else given,
        parameter_weight=ingredients.parameter_weight,
        label_cost=ingredients.label_cost,
        neighbours=(
            nearest_neighbours(problem.points, LABEL_NEIGHBOURS) if by_neighbours else None
        ),
        by_contact=not coherent,
        displacements=(
            problem.points[:, 1] - problem.points[:, 0] if two_views and not exact else None
        ),
        relative_coding=ingredients.relative_coding and rigid and not planes,
    )


def make_families(problem: SelectionProblem, ingredients: Ingredients) -> list[Family]:
    """The sets of ``problem`` with the noise of each."""
    if not is_of_pictures(problem):
        return data_families(problem)
    outlier_cost = uniform_cost(problem.points)
    exact = any(one.model.leaves_parallax_free for one in problem.observed_sets)
    families = []
    for index, observed_set in enumerate(problem.observed_sets):
        model, normalization = observed_set.model, observed_set.hypotheses.normalization
        predicts_points = not model.leaves_parallax_free
        granularity = problem.options.granularity
        floor, cap = scale_range(
            problem.points,
            predicts_points,
            model.needs_camera,
            flat=granularity == "surface" and has_perspective_planes(problem),
            noise=problem.noise,
        )
        noise = Noise(
            dimension=model.residual_dimension,
            residual_terms=model.residual_terms,
            floor=floor,
            cap=cap,
            log_free_extent=model.log_free_extent(observed_set.observed, normalization),
            outlier_cost=outlier_cost,
            parallax=parallax_noise(problem.points, granularity, predicts_points),
            degrees_of_freedom=ingredients.degrees_of_freedom,
        )
        relief = (
            granularity == "object"
            and problem.points.shape[1] == 2
            and not exact  # the essential matrix describes the relief of a scene
            and bool(np.isfinite(problem.noise))
            and maps_the_plane(model)
            and model.parameters >= PLANE_PARAMETERS
        )
        families.append(Family(index, observed_set, noise, relief))
    return families


def candidate_pool(problem: SelectionProblem, families: Sequence[Family]) -> Candidates:
    """All candidates, from every mode of every set, and from hypotheses of tracks that these leave.

    A body of few tracks has few hypotheses, which a mode of a larger one absorbs.
    """
    parts: list[Candidates] = []
    for family in families:
        modes = [i for i, mode in enumerate(problem.modes) if mode.set_index == family.index]
        if modes:
            points = np.stack([problem.modes[i].point for i in modes])
            parts += from_modes(family, points, np.array(modes))
    explained = np.zeros(len(problem.points), dtype=bool)
    for part in parts:
        explained |= (part.gains > 0).any(axis=0)
    for family in families if not explained.all() else ():
        chosen = covering(family, ~explained)
        if chosen:
            points = family.observed_set.hypotheses.points[chosen]
            parts += from_modes(family, points, problem.assignments[family.index][chosen])
    return concatenate(parts) if parts else Candidates.empty(len(problem.points))
