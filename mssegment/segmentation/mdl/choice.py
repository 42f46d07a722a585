"""``mdl``: the motions, and their number, with the shortest description of all tracks.

The modes of the hypotheses are candidates. What a motion saves on a track is the likelihood of the
track relative to a uniform code (``likelihood``). A set of motions saves what its motions save on
their tracks, minus the cost of their parameters, minus the code of the labels: the negative
logarithm of the frequency of each label, so that splitting an object costs an amount *per track*,
however dense the matches are. The search (``search``) starts with the candidates that save most and
changes the set as long as the description becomes shorter. Finally the labels are computed once
more, each coded given the labels of its neighbours. The same code serves every motion model: a
model contributes its number of parameters, the dimension of its residual, its residual, its fit and
the extent that it leaves free.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import OUTLIER, Integers, Record, replace
from mssegment.sampling.neighbourhoods import nearest_neighbours, neighbour_space
from mssegment.segmentation.mdl.candidates import (
    Candidates,
    Family,
    concatenate,
    covering,
    from_modes,
)
from mssegment.segmentation.mdl.continuity import merge_faces
from mssegment.segmentation.mdl.data_prices import (
    data_families,
    on_all_points,
    sample_of,
    without_unit,
)
from mssegment.segmentation.mdl.description import Description, least_tracks
from mssegment.segmentation.mdl.granularity import parallax_noise, scale_range, suggest
from mssegment.segmentation.mdl.labelling import (
    LABEL_NEIGHBOURS,
    Neighbourhood,
    neighbour_labels,
)
from mssegment.segmentation.mdl.likelihood import Noise, uniform_cost
from mssegment.segmentation.mdl.pieces import with_pieces
from mssegment.segmentation.mdl.refinement import refit_once
from mssegment.segmentation.mdl.rigid_motions import joined, may_join, with_numbers
from mssegment.segmentation.mdl.search import improve, refitted, start
from mssegment.segmentation.options import Granularity
from mssegment.segmentation.selection import (
    SelectedMotion,
    SelectionProblem,
    SelectionResult,
)
from mssegment.special import median

EXCLUDED = 1e-3
"""Share of the true inliers that are too far away to be labelled."""
FINAL_ROUNDS = 5
"""Rounds of neighbour labels and refits at the end."""


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


def mdl(problem: SelectionProblem, ingredients: Ingredients = ALL_INGREDIENTS) -> SelectionResult:
    """Select the motions with the shortest description of the tracks.

    Parameters
    ----------
    problem : SelectionProblem
        The tracks and the modes.
    ingredients : Ingredients
        All by default; fewer for the ablation study.

    Returns
    -------
    SelectionResult

    References
    ----------
    Rissanen, Modeling by shortest data description, 1978.
    Delong, Osokin, Isack and Boykov, Fast approximate energy minimization with label costs, 2012.
    """
    problem, notes = decide_granularity(problem, ingredients)
    if not is_of_pictures(problem):
        return _structures(problem, ingredients)
    given = problem.options.motions
    if given is not None and may_join(problem):
        # a number of motions is one of rigid bodies, which may consist of more
        free = replace(problem.options, motions=None, min_motions=given)
        found = _of_pictures(replace(problem, options=free), ingredients, notes)
        if len(found.bodies or ()) == given:
            return found
    return _of_pictures(problem, ingredients, notes)


def _of_pictures(
    problem: SelectionProblem, ingredients: Ingredients, notes: Sequence[str]
) -> SelectionResult:
    """The motions of pictures, with ``notes`` and those on the motions."""
    notes = list(notes)
    best, description = shortest_description(problem, ingredients)
    labels, best = final_labels(problem, best, description, ingredients.neighbour_labels)
    if problem.options.granularity == "object" and problem.options.motions is None:
        labels, best = merge_faces(problem, labels, best, description)
    labels, groups = joined(problem, labels, best, description)
    found = selected_motions(best, labels, description)
    bodies = with_numbers(groups, labels)
    if len(bodies) < description.min_motions:
        notes.append(f"{description.min_motions} motions requested, {len(bodies)} found")
    if len(problem.observed_sets) > 1 and found:
        notes.append(models_chosen(problem, found))
    if not found:
        least = min(least_tracks(family.observed_set.model) for family in description.families)
        notes.append(
            f"no motion found among {len(labels)} tracks: each needs at least {least} that agree"
        )
    return SelectionResult(tuple(found), tuple(notes), bodies)


def _structures(problem: SelectionProblem, ingredients: Ingredients) -> SelectionResult:
    """The structures of data that is no picture; selected on a sample of very many points."""
    normalized = without_unit(problem)
    best, description = shortest_description(sample_of(normalized), ingredients)
    if len(best):
        best, description = on_all_points(normalized, best, description)
    found = [
        replace(
            one,
            scale=one.scale * problem.observed_sets[one.set_index].hypotheses.normalization.scale,
        )
        for one in selected_motions(best, description.labels(best), description)
    ]
    notes: tuple[str, ...] = ()
    if len(found) < description.min_motions:
        notes = (f"{description.min_motions} structures requested, {len(found)} found",)
    return SelectionResult(tuple(found), notes)


def shortest_description(
    problem: SelectionProblem, ingredients: Ingredients
) -> tuple[Candidates, Description]:
    """The motions that save most, before the final labels are computed."""
    families = make_families(problem, ingredients)
    pool = candidate_pool(problem, families)
    description = make_description(problem, families, ingredients)
    best = start(pool, description)
    if not ingredients.search:
        return refitted(best, description)[0], description
    best = improve(best, pool, description)
    if may_have_pieces(problem, description) and ingredients.label_cost:
        best = with_pieces(problem.points, problem.noise, best, pool, description)
    return best, description


def may_have_pieces(problem: SelectionProblem, description: Description) -> bool:
    """Whether parts of a motion may be told apart: by measured noise, their number unknown."""
    return (
        description.by_contact
        and problem.options.motions is None
        and problem.options.granularity == "object"
        and bool(np.isfinite(problem.noise))
    )


def decide_granularity(
    problem: SelectionProblem, ingredients: Ingredients
) -> tuple[SelectionProblem, list[str]]:
    """Replace granularity ``auto``, and note the decision for the user."""
    if problem.options.granularity != "auto":
        return problem, []
    surfaces = _with_granularity(problem, "surface")
    if not has_perspective_planes(problem):
        return _with_granularity(problem, "object"), [
            "granularity auto: object (only homographies can separate surfaces from objects)"
        ]
    found, description = shortest_description(surfaces, ingredients)
    labels = description.labels(found)
    inliers = labels == np.arange(1, len(found) + 1)[:, None]
    scales = np.zeros(len(found))
    for k in range(len(found)):
        noise = replace(description.families[int(found.set_indices[k])].noise, floor=0.0)
        scales[k] = noise.scales(found.residuals[[k]], inliers[[k]].astype(np.float64))[0]
    suggestion = suggest(scales, inliers.sum(axis=1), problem.points)
    verb = "are" if suggestion == "surface" else "are not"
    note = (
        f"granularity auto: {suggestion} (the planes found {verb} flat); set segment.granularity "
        "to override"
    )
    return _with_granularity(problem, suggestion), [note]


def _with_granularity(problem: SelectionProblem, granularity: Granularity) -> SelectionProblem:
    """A copy of the problem with this granularity."""
    return replace(problem, options=replace(problem.options, granularity=granularity))


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
        families.append(Family(index, observed_set, noise))
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


def final_labels(
    problem: SelectionProblem,
    current: Candidates,
    description: Description,
    use_neighbours: bool,
) -> tuple[Integers, Candidates]:
    """The final labels [P], each coded given its neighbours, and the motions refitted to them.

    The scale up to which a misfit is noise, including parallax, determines what the motions are.
    Which tracks belong to them is decided at the scale of the residuals of each motion.
    """
    if not use_neighbours:
        return description.labels(current), current
    families = [family.without_parallax() for family in description.families]
    neighbourhood = Neighbourhood(neighbour_space(problem.points))
    labels = neighbour_labels(current.gains, neighbourhood, description.labels(current))
    for _ in range(FINAL_ROUNDS):
        inliers = labels == np.arange(1, len(current) + 1)[:, None]
        current = refit_once(families, current, inliers.astype(np.float64))
        before, labels = labels, neighbour_labels(current.gains, neighbourhood, labels)
        if np.array_equal(labels, before):
            break
    if problem.points.shape[1] == 2:
        labels = within_limits(labels, current, description, problem.noise)
    return labels, current


def within_limits(
    labels: Integers, current: Candidates, description: Description, noise: float
) -> Integers:
    """The labels, without tracks whose residual no noise explains.

    The limit is the residual that one track in ``1 / EXCLUDED`` exceeds, given the median of the
    residuals of its motion, or that of the ``noise`` if it is larger.
    """
    labels = labels.copy()
    for k in range(len(current)):
        own = labels == k + 1
        if own.any():
            model = description.families[int(current.set_indices[k])].noise
            middle = max(median(current.residuals[k][own]) / model.quantile(0.5), noise)
            limit = model.quantile(EXCLUDED) * middle
            labels[own & (current.residuals[k] > limit)] = OUTLIER
    return labels


def models_chosen(problem: SelectionProblem, found: Sequence[SelectedMotion]) -> str:
    """A note with the model of each motion, which the description length has selected."""
    ranked = sorted(found, key=lambda motion: -int(motion.inliers.sum()))
    names = [problem.observed_sets[motion.set_index].model.name for motion in ranked]
    return "models chosen: " + ", ".join(f"{n} {name}" for n, name in enumerate(names, start=1))


def selected_motions(
    current: Candidates, labels: Integers, description: Description
) -> list[SelectedMotion]:
    """The candidates that have tracks, as the result of the selection."""
    total = description.saved_without_bounds(current)
    found = []
    for k in range(len(current)):
        inliers = labels == k + 1
        if not inliers.any():
            continue
        explained = inliers & (current.gains[k] > 0)
        residuals = current.residuals[k][explained if explained.any() else inliers]
        noise = description.families[int(current.set_indices[k])].noise
        found.append(
            SelectedMotion(
                set_index=int(current.set_indices[k]),
                point=current.points[k],
                inliers=inliers,
                mode=int(current.modes[k]),
                scale=noise.standard_deviation(residuals),
                cost_saved=total - description.saved_without_bounds(current.without(k)),
            )
        )
    return found
