"""The results of a benchmark, and statistics over them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mssegment.records import Record


class SequenceResult(Record, frozen=True):
    """The result of one sequence with one seed.

    Attributes
    ----------
    name, group : str
        The sequence and the part of the data set it belongs to.
    error : float
        The misclassification, 0 to 1.
    motions_true, motions_found : int
        The true and the found number of motions.
    seconds : float
        Wall-clock time of the pipeline, without reading the file.
    seed : int
        The seed.
    """

    name: str
    group: str
    error: float
    motions_true: int
    motions_found: int
    seconds: float
    seed: int


class GroupSummary(Record, frozen=True):
    """Statistics over the results of a group of sequences.

    Attributes
    ----------
    sequences : int
        The number of sequences.
    mean : float
        The mean error over all results, 0 to 1.
    median : float
        The median over the sequences of their mean error.
    count_right : float
        The fraction of results with the true number of motions.
    seconds : float
        The mean time of a result.
    """

    sequences: int
    mean: float
    median: float
    count_right: float
    seconds: float


def summarise(results: Iterable[SequenceResult]) -> dict[str, GroupSummary]:
    """Summarize results by group.

    Parameters
    ----------
    results : iterable of SequenceResult

    Returns
    -------
    dict of str to GroupSummary
        The groups in alphabetical order, then ``all``; empty without results.
    """
    everything = list(results)
    names = sorted({result.group for result in everything})
    groups = {name: [r for r in everything if r.group == name] for name in names}
    if everything:
        groups["all"] = everything
    return {name: _summary(members) for name, members in groups.items()}


def _summary(results: Sequence[SequenceResult]) -> GroupSummary:
    by_name: dict[str, list[float]] = {}
    for result in results:
        by_name.setdefault(result.name, []).append(result.error)
    return GroupSummary(
        sequences=len(by_name),
        mean=float(np.mean([result.error for result in results])),
        median=float(np.median([np.mean(errors) for errors in by_name.values()])),
        count_right=float(np.mean([r.motions_true == r.motions_found for r in results])),
        seconds=float(np.mean([result.seconds for result in results])),
    )
