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

from mssegment.records import Integers, replace
from mssegment.segmentation.mdl.blends import without_blends
from mssegment.segmentation.mdl.candidates import Candidates
from mssegment.segmentation.mdl.continuity import merge_faces
from mssegment.segmentation.mdl.data_prices import on_all_points, sample_of, without_unit
from mssegment.segmentation.mdl.description import Description, least_tracks
from mssegment.segmentation.mdl.final_labels import final_labels
from mssegment.segmentation.mdl.granularity import suggest
from mssegment.segmentation.mdl.pieces import with_pieces
from mssegment.segmentation.mdl.preparation import (
    ALL_INGREDIENTS,
    Ingredients,
    candidate_pool,
    has_perspective_planes,
    is_of_pictures,
    make_description,
    make_families,
)
from mssegment.segmentation.mdl.rigid_motions import joined, may_join, with_numbers
from mssegment.segmentation.mdl.search import improve, refitted, start
from mssegment.segmentation.mdl.shared_fit import shared_fit, shared_labels
from mssegment.segmentation.options import Granularity
from mssegment.segmentation.selection import (
    SelectedMotion,
    SelectionProblem,
    SelectionResult,
)


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
    labels = without_blends(problem, labels, best, description)
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
        best = shared_fit(description, best)
        best, description = on_all_points(normalized, best, description)
    labels = shared_labels(description, best) if len(best) else description.labels(best)
    found = []
    for one in selected_motions(best, labels, description):
        k = int(labels[one.inliers][0]) - 1
        unit = problem.observed_sets[one.set_index].hypotheses.normalization.scale
        found.append(replace(one, scale=unit * float(best.scales[k])))
    notes: tuple[str, ...] = ()
    if len(found) < description.min_motions:
        notes = (f"{description.min_motions} structures requested, {len(found)} found",)
    return SelectionResult(tuple(found), notes, refitted=True)


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
        residuals = current.lengths[k][explained if explained.any() else inliers]
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
