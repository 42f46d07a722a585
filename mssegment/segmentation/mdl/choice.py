"""``mdl``: the motions, and their number, that give the shortest description of all tracks.

The modes of the hypotheses are candidates; what each saves on each track is its likelihood against
a uniform code (``likelihood``). A set of motions saves what its motions save on the tracks they
win, less the price of their parameters and less the code of the labels: minus the logarithm of
each label's frequency, so that splitting a body costs an amount *per track*, however dense the
matches are. The search (``search``) starts with the candidates that save most and changes the set
as long as the description gets shorter. At last the labels are settled once more, each coded with
the labels of its neighbours. It is one mechanism for every motion model: a model adds its number of
parameters, the dimension of its residual, its residual, its fit and the extent it leaves free.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Integers, Record, replace
from mssegment.sampling.neighbourhoods import nearest_neighbours, neighbour_space
from mssegment.segmentation.mdl.candidates import Candidates, Family, from_modes, join
from mssegment.segmentation.mdl.continuity import join_faces
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.granularity import parallax_of, scale_range, suggest
from mssegment.segmentation.mdl.labelling import NEIGHBOURS, Neighbourhood, neighbour_labels
from mssegment.segmentation.mdl.likelihood import Noise, uniform_cost
from mssegment.segmentation.mdl.refinement import refit_once
from mssegment.segmentation.mdl.search import improve, refitted, start
from mssegment.segmentation.options import Granularity
from mssegment.segmentation.selection import SelectedMotion, SelectionProblem, SelectionResult

TRUST = 0.5
"""How far the labels of walls are predicted by their neighbours', how far by frequency."""
SETTLING = 5
"""Turns of neighbour labels and refits at the end."""


class Recipe(Record, frozen=True):
    """What the ablation takes away, one at a time.

    ``price`` multiplies what stating the parameters costs; ``freedom`` the degrees of
    freedom of the residuals' distribution (infinite: Gaussian); ``moves`` whether the set is
    changed and refitted after the start; ``neighbours`` whether labels are settled with their
    neighbours'; ``differences`` whether a motion may be stated by its difference from another.
    """

    price: float = 1.0
    freedom: float = 2.5
    moves: bool = True
    neighbours: bool = True
    differences: bool = True
    label_cost: bool = True


STANDARD = Recipe()


def mdl(problem: SelectionProblem, recipe: Recipe = STANDARD) -> SelectionResult:
    """The motions of the shortest description of the tracks of ``problem``.

    Sources: Rissanen, Modeling by shortest data description (1978) for the principle; Delong,
    Osokin, Isack and Boykov, Fast approximate energy minimization with label costs (2012) for
    motions with prices.
    """
    problem, notes = with_granularity(problem, recipe)
    best, description = shortest(problem, recipe)
    labels, best = settle(problem, best, description, recipe.neighbours)
    if problem.options.granularity == "object" and problem.options.motions is None:
        labels, best = join_faces(problem, labels, best, description)
    found = motions_of(best, labels, description)
    if len(found) < description.fewest:
        notes.append(f"{description.fewest} motions were wanted, but the tracks hold {len(found)}")
    if len(problem.observed_sets) > 1 and found:
        notes.append(models_chosen(problem, found))
    return SelectionResult(tuple(found), tuple(notes))


def shortest(problem: SelectionProblem, recipe: Recipe) -> tuple[Candidates, Description]:
    """The motions that save most, before the labels are settled."""
    families = make_families(problem, recipe)
    pool = candidate_pool(problem, families)
    description = describe_tracks(problem, families, recipe)
    best = start(pool, description)
    if not recipe.moves:
        return refitted(best, description)[0], description
    return improve(best, pool, description), description


def with_granularity(
    problem: SelectionProblem, recipe: Recipe
) -> tuple[SelectionProblem, list[str]]:
    """``problem`` with ``auto`` decided, and what to tell the user about it."""
    if problem.options.granularity != "auto":
        return problem, []
    surfaces = _at(problem, "surface")
    if not has_walls(problem):
        return _at(problem, "object"), [
            "granularity auto: object (only homographies can tell surfaces from objects)"
        ]
    found, description = shortest(surfaces, recipe)
    labels = description.labels(found)
    inliers = labels == np.arange(1, len(found) + 1)[:, None]
    scales = np.zeros(len(found))
    for k in range(len(found)):
        noise = replace(description.families[int(found.set_indices[k])].noise, floor=0.0)
        scales[k] = noise.scales(found.residuals[[k]], inliers[[k]].astype(np.float64))[0]
    suggestion = suggest(scales, inliers.sum(axis=1), problem.points)
    word = "are" if suggestion == "surface" else "are not"
    note = f"granularity auto: {suggestion} (the pieces {word} flat); the choice is yours"
    return _at(problem, suggestion), [note]


def _at(problem: SelectionProblem, granularity: Granularity) -> SelectionProblem:
    return replace(problem, options=replace(problem.options, granularity=granularity))


