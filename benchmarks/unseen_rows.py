"""A row of the tables of unseen data: cases, their outcomes, and the goal beside them."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import mssegment
from benchmarks.unseen_scenes import Scene
from mssegment.errors import DataError
from mssegment.evaluation import misclassification
from mssegment.records import Floats, Integers

WITHIN = 0.05
"""A case is right if its count is and its error exceeds the oracle's by at most this."""


@dataclass(frozen=True)
class Plan:
    """What to run: the seeds, the scenes of a synthetic row for each seed, the real data."""

    seeds: range
    scenes: int
    folder: Path | None


@dataclass(frozen=True)
class Case:
    """Tracks to be segmented, [P, F, 2] pixels, and their true labels [P] (0 outlier).

    ``counts`` are the least and the largest right number of motions, by default the true number.
    ``oracle`` is the best achievable misclassification, NaN where nobody knows. ``factors`` say
    what the case holds.
    """

    points: Floats
    labels: Integers
    settings: Mapping[str, Any] = field(default_factory=dict)
    frame_size: tuple[int, int] | None = None
    camera: mssegment.Camera | None = None
    name: str = ""
    counts: tuple[int, int] | None = None
    oracle: float = float("nan")
    factors: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """One case: errors are fractions, ``seconds`` are of CPU; ``refused`` is the error message.

    ``right`` cases have a right count and an error of at most the oracle's and ``WITHIN``.
    """

    cell: str
    name: str
    seed: int
    error: float
    oracle: float
    true: int
    found: int
    count_right: bool
    right: bool
    seconds: float
    refused: str = ""
    factors: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Row:
    """One row: its goals on the data at hand and on unseen data, and how it is run.

    ``needs`` is the folder of real data without which the row is skipped. Rows of one ``group``
    share tables by factor.
    """

    name: str
    title: str
    goal: str
    unseen: str
    outcomes: Callable[[Plan], Iterator[Outcome]]
    needs: str = ""
    group: str = ""

    def missing(self, plan: Plan) -> str:
        """A sentence that says which data is not there; empty where the row can run."""
        if not self.needs or (plan.folder is not None and (plan.folder / self.needs).exists()):
            return ""
        return f"no {self.needs}: set MSSEGMENT_DATA, or put the data into ../shared/data"


def outcome_of(case: Case, seed: int, cell: str = "") -> Outcome:
    """Segments a case and compares with its truth; tracks that are refused hold no motion."""
    settings = {"seed": seed, **case.settings}
    refused = ""
    start = time.process_time()
    try:
        labels = mssegment.segment_tracks(
            case.points, settings, frame_size=case.frame_size, camera=case.camera
        ).labels
    except DataError as error:
        labels, refused = np.zeros(len(case.points), dtype=np.int64), str(error)
    seconds = time.process_time() - start
    return judged(
        case,
        seed,
        cell,
        misclassification(labels, case.labels),
        (len(_motions(case.labels)), len(_motions(labels))),
        seconds,
        refused,
    )


def judged(
    case: Case,
    seed: int,
    cell: str,
    error: float,
    motions: tuple[int, int],
    seconds: float,
    refused: str = "",
) -> Outcome:
    """The outcome of a case with this error and (true, found) numbers of motions."""
    true, found = motions
    least, most = case.counts or (true, true)
    count_right = least <= found <= most
    reachable = 0.0 if np.isnan(case.oracle) else case.oracle
    # where there is no motion, the labels of the one that may be found say nothing
    right = count_right and (true == 0 or error <= reachable + WITHIN)
    return Outcome(
        cell,
        case.name,
        seed,
        error,
        case.oracle,
        true,
        found,
        count_right,
        right,
        seconds,
        refused,
        case.factors,
    )


def _motions(labels: Integers) -> Integers:
    return np.unique(labels[labels > 0])


def synthetic(
    name: str,
    cells: Mapping[str, Callable[[np.random.Generator], Case | Scene]],
    most: int | None = None,
) -> Callable[[Plan], Iterator[Outcome]]:
    """The outcomes of random cases: the scenes of each seed are shared out among the cells.

    A cell has at most ``most`` scenes for each seed. The random numbers depend on the row, the
    cell, the seed and the scene, not on other rows.
    """

    def outcomes(plan: Plan) -> Iterator[Outcome]:
        each = -(-plan.scenes // len(cells))
        each = min(each, most or each)
        for seed in plan.seeds:
            for cell, make in cells.items():
                key = zlib.crc32(f"{name} {cell}".encode())
                for index in range(each):
                    made = make(np.random.default_rng([seed, key, index]))
                    case = case_of(made) if isinstance(made, Scene) else made
                    yield outcome_of(case, seed, cell)

    return outcomes


def case_of(scene: Scene, settings: Mapping[str, Any] | None = None) -> Case:
    """A scene as a case, with its oracle; the settings are the defaults but for ``settings``."""
    return Case(
        scene.points,
        scene.labels,
        settings or {},
        scene.picture,
        oracle=scene.oracle(),
        factors=scene.factors,
    )


def chosen(rows: Sequence[Row], names: Sequence[str]) -> list[Row]:
    """The rows with these names, or whose names begin so; all where none is named.

    Raises ValueError for a name that no row begins with.
    """
    for name in names:
        if not any(row.name.startswith(name) for row in rows):
            known = ", ".join(row.name for row in rows)
            raise ValueError(f"no row {name!r}; the rows are {known}")
    return [row for row in rows if not names or row.name.startswith(tuple(names))]