def has_walls(problem: SelectionProblem) -> bool:
    """Whether motions may be those of planes seen in perspective, parts of something larger."""
    return any(
        observed_set.model.planar_under_perspective for observed_set in problem.observed_sets
    )


def describe_tracks(
    problem: SelectionProblem, families: Sequence[Family], recipe: Recipe
) -> Description:
    """The description that ``problem`` asks for."""
    given = problem.options.motions
    exact = all(family.observed_set.model.leaves_parallax_free for family in families)
    # a body that turns a little misfits its translation smoothly
    smooth = any(observed_set.model.needs_camera for observed_set in problem.observed_sets)
    apart = problem.options.granularity == "surface" or (exact and not smooth)
    nearest = nearest_neighbours(problem.points, NEIGHBOURS) if apart else None
    walls = has_walls(problem)
    # parallax, and a tracker's drift over many frames, are smooth inside a body: no second motion
    rigid = problem.options.granularity == "surface" and problem.points.shape[1] == 2
    return Description(
        families,
        problem.points[:, 0],
        fewest=problem.options.min_motions if given is None else given,
        most=np.inf if given is None else given,
        price=recipe.price,
        label_cost=recipe.label_cost,
        nearest=nearest,
        trust=TRUST if walls else 1.0,
        differences=recipe.differences and rigid and not walls,
    )


def make_families(problem: SelectionProblem, recipe: Recipe) -> list[Family]:
    """The sets of ``problem`` with their noise."""
    outlier = uniform_cost(problem.points)
    families = []
    for index, observed_set in enumerate(problem.observed_sets):
        model = observed_set.model
        free = model.log_free_extent(observed_set.observed, observed_set.hypotheses.normalization)
        predicts_points = not model.leaves_parallax_free
        floor, cap = scale_range(problem.points, predicts_points, model.needs_camera)
        noise = Noise(
            model.residual_dimension,
            model.residual_terms,
            floor,
            cap,
            free,
            outlier,
            parallax_of(problem.points, problem.options.granularity, predicts_points),
            recipe.freedom,
        )
        families.append(Family(index, observed_set, noise))
    return families


def candidate_pool(problem: SelectionProblem, families: Sequence[Family]) -> Candidates:
    """All candidates: every mode of every set."""
    parts: list[Candidates] = []
    for family in families:
        own = [i for i, mode in enumerate(problem.modes) if mode.set_index == family.index]
        if own:
            points = np.stack([problem.modes[i].point for i in own])
            parts += from_modes(family, points, np.array(own))
    return join(parts) if parts else Candidates.none(len(problem.points))


def settle(
    problem: SelectionProblem, chosen: Candidates, description: Description, neighbours: bool
) -> tuple[Integers, Candidates]:
    """The final labels [P], each coded with its neighbours', and the motions fitted to them.

    How large a misfit is one body decides what the motions are; which tracks belong to them is
    decided at the scale that each motion turns out to have.
    """
    if not neighbours:
        return description.labels(chosen), chosen
    families = [family.measured() for family in description.families]
    neighbourhood = Neighbourhood(neighbour_space(problem.points))
    labels = neighbour_labels(chosen.gains, neighbourhood, description.labels(chosen))
    for _ in range(SETTLING):
        inliers = labels == np.arange(1, len(chosen) + 1)[:, None]
        chosen = refit_once(families, chosen, inliers.astype(np.float64))
        before, labels = labels, neighbour_labels(chosen.gains, neighbourhood, labels)
        if np.array_equal(labels, before):
            break
    return labels, chosen


def models_chosen(problem: SelectionProblem, found: Sequence[SelectedMotion]) -> str:
    """Which model the description length chose for each motion, as a sentence."""
    ranked = sorted(found, key=lambda motion: -int(motion.inliers.sum()))
    names = [problem.observed_sets[motion.set_index].model.name for motion in ranked]
    return "models chosen: " + ", ".join(f"{n} {name}" for n, name in enumerate(names, start=1))


def motions_of(
    chosen: Candidates, labels: Integers, description: Description
) -> list[SelectedMotion]:
    """The motions as the rest of the house knows them."""
    total = description.worth(chosen)
    found = []
    for k in range(len(chosen)):
        inliers = labels == k + 1
        if not inliers.any():
            continue
        rest = chosen.take([j for j in range(len(chosen)) if j != k])
        explained = inliers & (chosen.gains[k] > 0)
        residuals = chosen.residuals[k][explained if explained.any() else inliers]
        noise = description.families[int(chosen.set_indices[k])].noise
        found.append(
            SelectedMotion(
                set_index=int(chosen.set_indices[k]),
                point=chosen.points[k],
                inliers=inliers,
                mode=int(chosen.modes[k]),
                scale=noise.deviation(residuals),
                cost_saved=total - description.worth(rest),
            )
        )
    return found
